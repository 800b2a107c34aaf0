"""The HTTP server of the pages, hardened against clients that hold connections open.

A client may open connections and send nothing, send a request byte by byte, or not read the answer.
Each connection costs a file descriptor, which collection and runs need as well. Therefore a request
must arrive and an answer must be read within a bounded time, and connections of the pages use at
most half of the descriptors that the process may open.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Sequence
from typing import Any

import h11
import uvicorn
from uvicorn.middleware.proxy_headers import ProxyHeadersMiddleware
from uvicorn.protocols.http.h11_impl import H11Protocol

from stemwatch.service.logs import OnceAMinute
from stemwatch.service.web.auth.proxy_user import keeping_peer

log = logging.getLogger(__name__)

HEADER_S = 10.0  # from the connection, or from the answer before, to the end of the headers
BODY_S = 30.0  # from the headers to the end of the body, at most 64 KiB
ANSWER_S = 60.0  # for the next ``ANSWER_BYTES`` of an answer, or for the rest of it
ANSWER_BYTES = 60_000
MOST_CONNECTIONS = 256
END_S = 5  # how long the server waits for pending answers when it ends

_TOO_SLOW = b"HTTP/1.1 408 Request Timeout\r\nConnection: close\r\nContent-Length: 0\r\n\r\n"
_FULL = (
    b"HTTP/1.1 503 Service Unavailable\r\nConnection: close\r\nRetry-After: 5\r\n"
    b"Content-Length: 0\r\n\r\n"
)


def connection_limit() -> int:
    """How many connections are open at most: a quarter of the descriptors that this process may
    open, 256 at most. As many again may be accepted before the first of them is closed."""
    try:
        import resource
    except ImportError:  # Windows, where sockets are not counted with files
        return MOST_CONNECTIONS
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft == resource.RLIM_INFINITY:
        return MOST_CONNECTIONS
    return max(8, min(MOST_CONNECTIONS, soft // 4))


def http_server(app: Any, *, lifespan: bool = True, proxies: Sequence[str] = ()) -> uvicorn.Server:
    """A server for ``app`` (ASGI 3) with these limits; the caller passes its sockets to ``run``.

    The headers X-Forwarded-For and X-Forwarded-Proto are trusted only from ``proxies``, since any
    other client could forge them.
    """
    limit = connection_limit()
    for name in ("uvicorn.error", "asyncio", __name__):
        logging.getLogger(name).addFilter(_ONCE_A_MINUTE)
    if proxies:
        app = ProxyHeadersMiddleware(app, trusted_hosts=list(proxies))
    config = uvicorn.Config(
        keeping_peer(app),
        http=_protocol_with(limit),
        ws="none",
        log_config=None,
        access_log=False,
        server_header=False,
        proxy_headers=False,  # done above, after the connection's own address was stored
        lifespan="auto" if lifespan else "off",
        backlog=limit // 2,  # so many are accepted in one go
        timeout_graceful_shutdown=END_S,
    )
    return uvicorn.Server(config)


_ONCE_A_MINUTE = OnceAMinute()


def _protocol_with(limit: int) -> type[BoundedConnection]:
    return type("BoundedConnection", (BoundedConnection,), {"most": limit})


class BoundedConnection(H11Protocol):
    """One connection with time limits for its client."""

    most = MOST_CONNECTIONS

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._awaited: str | None = None  # "header" or "body" of a request
        self._deadline: asyncio.TimerHandle | None = None
        self._stalled: asyncio.TimerHandle | None = None
        self._unread = 0  # bytes in the write buffer when it was last checked
        self._since = 0.0

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Accept the connection; at the limit close the one that has waited longest."""
        super().connection_made(transport)
        transport.set_write_buffer_limits(high=0)  # be told of every byte that waits
        self._since = self.loop.time()
        self._wait_for("header", HEADER_S)
        if len(self.connections) > self.most:
            self._make_room()

    def data_received(self, data: bytes) -> None:
        """Read, and set the deadline for the rest of the request."""
        super().data_received(data)
        if self.conn.their_state is h11.IDLE:
            self._wait_for("header", HEADER_S)
        elif self.conn.their_state is h11.SEND_BODY:
            self._wait_for("body", BODY_S)
        else:
            self._since = self.loop.time()
            self._wait_for(None, 0.0)

    def connection_lost(self, exc: Exception | None) -> None:
        """Cancel the deadlines."""
        self._wait_for(None, 0.0)
        self._until_read(None)
        super().connection_lost(exc)

    def pause_writing(self) -> None:
        """The client is not reading: set a deadline."""
        super().pause_writing()
        self._unread = self.transport.get_write_buffer_size()
        self._until_read(self.loop.call_later(ANSWER_S, self._look_at_reader))

    def resume_writing(self) -> None:
        """The client has read everything: cancel the deadline."""
        self._until_read(None)
        super().resume_writing()

    @property
    def waits(self) -> bool:
        """Whether no complete request has arrived, so that nothing is being worked on."""
        return self.conn.their_state in (h11.IDLE, h11.SEND_BODY)

    def _wait_for(self, phase: str | None, seconds: float) -> None:
        if phase == self._awaited:
            return  # further bytes of the same phase do not extend the deadline
        if self._deadline is not None:
            self._deadline.cancel()
        self._awaited = phase
        self._deadline = None if phase is None else self.loop.call_later(seconds, self._give_up)

    def _until_read(self, timer: asyncio.TimerHandle | None) -> None:
        if self._stalled is not None:
            self._stalled.cancel()
        self._stalled = timer

    def _look_at_reader(self) -> None:
        before, self._unread = self._unread, self.transport.get_write_buffer_size()
        if self._unread > before - ANSWER_BYTES:
            log.warning("a connection is closed: its reader did not take the answer in time")
            self.transport.abort()
        else:
            self._until_read(self.loop.call_later(ANSWER_S, self._look_at_reader))

    def _give_up(self) -> None:
        log.warning("a connection is closed: its %s did not come in time", self._awaited)
        self._close_with(_TOO_SLOW)

    def _make_room(self) -> None:
        """Close the connection that has waited longest for a request; this one where none waits."""
        log.warning(
            "%d connections are open, the most that pages may have; the one that has waited "
            "longest for a request is closed for each new one",
            self.most,
        )
        waiting = [
            connection
            for connection in self.connections
            if isinstance(connection, BoundedConnection)
            and connection is not self
            and connection.waits
        ]
        if not waiting:
            self._close_with(_FULL)
            return
        min(waiting, key=lambda connection: connection._since)._close_with(_FULL)

    def _close_with(self, answer: bytes) -> None:
        """Close; with ``answer`` where no request is being answered."""
        if self.cycle is None:
            self.transport.write(answer)
        self.connections.discard(self)
        self.transport.close()
