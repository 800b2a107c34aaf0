"""The cookies of a session and of a known browser: no script can read them, no page of another site
can send them, and with TLS they are never sent in clear text."""

from __future__ import annotations

from starlette.requests import Request
from starlette.responses import Response
from starlette.types import Scope

from stemwatch.service.access.known_browser import KNOWN_FOR
from stemwatch.service.web.path_prefix import root_of

NAME = "stemwatch_session"
BROWSER_NAME = "stemwatch_browser"
# Browsers take a name with this prefix only over TLS and from this machine itself.
SECURE_NAME = f"__Host-{NAME}"


def is_secure(scope: Scope) -> bool:
    """Whether the request came over TLS, at the latest to a proxy on this machine."""
    return scope.get("scheme") == "https"


def cookie_name(scope: Scope) -> str:
    """The name that the cookie has for this request."""
    return SECURE_NAME if is_secure(scope) else NAME


def set_session(response: Response, secret: str, scope: Scope) -> None:
    """Give the browser its session; it ends with the browser, and earlier at the server.

    ``lax``, so that a link in a mail leads to its page without a second login; whatever changes
    something is a POST, with which it is not sent from elsewhere.
    """
    response.set_cookie(
        cookie_name(scope),
        secret,
        httponly=True,
        samesite="lax",
        secure=is_secure(scope),
        path="/",
    )


def known_browser_of(request: Request) -> str:
    """The value of the ``known_browser`` cookie, which is sent to the login page only."""
    return request.cookies.get(BROWSER_NAME, "")


def set_known_browser(response: Response, value: str, scope: Scope) -> None:
    """Set the known-browser cookie; with ``lax`` and this path it is sent to the login page
    only."""
    response.set_cookie(
        BROWSER_NAME,
        value,
        max_age=int(KNOWN_FOR.total_seconds()),
        httponly=True,
        samesite="lax",
        secure=is_secure(scope),
        path=f"{root_of(scope)}/login",
    )


def drop_session(response: Response, scope: Scope) -> None:
    """Take the session from the browser."""
    response.delete_cookie(
        cookie_name(scope), httponly=True, samesite="lax", secure=is_secure(scope), path="/"
    )
