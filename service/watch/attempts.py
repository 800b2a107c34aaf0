"""``Attempts``: how often a file was begun and not ended, noted where a crash does not lose it.

A file that brings the process down is still there when the process is back, and would bring it down
again, for ever.
"""

from __future__ import annotations

import json
import os
from pathlib import Path

NAME = ".stemwatch-attempts.json"


class Attempts:
    """The attempts at files of one folder, by the files' digests."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / NAME

    def unfinished(self, digest: str) -> int:
        """How often the file was begun and not ended."""
        return self._read().get(digest, 0)

    def begin(self, digest: str) -> None:
        """Note one more attempt, on disk, before it is made."""
        noted = self._read()
        noted[digest] = noted.get(digest, 0) + 1
        self._write(noted)

    def end(self, digest: str) -> None:
        """Whatever came of it, it came to an end."""
        noted = self._read()
        if noted.pop(digest, None) is not None:
            self._write(noted)

    def _read(self) -> dict[str, int]:
        try:
            found = json.loads(self._path.read_text(encoding="utf-8"))
            return {str(digest): int(count) for digest, count in found.items()}
        except (OSError, ValueError, TypeError, AttributeError):
            return {}  # not there, or damaged: nothing is known of any file

    def _write(self, noted: dict[str, int]) -> None:
        new = self._path.with_suffix(".new")
        with new.open("w", encoding="utf-8") as file:
            json.dump(noted, file)
            file.flush()
            os.fsync(file.fileno())
        os.replace(new, self._path)
