"""A time limit for all that is exchanged on a connection, however slowly the other side answers."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress


@contextmanager
def close_after(
    seconds: float, link: Callable[[], socket.socket | None]
) -> Iterator[threading.Event]:
    """End what is said on ``link()`` when the block takes longer, and set the event.

    One that sends a byte now and then would hold the line for hours, whatever the time-out of each
    read is; and some libraries have none.
    """
    was_cut = threading.Event()

    def cut() -> None:
        was_cut.set()
        with suppress(OSError):
            if (open_link := link()) is not None:
                # Not the method of an encrypted socket, which takes its state away under a reader.
                socket.socket.shutdown(open_link, socket.SHUT_RDWR)

    ending = threading.Timer(seconds, cut)
    ending.daemon = True
    ending.start()
    try:
        yield was_cut
    finally:
        ending.cancel()
