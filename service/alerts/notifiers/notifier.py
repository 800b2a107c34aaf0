"""The seam to every way of telling somebody."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

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

    def from_table(self, table: NotifierTable, secret: NotifierSecret, folder: Path) -> Notifier:
        """The notifier that a ``[[notifiers]]`` of a plant file in ``folder`` describes. A kind of
        another package finds its own keys in ``table.options``."""
        ...


@dataclass(frozen=True, kw_only=True)
class NotifierSecret:
    """Where a secret is. It is read anew each time, so that a changed one needs no restart."""

    variable: str | None = None
    file: Path | None = None

    def read(self) -> str | None:
        """The secret, or ``None`` where none is asked for. Raises ``NotSent`` where it is not
        where it should be."""
        if self.variable is not None:
            found = os.environ.get(self.variable)
            if not found:
                raise NotSent(f"the environment variable {self.variable} is not set")
            return found
        if self.file is not None:
            try:
                return self.file.read_text(encoding="utf-8").strip()
            except (OSError, UnicodeDecodeError) as error:
                why = error.strerror if isinstance(error, OSError) else "it is not UTF-8"
                raise NotSent(f"the secret file {self.file} cannot be read: {why}") from None
        return None
