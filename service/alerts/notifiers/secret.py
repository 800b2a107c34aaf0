"""``NotifierSecret``: a password that stands in the environment or in a file, and nowhere else."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from stemwatch.service.alerts.notifiers.notifier import NotSent


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
