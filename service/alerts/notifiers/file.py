"""A file to which each message is appended as one line of JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from os import SEEK_END
from pathlib import Path
from typing import Any, BinaryIO, Self

from stemwatch.connectors.secret import Secret
from stemwatch.service.alerts.notifiers.notifier import NotSent
from stemwatch.service.config.service_schema import NotifierTable


@dataclass(frozen=True)
class FileNotifier:
    """Appends to ``path``; for whatever follows a log."""

    path: Path

    @classmethod
    def from_table(cls, table: NotifierTable, secret: Secret, folder: Path) -> Self:
        """``path`` of the table, beside the plant file."""
        return cls(folder / (table.path or ""))

    def send(self, key: str, message: Mapping[str, Any]) -> None:
        """Append the message with its key."""
        line = json.dumps({"key": key, **message}, ensure_ascii=False) + "\n"
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with self.path.open("ab+") as file:
                file.write(_line_end_missing(file) + line.encode("utf-8", errors="replace"))
        except OSError as error:
            raise NotSent(f"{self.path}: {error.strerror}") from None


def _line_end_missing(file: BinaryIO) -> bytes:
    """A line end where the last line has none, since a kill or a full disk cut it: the next message
    would be lost with it."""
    if file.seek(0, SEEK_END) == 0:
        return b""
    file.seek(-1, SEEK_END)
    return b"" if file.read(1) == b"\n" else b"\n"
