"""Users, for admins: who there is, what each may do, and one-time links for new ones."""

from __future__ import annotations

from collections.abc import Callable

from fastapi import APIRouter, HTTPException, Request
from fastapi.responses import HTMLResponse, RedirectResponse

from stemwatch.service.access.links import address_of, make_link
from stemwatch.service.store.accounts.records import OneTimeLink, OneTimeLinkKind, User, UserRole
from stemwatch.service.store.accounts.users import LastAdmin
from stemwatch.service.web.actions import LARGEST_NUMBER, Refused
from stemwatch.service.web.auth.current_user import SignedIn, note_about
from stemwatch.service.web.auth.forms import Form, SentForm
from stemwatch.service.web.dependencies import Dependencies, Deps
from stemwatch.service.web.pages.redirects import to_page

router = APIRouter(include_in_schema=False)


@router.get("/users")
def user_list(request: Request, deps: Deps) -> HTMLResponse:
    """Every user, and the one-time links that are still valid."""
    return _page(request, deps)


@router.post("/users/invite")
def invite(request: Request, deps: Deps, current_user: SignedIn, form: SentForm) -> HTMLResponse:
    """A one-time link for a new user; it is shown on this one page and never again."""
    note = form.text("note", longest=200)
    role, now = _role(form), deps.now
    note_about(request, f"invite {note}" if note else "invite")
    secret, link = make_link(
        deps.store, OneTimeLinkKind.INVITATION, role, made_by=current_user.name, now=now, note=note
    )
    return _page(request, deps, new_link=link, address=address_of(secret, _base_url(request)))


@router.post("/users/password")
def new_password(
    request: Request, deps: Deps, current_user: SignedIn, form: SentForm
) -> HTMLResponse:
    """A one-time link at which a user chooses a new password. Admins set none and see none."""
    user = _user(request, deps, form)
    if user.disabled is not None:
        raise Refused(f"{user.name} is disabled; enable the user first")
    secret, link = make_link(
        deps.store,
        OneTimeLinkKind.PASSWORD,
        user.role,
        made_by=current_user.name,
        now=deps.now,
        user=user.id,
        note=user.name,
    )
    return _page(request, deps, new_link=link, address=address_of(secret, _base_url(request)))


@router.post("/users/role")
def set_role(request: Request, deps: Deps, form: SentForm) -> RedirectResponse:
    """Change what a user may do; it holds from the next request on."""
    user, role = _user(request, deps, form), _role(form)
    note_about(request, f"before {user.role}")
    _unless_last(lambda: deps.store.accounts.set_role(user.id, role))
    return to_page(request, "/users", "role")


@router.post("/users/disable")
def disable(request: Request, deps: Deps, form: SentForm) -> RedirectResponse:
    """Disable a user. The audit log keeps what the user did."""
    user = _user(request, deps, form)
    note_about(request, "disable")
    _unless_last(lambda: deps.store.accounts.disable(user.id, deps.now))
    return to_page(request, "/users", "disabled")


@router.post("/users/enable")
def enable(request: Request, deps: Deps, form: SentForm) -> RedirectResponse:
    """Enable a disabled user."""
    user = _user(request, deps, form)
    note_about(request, "enable")
    deps.store.accounts.enable(user.id)
    return to_page(request, "/users", "enabled")


@router.post("/users/links/withdraw")
def withdraw(request: Request, deps: Deps, form: SentForm) -> RedirectResponse:
    """Withdraw a one-time link."""
    number = form.number("number", "the number of a link")
    note_about(request, f"withdraw link {number}")
    if number > LARGEST_NUMBER or not deps.store.access_links.revoke(number, deps.now):
        raise HTTPException(404, f"There is no link {number} that still lets somebody in.")
    return to_page(request, "/users", "withdrawn")


def _page(
    request: Request, deps: Dependencies, *, new_link: OneTimeLink | None = None, address: str = ""
) -> HTMLResponse:
    open_links = deps.store.access_links.open(deps.now)
    return deps.renderer.page(
        request,
        "users_page.html",
        here="users",
        open_alerts=deps.open_alerts(),
        users=deps.store.accounts.all(),
        links=[link for link in open_links if link.kind is not OneTimeLinkKind.FIRST],
        roles=list(UserRole),
        made=new_link,
        address=address,
    )


def _user(request: Request, deps: Dependencies, form: Form) -> User:
    number = form.number("user", "the number of a user")
    user = deps.store.accounts.get(number) if number <= LARGEST_NUMBER else None
    if user is None:
        raise HTTPException(404, f"There is no user {number}.")
    note_about(request, user.name)
    return user


def _role(form: Form) -> UserRole:
    role_text = form.text("role", needed="a role")
    if role_text not in list(UserRole):
        raise HTTPException(422, f"{', '.join(UserRole)} is expected, received {role_text!r}")
    return UserRole(role_text)


def _unless_last(change: Callable[[], object]) -> None:
    try:
        change()
    except LastAdmin as error:
        raise Refused(str(error)) from None


def _base_url(request: Request) -> str:
    """The address under which the reader sees this site; ``SecurityMiddleware`` has checked the
    host name."""
    return str(request.base_url)
