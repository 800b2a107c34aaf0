"""What an archive behind HTTP answers in the tests: JSON on loopback, and only to who reads."""

from __future__ import annotations

import json
import sys
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, ClassVar, Protocol, TypeVar


class Asked(Protocol):
    """What a server notes of its requests, and where it is."""

    methods: set[str]
    url: str


AnyServed = TypeVar("AnyServed", bound=Asked)


class ReadOnlyJson(BaseHTTPRequestHandler):
    """Refuses what writes and remembers that it was tried; reading is for the archive itself."""

    served: Any
    refusal: ClassVar[Mapping[str, Any]]  # the body of an answer to what writes
    protocol_version = "HTTP/1.1"

    def do_POST(self) -> None:
        """Anything that writes."""
        self.served.methods.add(self.command)
        self.answer(405, self.refusal)

    do_PUT = do_PATCH = do_DELETE = do_POST

    def answer(self, status: int, body: Any, headers: Mapping[str, str] | None = None) -> None:
        """Send ``body``: as it is where it is bytes, else as JSON."""
        data = body if isinstance(body, bytes) else json.dumps(body).encode()
        self.send_response(status)
        for name, content in (headers or {}).items():
            self.send_header(name, content)
        self.send_header("Content-Type", "application/json; charset=utf-8")
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)

    def log_message(self, format: str, *args: Any) -> None:
        """Nothing: the tests read what ``served`` was asked."""


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A reader that hangs up, as one does that has enough of a hostile answer, is no error."""
        if not isinstance(sys.exc_info()[1], ConnectionError):
            super().handle_error(request, client_address)


@contextmanager
def on_loopback(
    served: AnyServed, handler: type[ReadOnlyJson], path: str = ""
) -> Iterator[AnyServed]:
    """``handler`` with ``served`` behind ``path`` of a free port, until the block ends."""
    one_server = type("OneServer", (handler,), {"served": served})
    with _Server(("127.0.0.1", 0), one_server) as server:
        threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
        served.url = f"http://127.0.0.1:{server.server_address[1]}{path}"
        try:
            yield served
        finally:
            server.shutdown()
