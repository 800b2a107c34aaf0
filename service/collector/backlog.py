"""What waits in a spool, seen from another process that only reads its folder."""

from __future__ import annotations

import json
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from stemwatch.service.collector.batch_format import HEAD_BYTES, records

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_CURSOR = "cursor"
_SUFFIX = ".spool"
_FIRST_BYTES = 256 * 1024  # enough for the record of a poll of some thousand tags


@dataclass(frozen=True, kw_only=True)
class Backlog:
    """What the store does not have yet: ``size_bytes`` in the spool, ``oldest`` the instant of its
    first sample (``None`` where nothing waits), ``lost_samples`` dropped since the spool began."""

    size_bytes: int = 0
    oldest: datetime | None = None
    lost_samples: int = 0

    def age_s(self, now: datetime) -> float:
        """Seconds that the oldest sample has waited; 0 where none waits."""
        return 0.0 if self.oldest is None else max(0.0, (now - self.oldest).total_seconds())


def backlog(folder: Path) -> Backlog:
    """The backlog of the spool in ``folder``; an empty one where there is no spool.

    Nothing is locked: a file that the collector removes meanwhile counts as taken.
    """
    segment, offset, lost = _cursor(folder)
    size_bytes, oldest = 0, None
    for number, path in _segments(folder):
        if number < segment:
            continue
        start = offset if number == segment else 0
        try:
            waiting = path.stat().st_size - start
            if waiting < HEAD_BYTES:
                continue
            oldest = oldest or _first_instant(path, start)
        except OSError:
            continue
        size_bytes += waiting
    return Backlog(size_bytes=size_bytes, oldest=oldest, lost_samples=lost)


def _cursor(folder: Path) -> tuple[int, int, int]:
    """Up to where the store has it (file, byte), and how many samples were dropped."""
    try:
        found = json.loads((folder / _CURSOR).read_bytes())
        return int(found["segment"]), int(found["offset"]), int(found["lost"])
    except (OSError, ValueError, KeyError, TypeError):
        return 0, 0, 0


def _segments(folder: Path) -> list[tuple[int, Path]]:
    paths = [path for path in folder.glob(f"*{_SUFFIX}") if path.stem.isdigit()]
    return sorted((int(path.stem), path) for path in paths)


def _first_instant(path: Path, start: int) -> datetime | None:
    """The instant of the first whole record's first sample from byte ``start`` on."""
    with path.open("rb") as file:
        file.seek(start)
        data = file.read(_FIRST_BYTES)
    for found in records(data):
        if found.samples:
            return _EPOCH + timedelta(microseconds=int(found.batch.at_us.min()))
    return None
