"""The cookie of a session: no script reads it, no foreign page sends it, and with TLS it never
travels without."""

from __future__ import annotations

from starlette.responses import Response
from starlette.types import Scope

NAME = "stemwatch_session"
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


def drop_session(response: Response, scope: Scope) -> None:
    """Take the session from the browser."""
    response.delete_cookie(
        cookie_name(scope), httponly=True, samesite="lax", secure=is_secure(scope), path="/"
    )
