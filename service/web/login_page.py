"""Signing in and out, and the one-time links by which people choose their passwords."""

from __future__ import annotations

from urllib.parse import urlsplit

from fastapi import APIRouter, Request, Response
from fastapi.responses import HTMLResponse, RedirectResponse

from stemwatch.service.access.links import BadName, LinkIsOver, find_link, use_link
from stemwatch.service.access.login import LoginRefused, TooMany, sign_in
from stemwatch.service.access.passwords import LONGEST, SHORTEST, Busy, WeakPassword
from stemwatch.service.access.sessions import begin_session
from stemwatch.service.store.accounts.records import Entry, Link, LinkKind
from stemwatch.service.store.accounts.users import NameTaken
from stemwatch.service.web.desk import AtDesk, Desk
from stemwatch.service.web.forms import OpenSent, Sent
from stemwatch.service.web.session_cookie import drop_session, set_session
from stemwatch.service.web.visit import AtVisit, address_of

router = APIRouter(include_in_schema=False)


@router.get("/login")
def login(request: Request, desk: AtDesk) -> HTMLResponse:
    """The form to sign in; ``next`` in the address is where it leads afterwards."""
    wanted = safe_place(request.query_params.get("next", ""))
    return _login_page(request, desk, wanted)


@router.post("/login")
def log_in(request: Request, desk: AtDesk, form: OpenSent) -> Response:
    """Sign in with name and password."""
    wanted, name = safe_place(form.text("next")), form.text("name")
    try:
        _, cookie = sign_in(
            desk.store,
            name,
            form.secret("password"),
            now=desk.now,
            address=address_of(request.scope),
            agent=request.headers.get("user-agent", ""),
        )
    except TooMany as error:
        page = _login_page(request, desk, wanted, name=name, said=str(error), status=429)
        page.headers["retry-after"] = str(error.wait_s)
        return page
    except LoginRefused as error:
        return _login_page(request, desk, wanted, name=name, said=str(error), status=403)
    except Busy as error:
        return _login_page(request, desk, wanted, name=name, said=str(error), status=503)
    return _enter(request, cookie, wanted)


@router.post("/logout")
def log_out(request: Request, desk: AtDesk, visitor: AtVisit, _form: Sent) -> RedirectResponse:
    """End the session of this browser."""
    desk.store.web_sessions.end(visitor.session)
    answer = RedirectResponse(f"{_base(request)}/login", 303)
    drop_session(answer, request.scope)
    return answer


@router.get("/welcome")
def welcome(request: Request, desk: AtDesk) -> HTMLResponse:
    """Where a one-time link leads: choose a password, and as a new user a name."""
    secret = request.query_params.get("link", "")
    try:
        link = find_link(desk.store, secret, desk.now)
    except LinkIsOver as error:
        return _over(request, desk, error)
    return _welcome_page(request, desk, link, secret)


@router.post("/welcome")
def take_link(request: Request, desk: AtDesk, form: OpenSent) -> Response:
    """Use a one-time link up, and sign in."""
    secret, name = form.text("link"), form.text("name")
    try:
        link = find_link(desk.store, secret, desk.now)
        password = form.secret("password")
        if password != form.secret("again"):
            raise WeakPassword("the two passwords are not the same")
        user = use_link(desk.store, secret, name, password, desk.now)
    except LinkIsOver as error:
        return _over(request, desk, error)
    except (BadName, WeakPassword, NameTaken, Busy) as error:
        return _welcome_page(request, desk, link, secret, name=name, said=str(error), status=422)
    address = address_of(request.scope)
    desk.store.audit.add(
        Entry(
            at=desk.now,
            who=user.name,
            how="one-time link",
            address=address,
            action="choose a password" if link.kind is LinkKind.PASSWORD else "become a user",
            about=f"user {user.name}; role {user.role}; link {link.id} by {link.created_by or '-'}",
        )
    )
    agent = request.headers.get("user-agent", "")
    cookie = begin_session(desk.store, user.id, now=desk.now, address=address, agent=agent)
    return _enter(request, cookie, "/")


def safe_place(wanted: str) -> str:
    """A page of this site, or the first one: nobody is led elsewhere by a link to the login."""
    parts = urlsplit(wanted)
    plain = wanted.isprintable() and "\\" not in wanted
    own = wanted.startswith("/") and not wanted.startswith("//")
    return wanted if plain and own and not parts.scheme and not parts.netloc else "/"


def _enter(request: Request, cookie: str, wanted: str) -> RedirectResponse:
    answer = RedirectResponse(f"{_base(request)}{wanted}", 303)
    set_session(answer, cookie, request.scope)
    return answer


def _login_page(
    request: Request, desk: Desk, wanted: str, *, name: str = "", said: str = "", status: int = 200
) -> HTMLResponse:
    return desk.frame.page(
        request,
        "login_page.html",
        status=status,
        wanted=wanted,
        name=name,
        said=said,
        nobody=desk.store.accounts.is_empty(),
    )


def _welcome_page(
    request: Request,
    desk: Desk,
    link: Link,
    secret: str,
    *,
    name: str = "",
    said: str = "",
    status: int = 200,
) -> HTMLResponse:
    owner = desk.store.accounts.get(link.user_id) if link.user_id is not None else None
    return desk.frame.page(
        request,
        "welcome_page.html",
        status=status,
        link=link,
        secret=secret,
        owner=owner,
        name=name,
        said=said,
        shortest=SHORTEST,
        longest=LONGEST,
    )


def _over(request: Request, desk: Desk, error: LinkIsOver) -> HTMLResponse:
    return desk.frame.page(request, "error_page.html", status=410, text=str(error), code=410)


def _base(request: Request) -> str:
    return str(request.scope.get("root_path", "")).rstrip("/")
