"""The address of a connection's other end, stored before proxies' headers are applied.

``X-Forwarded-For`` of a trusted proxy replaces the client's address; whether the connection itself
came from that proxy can then no longer be told from the client.
"""

from __future__ import annotations

from starlette.types import ASGIApp, Receive, Scope, Send

_KEY = "stemwatch.peer"


def keeping_peer(app: ASGIApp) -> ASGIApp:
    """``app``, told of each request from which address its connection came."""

    async def with_peer(scope: Scope, receive: Receive, send: Send) -> None:
        client = scope.get("client")
        scope[_KEY] = str(client[0]) if client else ""
        await app(scope, receive, send)

    return with_peer


def peer_of(scope: Scope) -> str:
    """The address of the connection; empty where the server did not keep it."""
    return str(scope.get(_KEY, ""))
