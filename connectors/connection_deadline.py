"""A time limit for a whole exchange on a connection, however slowly the other side answers."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress


@contextmanager
def close_after(
    seconds: float, link: Callable[[], socket.socket | None]
) -> Iterator[threading.Event]:
    """Shut down the socket ``link()`` when the block takes longer, and set the event.

    A server that sends a byte now and then would otherwise hold the connection for hours, whatever
    the time-out of each read; and some libraries have no time-out at all.
    """
    was_cut = threading.Event()

    def cut() -> None:
        was_cut.set()
        with suppress(OSError):
            if (open_link := link()) is not None:
                # Not the method of the TLS socket, which would discard its state while another
                # thread reads.
                socket.socket.shutdown(open_link, socket.SHUT_RDWR)

    ending = threading.Timer(seconds, cut)
    ending.daemon = True
    ending.start()
    try:
        yield was_cut
    finally:
        ending.cancel()
