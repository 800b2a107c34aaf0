"""Signing in and out, and the one-time links by which people choose their passwords."""

from __future__ import annotations

from fastapi import APIRouter, Request, Response
from fastapi.responses import HTMLResponse, RedirectResponse

from stemwatch.service.access.known_browser import remember_browser
from stemwatch.service.access.links import BadName, InvalidLink, find_link, use_link
from stemwatch.service.access.login import LoginRefused, TooMany, sign_in
from stemwatch.service.access.passwords import LONGEST, SHORTEST, Busy, WeakPassword
from stemwatch.service.access.sessions import begin_session, end_session
from stemwatch.service.store.accounts.records import AuditEntry, OneTimeLink, OneTimeLinkKind, User
from stemwatch.service.store.accounts.users import NameTaken
from stemwatch.service.web.auth.current_user import SignedIn, address_of
from stemwatch.service.web.auth.forms import SentForm, SentOpenForm
from stemwatch.service.web.auth.session_cookie import (
    cookie_name,
    drop_session,
    known_browser_of,
    set_known_browser,
    set_session,
)
from stemwatch.service.web.dependencies import Dependencies, Deps
from stemwatch.service.web.path_prefix import root_of

router = APIRouter(include_in_schema=False)


@router.get("/login")
def login(request: Request, deps: Deps) -> HTMLResponse:
    """The form to sign in; ``next`` in the address is where it leads afterwards."""
    next_page = safe_place(request.query_params.get("next", ""))
    return _login_page(request, deps, next_page)


@router.post("/login")
def log_in(request: Request, deps: Deps, form: SentOpenForm) -> Response:
    """Sign in with name and password."""
    next_page, name = safe_place(form.text("next")), form.text("name")
    try:
        user, cookie = sign_in(
            deps.store,
            name,
            form.secret("password"),
            now=deps.now,
            address=address_of(request.scope),
            agent=request.headers.get("user-agent", ""),
            browser=known_browser_of(request),
        )
    except TooMany as error:
        page = _login_page(request, deps, next_page, name=name, message=str(error), status=429)
        page.headers["retry-after"] = str(error.wait_s)
        return page
    except LoginRefused as error:
        return _login_page(request, deps, next_page, name=name, message=str(error), status=403)
    except Busy as error:
        return _login_page(request, deps, next_page, name=name, message=str(error), status=503)
    return _enter(request, deps, user, cookie, next_page)


@router.post("/logout")
def log_out(
    request: Request, deps: Deps, current_user: SignedIn, _form: SentForm
) -> RedirectResponse:
    """End the session of this browser."""
    deps.store.web_sessions.end(current_user.session)
    answer = RedirectResponse(f"{root_of(request.scope)}/login", 303)
    drop_session(answer, request.scope)
    return answer


@router.get("/welcome")
def welcome(request: Request, deps: Deps) -> HTMLResponse:
    """Where a one-time link leads: choose a password, and as a new user a name."""
    secret = request.query_params.get("link", "")
    try:
        link = find_link(deps.store, secret, deps.now)
    except InvalidLink as error:
        return _invalid_link_page(request, deps, error)
    return _welcome_page(request, deps, link, secret)


@router.post("/welcome")
def take_link(request: Request, deps: Deps, form: SentOpenForm) -> Response:
    """Use a one-time link up, and sign in."""
    secret, name = form.text("link"), form.text("name")
    try:
        link = find_link(deps.store, secret, deps.now)
        password = form.secret("password")
        if password != form.secret("again"):
            raise WeakPassword("the two passwords are not the same")
        user = use_link(deps.store, secret, name, password, deps.now)
    except InvalidLink as error:
        return _invalid_link_page(request, deps, error)
    except (BadName, WeakPassword, NameTaken, Busy) as error:
        return _welcome_page(request, deps, link, secret, name=name, message=str(error), status=422)
    address = address_of(request.scope)
    deps.store.audit.add(
        AuditEntry(
            at=deps.now,
            who=user.name,
            how="one-time link",
            address=address,
            action="choose a password"
            if link.kind is OneTimeLinkKind.PASSWORD
            else "become a user",
            about=f"user {user.name}; role {user.role}; link {link.id} by {link.created_by or '-'}",
        )
    )
    agent = request.headers.get("user-agent", "")
    cookie = begin_session(deps.store, user.id, now=deps.now, address=address, agent=agent)
    return _enter(request, deps, user, cookie, "/")


def safe_place(address: str) -> str:
    """The address if it is a page of this site, else the first page, so that a login link cannot
    redirect to another site."""
    printable = address.isprintable() and "\\" not in address
    on_this_site = address.startswith("/") and not address.startswith("//")
    return address if printable and on_this_site else "/"


def _enter(
    request: Request, deps: Dependencies, user: User, cookie: str, next_page: str
) -> RedirectResponse:
    """Redirect with the new session's cookie; an earlier session of this browser is ended."""
    answer = RedirectResponse(f"{root_of(request.scope)}{next_page}", 303)
    if old := request.cookies.get(cookie_name(request.scope), ""):
        end_session(deps.store, old)
    set_session(answer, cookie, request.scope)
    password = deps.store.accounts.password_of(user.name)
    if password is not None:
        mark = remember_browser(known_browser_of(request), password[1], deps.now)
        set_known_browser(answer, mark, request.scope)
    return answer


def _login_page(
    request: Request,
    deps: Dependencies,
    next_page: str,
    *,
    name: str = "",
    message: str = "",
    status: int = 200,
) -> HTMLResponse:
    return deps.renderer.page(
        request,
        "login_page.html",
        status=status,
        wanted=next_page,
        name=name,
        said=message,
        nobody=deps.store.accounts.is_empty(),
    )


def _welcome_page(
    request: Request,
    deps: Dependencies,
    link: OneTimeLink,
    secret: str,
    *,
    name: str = "",
    message: str = "",
    status: int = 200,
) -> HTMLResponse:
    owner = deps.store.accounts.get(link.user_id) if link.user_id is not None else None
    return deps.renderer.page(
        request,
        "welcome_page.html",
        status=status,
        link=link,
        secret=secret,
        owner=owner,
        name=name,
        said=message,
        shortest=SHORTEST,
        longest=LONGEST,
    )


def _invalid_link_page(request: Request, deps: Dependencies, error: InvalidLink) -> HTMLResponse:
    return deps.renderer.page(request, "error_page.html", status=410, text=str(error), code=410)
