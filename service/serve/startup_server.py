"""``StartupServer``: answers HTTP while the database is not available yet or is being upgraded.

``/health`` answers that the process is alive, everything else 503 with the reason, until the store
is open and the pages take over.
"""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Awaitable, Callable, MutableMapping
from types import TracebackType
from typing import Any, Self

from stemwatch.service import __version__

REASON = "the database does not answer yet, or its tables are being brought up to date"
_END_S = 10

_Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]


class StartupServer:
    """Answers on ``listening`` during a ``with`` block; the socket stays open afterwards."""

    def __init__(self, listening: socket.socket) -> None:
        from stemwatch.service.serve.http_server import http_server

        self._server = http_server(_answer, lifespan=False)
        self._own = listening.dup()  # the server closes its socket
        self._thread = threading.Thread(target=self._run, name="startup server")

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._server.should_exit = True
        self._thread.join(timeout=_END_S)

    def _run(self) -> None:
        self._server.run(sockets=[self._own])


async def _answer(scope: MutableMapping[str, Any], receive: object, send: _Send) -> None:
    """200 for ``/health``, 503 with the reason for everything else."""
    if scope["type"] != "http":
        return
    alive = scope["path"] == "/health"
    checks = [] if alive else [{"name": "database", "ok": False, "says": REASON}]
    body = {"ok": alive, "version": __version__, "checks": checks}
    headers = [
        (b"content-type", b"application/json"),
        (b"cache-control", b"no-store"),
        (b"x-content-type-options", b"nosniff"),
        (b"connection", b"close"),
    ]
    if not alive:
        headers.append((b"retry-after", b"5"))
    status = 200 if alive else 503
    await send({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": json.dumps(body).encode()})
