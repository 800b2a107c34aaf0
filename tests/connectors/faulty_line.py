"""``FaultyLine``: a connection to a server that breaks or falls silent after so many bytes."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

_PIECE = 512


class FaultyLine:
    """Passes on what both sides say. After ``most`` bytes of the server it is ``cut``, or
    ``silent`` with the connection open, or ``garbled``: the bytes after that are others; or they
    come as ``drops``, one by one with half a second between."""

    def __init__(self, server: int | str, fault: str = "", most: int = 0) -> None:
        self._server, self.fault, self._left = server, fault, most
        self.over = threading.Event()
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port = self._listening.getsockname()[1]
        self._threads = [threading.Thread(target=self._serve, daemon=True)]
        self._threads[0].start()

    def end(self) -> None:
        """Cut whatever is connected, and take no more."""
        self.over.set()
        with suppress(OSError):
            self._listening.shutdown(socket.SHUT_RDWR)
        self._listening.close()
        for thread in self._threads:
            thread.join(timeout=20)

    def _serve(self) -> None:
        while not self.over.is_set():
            try:
                near, _ = self._listening.accept()
            except OSError:
                return
            far = self._reach()
            for source, target, limited in ((near, far, False), (far, near, True)):
                source.settimeout(0.2)
                thread = threading.Thread(
                    target=self._pass_on, args=(source, target, limited), daemon=True
                )
                self._threads.append(thread)
                thread.start()

    def _reach(self) -> socket.socket:
        if isinstance(self._server, int):
            return socket.create_connection(("127.0.0.1", self._server))
        far = socket.socket(socket.AF_UNIX)
        far.connect(self._server)
        return far

    def _pass_on(self, source: socket.socket, target: socket.socket, limited: bool) -> None:
        with source, suppress(OSError):
            while not self.over.is_set():
                try:
                    data = source.recv(_PIECE)
                except TimeoutError:
                    continue
                if not data:
                    break
                if limited and self.fault:
                    self._left -= len(data)
                    if self._left < 0 and self.fault == "silent":
                        self.over.wait(120)
                        break
                    if self._left < 0 and self.fault == "cut":
                        break
                    if self._left < 0 and self.fault == "garbled":
                        data = bytes(byte ^ 0x55 for byte in data)
                    if self._left < 0 and self.fault == "drops":
                        self._drip(data, target)
                        continue
                target.sendall(data)
            target.shutdown(socket.SHUT_RDWR)

    def _drip(self, data: bytes, target: socket.socket) -> None:
        for byte in data:
            target.sendall(bytes([byte]))
            if self.over.wait(0.5):
                return


@contextmanager
def faulty_line(server: int | str, fault: str = "", most: int = 0) -> Iterator[FaultyLine]:
    """A line to the server at a port of this machine, or at the path of a socket."""
    line = FaultyLine(server, fault, most)
    try:
        yield line
    finally:
        line.end()
