"""What stands before every page: who may ask, from where, and what the browser may do with it.

One plain ASGI layer, so that a page added later cannot forget it.
"""

from __future__ import annotations

import base64
import binascii
import hmac
import logging
from collections.abc import Callable, Sequence
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

log = logging.getLogger(__name__)

SAFE = ("GET", "HEAD", "OPTIONS")
OPEN_PATHS = ("/healthz",)  # answers without a token, and says nothing but whether it works
LARGEST_BODY = 64 * 1024

# Styles of elements come from files; attributes hold the lengths of bars, worked out by us.
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


class Guard:
    """Refuses foreign hosts, foreign origins, wrong tokens and long bodies; adds the headers.

    ``hosts`` are the names under which a browser may ask, without port, ``*`` for any: a page on
    the network whose name was made to point at this machine is not among them. ``token`` is asked
    of every request where it is not empty, as ``Authorization: Bearer`` or as the password of
    ``Basic``, whatever the user's name. What fails unforeseen is logged and answered by
    ``failed``, here and not further out, so that this answer has the headers too.
    """

    def __init__(
        self,
        app: ASGIApp,
        *,
        hosts: Sequence[str],
        token: str,
        failed: Callable[[Request], Response],
    ) -> None:
        self._app = app
        self._failed = failed
        self._hosts = frozenset(host.casefold() for host in hosts)
        self._token = token.encode()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer with a refusal, or pass on with the headers added to what comes back."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        begun = False

        async def with_headers(message: Message) -> None:
            nonlocal begun
            if message["type"] == "http.response.start":
                begun = True
                headers = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    headers.setdefault(name, value)
                if not scope["path"].startswith("/static/"):
                    headers.setdefault("cache-control", "no-store")
            await send(message)

        refusal = self._refusal(scope, Headers(scope=scope))
        try:
            await (refusal or self._app)(scope, receive, with_headers)
        except Exception:
            log.exception("%s %s failed", scope["method"], scope["path"])
            if begun:
                raise  # half an answer was sent: the server must cut it off
            await self._failed(Request(scope))(scope, receive, with_headers)

    def _refusal(self, scope: Scope, headers: Headers) -> PlainTextResponse | None:
        if not self._knows(headers.get("host", "")):
            text = (
                f"This service does not answer to the name {headers.get('host', '')!r}. Ask it "
                "under a name it was started with, or add this one where it is started."
            )
            return PlainTextResponse(text, 421)
        if self._token and scope["path"] not in OPEN_PATHS and not self._may(headers):
            challenge = {"www-authenticate": 'Basic realm="stemwatch", charset="UTF-8"'}
            return PlainTextResponse("A token is needed to read this.", 401, challenge)
        if scope["method"] not in SAFE:
            return _unsafe_refusal(headers)
        return None

    def _knows(self, host: str) -> bool:
        name = host.rsplit(":", 1)[0] if not host.endswith("]") else host
        return "*" in self._hosts or name.casefold() in self._hosts

    def _may(self, headers: Headers) -> bool:
        given = _credentials(headers.get("authorization", ""))
        return hmac.compare_digest(given, self._token)


def _credentials(authorization: str) -> bytes:
    """The token in an ``Authorization`` header; empty where there is none."""
    scheme, _, rest = authorization.partition(" ")
    if scheme.casefold() == "bearer":
        return rest.strip().encode()
    if scheme.casefold() == "basic":
        try:
            _, _, password = base64.b64decode(rest, validate=True).partition(b":")
        except (binascii.Error, ValueError):
            return b""
        return password
    return b""


def _unsafe_refusal(headers: Headers) -> PlainTextResponse | None:
    """A request that changes something must come from a page of ours, or from no page at all."""
    site = headers.get("sec-fetch-site", "same-origin")
    origin = headers.get("origin")
    foreign = origin is not None and urlsplit(origin).netloc != headers.get("host")
    if foreign or site not in ("same-origin", "none"):
        return PlainTextResponse("This request came from another site's page.", 403)
    length = headers.get("content-length", "")
    if not length.isdigit() or int(length) > LARGEST_BODY:
        text = f"A body of known length, at most {LARGEST_BODY} bytes, is expected."
        return PlainTextResponse(text, 413 if length.isdigit() else 411)
    return None
