"""One's own account: the password, the browsers that are signed in, and the tokens."""

from __future__ import annotations

from fastapi import APIRouter, HTTPException, Request, Response
from fastapi.responses import HTMLResponse, RedirectResponse

from stemwatch.service.access import tokens
from stemwatch.service.access.login import TooMany, confirm
from stemwatch.service.access.passwords import (
    LONGEST,
    SHORTEST,
    Busy,
    WeakPassword,
    check_password,
    hash_password,
)
from stemwatch.service.access.permissions import CurrentUser, scopes_of
from stemwatch.service.access.sessions import begin_session, sessions_of
from stemwatch.service.store.accounts.records import Scope, User
from stemwatch.service.web.actions import LARGEST_NUMBER
from stemwatch.service.web.auth.current_user import SignedIn, address_of, note_about
from stemwatch.service.web.auth.forms import SentForm
from stemwatch.service.web.auth.proxy_user import HOW
from stemwatch.service.web.auth.session_cookie import set_session
from stemwatch.service.web.dependencies import Dependencies, Deps
from stemwatch.service.web.pages.redirects import to_page

LIFETIMES_DAYS = (7, 30, 90, 365)
FOR_EVER = 0

router = APIRouter(include_in_schema=False)


@router.get("/account")
def account(request: Request, deps: Deps, current_user: SignedIn) -> HTMLResponse:
    """Who is signed in, where else, and with which tokens."""
    return _page(request, deps, current_user)


@router.post("/account/password")
def change_password(
    request: Request, deps: Deps, current_user: SignedIn, form: SentForm
) -> Response:
    """Change one's password; every other browser is signed out."""
    user, now, address = _user(deps, current_user), deps.now, address_of(request.scope)
    new = form.secret("password")
    try:
        if not confirm(deps.store, user, form.secret("present"), now=now, address=address):
            return _page(
                request, deps, current_user, message="The present password is wrong.", status=422
            )
        check_password(new, user.name)
        if new != form.secret("again"):
            raise WeakPassword("the two new passwords are not the same")
        deps.store.accounts.set_password(user.id, hash_password(new), now)
    except (WeakPassword, TooMany, Busy) as error:
        status = 429 if isinstance(error, TooMany) else 422
        return _page(request, deps, current_user, message=str(error), status=status)
    note_about(request, "password")
    agent = request.headers.get("user-agent", "")
    answer = to_page(request, "/account", "password")
    cookie = begin_session(deps.store, user.id, now=now, address=address, agent=agent)
    set_session(answer, cookie, request.scope)
    return answer


@router.post("/account/sessions/end")
def end_sessions(
    request: Request, deps: Deps, current_user: SignedIn, _form: SentForm
) -> RedirectResponse:
    """Sign out every other browser."""
    note_about(request, "other sessions")
    deps.store.web_sessions.end_others(current_user.user, current_user.session)
    return to_page(request, "/account", "sessions")


@router.post("/account/tokens/make")
def make_token(
    request: Request, deps: Deps, current_user: SignedIn, form: SentForm
) -> HTMLResponse:
    """A new token, shown on this one page and never again."""
    days = form.number("days", "how many days a token holds")
    if days not in (*LIFETIMES_DAYS, FOR_EVER):
        raise HTTPException(422, "one of the lifetimes of the form is expected")
    scopes = [scope for scope in Scope if scope.value in form.all("scope")]
    note_about(request, f"new token; scopes {', '.join(scopes)}")
    try:
        secret = tokens.make_token(
            deps.store,
            _user(deps, current_user),
            form.text("name"),
            scopes,
            now=deps.now,
            days=days or None,
        )
    except tokens.BadToken as error:
        return _page(request, deps, current_user, message=str(error), status=422)
    return _page(request, deps, current_user, secret=secret)


@router.post("/account/tokens/revoke")
def revoke_token(
    request: Request, deps: Deps, current_user: SignedIn, form: SentForm
) -> RedirectResponse:
    """Revoke one of one's own tokens."""
    number = form.number("token", "the number of a token")
    token = deps.store.api_tokens.get(number) if number <= LARGEST_NUMBER else None
    if token is None or token.user.id != current_user.user:
        raise HTTPException(404, f"You have no token {number}.")
    note_about(request, f"revoke {token.name}")
    deps.store.api_tokens.revoke(token.id, deps.now)
    return to_page(request, "/account", "revoked")


def _page(
    request: Request,
    deps: Dependencies,
    current_user: CurrentUser,
    *,
    message: str = "",
    secret: str = "",
    status: int = 200,
) -> HTMLResponse:
    now = deps.now
    own_tokens = deps.store.api_tokens.all(current_user.user)
    return deps.renderer.page(
        request,
        "account_page.html",
        status=status,
        here="account",
        open_alerts=deps.open_alerts(),
        user=_user(deps, current_user),
        sessions=sessions_of(deps.store, current_user.user, now),
        tokens=[token for token in own_tokens if token.is_open(now)],
        scopes=scopes_of(current_user.role),
        lifetimes=LIFETIMES_DAYS,
        by_proxy=current_user.signed_in_by == HOW,
        said=message,
        secret=secret,
        shortest=SHORTEST,
        longest=LONGEST,
    )


def _user(deps: Dependencies, current_user: CurrentUser) -> User:
    user = deps.store.accounts.get(current_user.user)
    if user is None:
        raise HTTPException(404, "There is no such user any more.")
    return user
