"""Users, for admins: who there is, what each may do, and one-time links for new ones."""

from __future__ import annotations

from collections.abc import Callable

from fastapi import APIRouter, HTTPException, Request
from fastapi.responses import HTMLResponse, RedirectResponse

from stemwatch.service.access.links import address_of, make_link
from stemwatch.service.store.accounts.records import Link, LinkKind, Role, User
from stemwatch.service.store.accounts.users import LastAdmin
from stemwatch.service.web.account_page import back
from stemwatch.service.web.actions import LARGEST_NUMBER, Refused
from stemwatch.service.web.desk import AtDesk, Desk
from stemwatch.service.web.forms import Form, Sent
from stemwatch.service.web.visit import AtVisit, note_about

router = APIRouter(include_in_schema=False)


@router.get("/users")
def user_list(request: Request, desk: AtDesk) -> HTMLResponse:
    """Every user, and the links that still let somebody in."""
    return _page(request, desk)


@router.post("/users/invite")
def invite(request: Request, desk: AtDesk, visitor: AtVisit, form: Sent) -> HTMLResponse:
    """A one-time link for a new user; it is shown on this one page and never again."""
    note = form.text("note", most=200)
    role, now = _role(form), desk.now
    note_about(request, f"invite {note}" if note else "invite")
    secret, link = make_link(
        desk.store, LinkKind.INVITATION, role, by=visitor.name, now=now, note=note
    )
    return _page(request, desk, made=link, address=address_of(secret, _base_url(request)))


@router.post("/users/password")
def new_password(request: Request, desk: AtDesk, visitor: AtVisit, form: Sent) -> HTMLResponse:
    """A one-time link at which a user chooses a new password. Admins set none and see none."""
    user = _user(request, desk, form)
    if user.disabled is not None:
        raise Refused(f"{user.name} is disabled; enable the user first")
    secret, link = make_link(
        desk.store,
        LinkKind.PASSWORD,
        user.role,
        by=visitor.name,
        now=desk.now,
        user=user.id,
        note=user.name,
    )
    return _page(request, desk, made=link, address=address_of(secret, _base_url(request)))


@router.post("/users/role")
def set_role(request: Request, desk: AtDesk, form: Sent) -> RedirectResponse:
    """Change what a user may do; it holds from the next request on."""
    user, role = _user(request, desk, form), _role(form)
    note_about(request, f"before {user.role}")
    _unless_last(lambda: desk.store.accounts.set_role(user.id, role))
    return back(request, "/users", "role")


@router.post("/users/disable")
def disable(request: Request, desk: AtDesk, form: Sent) -> RedirectResponse:
    """Let a user in no more. What the user did stays on record."""
    user = _user(request, desk, form)
    note_about(request, "disable")
    _unless_last(lambda: desk.store.accounts.disable(user.id, desk.now))
    return back(request, "/users", "disabled")


@router.post("/users/enable")
def enable(request: Request, desk: AtDesk, form: Sent) -> RedirectResponse:
    """Let a user in again."""
    user = _user(request, desk, form)
    note_about(request, "enable")
    desk.store.accounts.enable(user.id)
    return back(request, "/users", "enabled")


@router.post("/users/links/withdraw")
def withdraw(request: Request, desk: AtDesk, form: Sent) -> RedirectResponse:
    """Make a one-time link worthless."""
    number = form.number("number", "the number of a link")
    note_about(request, f"withdraw link {number}")
    if number > LARGEST_NUMBER or not desk.store.access_links.revoke(number, desk.now):
        raise HTTPException(404, f"There is no link {number} that still lets somebody in.")
    return back(request, "/users", "withdrawn")


def _page(
    request: Request, desk: Desk, *, made: Link | None = None, address: str = ""
) -> HTMLResponse:
    open_links = desk.store.access_links.open(desk.now)
    return desk.frame.page(
        request,
        "users_page.html",
        here="users",
        open_alerts=desk.open_alerts(),
        users=desk.store.accounts.all(),
        links=[one for one in open_links if one.kind is not LinkKind.FIRST],
        roles=list(Role),
        made=made,
        address=address,
    )


def _user(request: Request, desk: Desk, form: Form) -> User:
    number = form.number("user", "the number of a user")
    found = desk.store.accounts.get(number) if number <= LARGEST_NUMBER else None
    if found is None:
        raise HTTPException(404, f"There is no user {number}.")
    note_about(request, found.name)
    return found


def _role(form: Form) -> Role:
    given = form.text("role", needed="a role")
    if given not in list(Role):
        raise HTTPException(422, f"{', '.join(Role)} is expected, received {given!r}")
    return Role(given)


def _unless_last(change: Callable[[], object]) -> None:
    try:
        change()
    except LastAdmin as error:
        raise Refused(str(error)) from None


def _base_url(request: Request) -> str:
    """Under which the reader sees this site; the guard has checked the name."""
    return str(request.base_url)
