"""``SecurityMiddleware``: what is checked of every request before its route, and which headers
every answer carries.

Host name, origin, length of the body, user and permission; then the headers that tell the browser
what the page may do. It is one ASGI layer, so that a page added later cannot be without it.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Sequence
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import PlainTextResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from stemwatch.service.web.auth.authentication import SAFE, Authentication
from stemwatch.service.web.path_prefix import own_path

log = logging.getLogger(__name__)

LARGEST_BODY = 64 * 1024
MOST_DIGITS = 18  # of a length: Python refuses to read a number of thousands
TOO_LONG = f"A body of known length, at most {LARGEST_BODY} bytes, is expected."
AMBIGUOUS = (
    "This request gives the length of its body twice, by Content-Length and by Transfer-Encoding. "
    "Exactly one Content-Length is expected."
)

# A name or an address, and a port. Links are built from it, and in "a:1@b" the host is b.
_HOST = re.compile(r"(?P<name>\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9._-]+)(?::[0-9]{1,5})?")

# Style sheets come from files; style attributes hold only lengths of bars, computed here.
POLICY = (
    "default-src 'none'; script-src 'self'; style-src-elem 'self'; "
    "style-src-attr 'unsafe-inline'; img-src 'self' data:; connect-src 'self'; "
    "form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
)
HEADERS = {
    "content-security-policy": POLICY,
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "permissions-policy": "camera=(), microphone=(), geolocation=()",
}


class SecurityMiddleware:
    """Refuses foreign hosts, foreign origins, long bodies and users who lack the permission.

    Every answer gets the headers.

    ``hosts`` are the names under which a browser may ask, without port, ``*`` for any: a page on
    the network whose name was made to point at this machine is not among them.
    ``authentication`` knows who may do what. What fails unforeseen is logged and answered by
    ``failed``, here and not further out, so that this answer has the headers too.
    """

    def __init__(
        self,
        app: ASGIApp,
        *,
        hosts: Sequence[str],
        authentication: Authentication,
        failed: Callable[[Request], Response],
    ) -> None:
        self._app = app
        self._authentication = authentication
        self._failed = failed
        self._hosts = frozenset(host.casefold() for host in hosts)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer with a refusal, or pass on with the headers added to what comes back."""
        if scope["type"] == "lifespan":
            await self._app(scope, receive, send)
            return
        if scope["type"] != "http":
            return  # nothing here speaks another protocol: the server closes it

        begun = False

        async def with_headers(message: Message) -> None:
            nonlocal begun
            if message["type"] == "http.response.start":
                begun = True
                await self._authentication.note(scope, message["status"])
                headers = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    headers.setdefault(name, value)
                if not own_path(scope).startswith("/static/"):
                    headers.setdefault("cache-control", "no-store")
            await send(message)

        try:
            refusal = self._refusal(scope) or await self._authentication.admit(scope)
            await (refusal or self._app)(scope, _limited_body(receive), with_headers)
        except ClientDisconnect:
            log.info("%s %s: the client went away", scope["method"], scope["path"])
        except Exception:
            log.exception("%s %s failed", scope["method"], scope["path"])
            if begun:
                raise  # part of the answer was sent: the server must close the connection
            await self._failed(Request(scope))(scope, receive, with_headers)

    def _refusal(self, scope: Scope) -> PlainTextResponse | None:
        headers = Headers(scope=scope)
        if not self._knows(headers.get("host", "")):
            text = (
                f"This service does not answer to the name {headers.get('host', '')!r}. Ask it "
                "under a name it was started with, or add this one where it is started."
            )
            return PlainTextResponse(text, 421)
        if "transfer-encoding" in headers:  # its length is known only when all of it is here
            ambiguous_length = "content-length" in headers
            return PlainTextResponse(
                AMBIGUOUS if ambiguous_length else TOO_LONG, 400 if ambiguous_length else 411
            )
        return None if scope["method"] in SAFE else _unsafe_refusal(headers)

    def _knows(self, host: str) -> bool:
        host_match = _HOST.fullmatch(host)
        return host_match is not None and (
            "*" in self._hosts or host_match["name"].casefold() in self._hosts
        )


def _unsafe_refusal(headers: Headers) -> PlainTextResponse | None:
    """A request that changes something must come from a page of ours, or from no page at all."""
    site = headers.get("sec-fetch-site", "same-origin")
    origin = headers.get("origin")
    foreign = origin is not None and not _is_of(origin, headers.get("host"))
    if foreign or site not in ("same-origin", "none"):
        return PlainTextResponse("This request came from another site's page.", 403)
    length = headers.get("content-length", "")
    is_number = length.isascii() and length.isdigit()  # a digit elsewhere, such as ², is none here
    if not is_number or len(length) > MOST_DIGITS or int(length) > LARGEST_BODY:
        return PlainTextResponse(TOO_LONG, 413 if is_number else 411)
    return None


def _is_of(origin: str, host: str | None) -> bool:
    """Whether an Origin names ``host``; what is no address names nobody."""
    try:
        return urlsplit(origin).netloc == host
    except ValueError:
        return False


def _limited_body(receive: Receive) -> Receive:
    """``receive`` with a limit: a body that is too long is ended while it arrives, whatever its
    headers say."""
    taken = 0

    async def count() -> Message:
        nonlocal taken
        message = await receive()
        taken += len(message.get("body", b""))
        if taken > LARGEST_BODY:
            raise HTTPException(413, TOO_LONG)
        return message

    return count
