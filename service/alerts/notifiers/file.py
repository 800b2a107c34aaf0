"""A file to which each message is appended as one line of JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

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
            with self.path.open("a", encoding="utf-8", errors="replace") as file:
                file.write(line)
        except OSError as error:
            raise NotSent(f"{self.path}: {error.strerror}") from None
