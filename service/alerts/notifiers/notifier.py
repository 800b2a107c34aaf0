"""The seam to every way of telling somebody."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from stemwatch.connectors.connector import ConnectorError
from stemwatch.connectors.secret import Secret

if TYPE_CHECKING:
    from stemwatch.service.config.service_schema import NotifierTable


class NotSent(Exception):
    """The message did not arrive; the text says why, without secrets.

    ``final``: it never will, however often it is tried.
    """

    def __init__(self, why: str, *, final: bool = False) -> None:
        super().__init__(why)
        self.final = final


class Notifier(Protocol):
    """Takes messages away.

    ``send`` returns when the receiver has taken the message and raises otherwise, at the latest
    after half a minute. The same ``key`` may come twice, after a crash between sending and noting
    it: it has to reach the receiver in a form by which the second one can be told. ``message``
    has ``subject``, ``text`` and ``alerts`` (see ``digest.message_of``), all of it from the plant
    and therefore never to be trusted as anything but text.
    """

    def send(self, key: str, message: Mapping[str, Any]) -> None:
        """Bring ``message`` to its receiver; raises ``NotSent`` where it did not arrive."""
        ...


class NotifierKind(Protocol):
    """What an entry point of ``stemwatch.notifiers`` leads to: usually the notifier's class."""

    def from_table(self, table: NotifierTable, secret: Secret, folder: Path) -> Notifier:
        """The notifier that a ``[[notifiers]]`` of a plant file in ``folder`` describes. A kind of
        another package finds its own keys in ``table.options``."""
        ...


def revealed(secret: Secret) -> str | None:
    """The secret, or ``None`` where none is asked for. It is read anew each time, so that a changed
    one needs no restart. Raises ``NotSent`` where it is not where it should be."""
    try:
        return secret.reveal() if secret else None
    except ConnectorError as error:
        raise NotSent(str(error)) from None


@contextmanager
def cut_off_after(seconds: float, link: Callable[[], socket.socket | None]) -> Iterator[None]:
    """End what is said on ``link()`` when the block takes longer: a receiver that sends a byte now
    and then would hold the line for hours, whatever the time-out of each read is."""

    def cut() -> None:
        with suppress(OSError):
            if (open_link := link()) is not None:
                # Not the method of an encrypted socket, which takes its state away under a reader.
                socket.socket.shutdown(open_link, socket.SHUT_RDWR)

    ending = threading.Timer(seconds, cut)
    ending.start()
    try:
        yield
    finally:
        ending.cancel()
