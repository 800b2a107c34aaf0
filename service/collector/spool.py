"""``Spool``: a queue of samples on disk between polling and the store, safe across crashes.

A folder of files ``0000000001.spool`` and so on, to which records (``batch_format``) are appended,
and a file ``cursor`` with the position up to which everything is stored and the stretches of time
that were polled. Appended records survive SIGKILL of the process; with ``sync`` they survive a
power failure as well, at the cost of waiting for the disk at each append.
"""

from __future__ import annotations

import json
import logging
import os
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from stemwatch.connectors.modbus.sample_batch import SampleBatch
from stemwatch.service.collector.batch_format import HEAD_BYTES, pack, records
from stemwatch.service.collector.lock import FolderLock
from stemwatch.service.collector.polled_times import PolledTimes

log = logging.getLogger(__name__)

SEGMENT_BYTES = 8 * 1024 * 1024
DEFAULT_LIMIT_BYTES = 2 * 1024 * 1024 * 1024
_SUFFIX = ".spool"
_CURSOR = "cursor"

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_FIRST_BYTES = 256 * 1024  # enough for the record of a poll of some thousand tags


class SpoolError(Exception):
    """The spool cannot be used; the text says why and what to do."""


@dataclass(frozen=True, order=True)
class Position:
    """A position in the spool: the number of a file and a byte in it."""

    segment: int = 0
    offset: int = 0


@dataclass(frozen=True)
class Waiting:
    """A batch that is not stored yet, and the position of the next one."""

    batch: SampleBatch
    next: Position


class Spool:
    """Keeps batches until they are acknowledged, oldest first. For one writing and one reading
    thread of one process; a second process on the same folder is refused.

    ``limit_bytes`` bounds the folder: when it is full the oldest file is deleted; ``lost_samples``
    and an error in the log count the samples in it that had not been stored. Raises ``SpoolError``
    where the folder cannot be used.
    """

    def __init__(
        self,
        folder: Path,
        *,
        limit_bytes: int = DEFAULT_LIMIT_BYTES,
        segment_bytes: int = SEGMENT_BYTES,
        sync: bool = False,
    ) -> None:
        if limit_bytes < 2 * segment_bytes:
            raise ValueError(f"limit_bytes must hold two files of {segment_bytes} bytes")
        self.folder = Path(folder)
        self.limit_bytes, self.segment_bytes, self.sync = limit_bytes, segment_bytes, sync
        self.lost_samples = 0
        self.polled = PolledTimes()
        self._damaged: set[tuple[int, int]] = set()
        self._guard = threading.Lock()
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            self._lock = FolderLock(self.folder)
        except OSError as error:
            raise SpoolError(
                f"the spool folder {self.folder} cannot be used ({error}); expected a folder that "
                "this service may write to and no other service uses"
            ) from error
        self._acknowledged, self.lost_samples = self._read_cursor()
        segments = self._segments()
        # Each start begins a new file, since the last record of the old one may be incomplete.
        self._segment = max(segments[-1] if segments else 0, self._acknowledged.segment) + 1
        self._file = self._path(self._segment).open("ab", buffering=0)
        self._size = sum(self._path(number).stat().st_size for number in segments)
        self._written = 0

    def close(self) -> None:
        """Close the files; waiting batches remain for the next start."""
        with self._guard:
            self._file.close()
            self._lock.release()

    def append(self, batch: SampleBatch) -> None:
        """Append ``batch``, whose samples are bad where their instant came before. Raises
        ``OSError`` where the disk is full."""
        record = pack(self.polled.checked(batch))
        with self._guard:
            if self._written and self._written + len(record) > self.segment_bytes:
                self._begin_file()
            while self._size + len(record) > self.limit_bytes and self._drop_oldest():
                pass
            self._write(record)

    def waiting(self, after: Position | None = None) -> Iterator[Waiting]:
        """The batches that are not acknowledged, oldest first, from ``after`` on where given, up to
        what has been appended so far."""
        position = max(self._acknowledged, after or Position())
        for number in self._segments():
            if number < position.segment:
                continue
            start = position.offset if number == position.segment else 0
            yield from self._in_file(number, start)

    def acknowledge(self, upto: Position) -> None:
        """Record that everything before ``upto`` is stored, and remove files that are done."""
        with self._guard:
            self._acknowledged = max(self._acknowledged, upto)
            self._write_cursor()
            for number in self._segments():
                if number < self._acknowledged.segment:
                    self._remove(number)

    @property
    def size_bytes(self) -> int:
        """Bytes in the folder, including records that are stored but not yet removed."""
        return self._size

    def _in_file(self, number: int, start: int) -> Iterator[Waiting]:
        finished = number != self._segment  # to be decided before reading the file
        try:
            with self._path(number).open("rb") as file:
                file.seek(start)
                data = file.read()
        except FileNotFoundError:
            return  # dropped meanwhile, and counted as lost
        stop = 0
        for record in records(data):
            if record.skipped:
                self._report_damage(number, start + stop, record.skipped)
            stop = record.stop
            yield Waiting(record.batch, Position(number, start + stop))
        if stop < len(data) and finished:
            self._report_damage(number, start + stop, len(data) - stop)

    def _report_damage(self, number: int, offset: int, count: int) -> None:
        if (number, offset) in self._damaged:
            return
        self._damaged.add((number, offset))
        log.error(
            "spool file %s: %d bytes from byte %d on are no record (a crash in the middle of a "
            "write, or damage); what stands around them is used",
            self._path(number),
            count,
            offset,
        )

    def _write(self, record: bytes) -> None:
        size_before = self._written
        try:
            bytes_written = 0
            while bytes_written < len(record):  # an unbuffered write may take a part only
                bytes_written += self._file.write(record[bytes_written:]) or 0
            if self.sync:
                os.fsync(self._file.fileno())
        except OSError:
            # An incomplete record on a full disk is removed, so that the next one is readable.
            self._file.truncate(size_before)
            raise
        self._written += len(record)
        self._size += len(record)

    def _begin_file(self) -> None:
        self._file.close()
        self._segment += 1
        self._file = self._path(self._segment).open("ab", buffering=0)
        self._written = 0

    def _drop_oldest(self) -> bool:
        """Remove the oldest file, never the one being written; returns whether there was one."""
        oldest = self._segments()[0]
        if oldest == self._segment:
            return False
        start = self._acknowledged.offset if oldest == self._acknowledged.segment else 0
        fully_handed_on = oldest < self._acknowledged.segment
        data = b"" if fully_handed_on else self._path(oldest).read_bytes()
        lost = sum(record.samples for record in records(data, start))
        self._remove(oldest)
        self._acknowledged = max(self._acknowledged, Position(oldest + 1))
        self.lost_samples += lost
        self._write_cursor()
        if lost:
            log.error(
                "THE SPOOL IS FULL (%d bytes in %s): %d samples that the store has not seen were "
                "dropped, %d in all. Bring the store back, or give the spool more room",
                self.limit_bytes,
                self.folder,
                lost,
                self.lost_samples,
            )
        return True

    def _remove(self, number: int) -> None:
        path = self._path(number)
        self._size -= path.stat().st_size
        path.unlink()

    def _segments(self) -> list[int]:
        return [number for number, _ in _segments(self.folder)]

    def _path(self, number: int) -> Path:
        return self.folder / f"{number:010}{_SUFFIX}"

    def _read_cursor(self) -> tuple[Position, int]:
        path = self.folder / _CURSOR
        try:
            cursor = json.loads(path.read_bytes())
            position = Position(int(cursor["segment"]), int(cursor["offset"]))
            self.polled = PolledTimes(cursor.get("polled"))
            return position, int(cursor["lost"])
        except FileNotFoundError:
            return Position(), 0
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            # Everything is written again, which the store accepts without duplicates.
            log.error("spool cursor %s cannot be read (%s); beginning at the oldest", path, error)
            return Position(), 0

    def _write_cursor(self) -> None:
        text = json.dumps(
            {
                "segment": self._acknowledged.segment,
                "offset": self._acknowledged.offset,
                "lost": self.lost_samples,
                "polled": self.polled.stretches,
            }
        )
        path = self.folder / _CURSOR
        new_file = path.with_suffix(".new")
        with new_file.open("w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            if self.sync:
                os.fsync(file.fileno())
        new_file.replace(path)  # replaces the old file completely or not at all


@dataclass(frozen=True, kw_only=True)
class Backlog:
    """Samples that are not stored yet: ``size_bytes`` in the spool, ``oldest`` the instant of the
    first one (``None`` without any), ``lost_samples`` dropped since the spool was created."""

    size_bytes: int = 0
    oldest: datetime | None = None
    lost_samples: int = 0

    def age_s(self, now: datetime) -> float:
        """Age in seconds of the oldest waiting sample; 0 without any."""
        return 0.0 if self.oldest is None else max(0.0, (now - self.oldest).total_seconds())


def backlog(folder: Path) -> Backlog:
    """The backlog of the spool in ``folder``; empty where there is no spool.

    Nothing is locked: a file that the collector removes meanwhile counts as stored.
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
    """The position up to which all is stored (file, byte), and the number of samples dropped."""
    try:
        cursor = json.loads((folder / _CURSOR).read_bytes())
        return int(cursor["segment"]), int(cursor["offset"]), int(cursor["lost"])
    except (OSError, ValueError, KeyError, TypeError):
        return 0, 0, 0


def _segments(folder: Path) -> list[tuple[int, Path]]:
    paths = folder.glob(f"*{_SUFFIX}")
    numbered = [path for path in paths if path.stem.isascii() and path.stem.isdigit()]
    return sorted((int(path.stem), path) for path in numbered)


def _first_instant(path: Path, start: int) -> datetime | None:
    """The instant of the first whole record's first sample from byte ``start`` on."""
    with path.open("rb") as file:
        file.seek(start)
        data = file.read(_FIRST_BYTES)
    for record in records(data):
        if record.samples:
            return _EPOCH + timedelta(microseconds=int(record.batch.at_us.min()))
    return None
