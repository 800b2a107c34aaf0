"""``WatchedFolder``: stores the samples of each completely written file, then moves it away."""

from __future__ import annotations

import errno
import hashlib
import json
import logging
import os
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from stemwatch.connectors.historian import ReadOptions
from stemwatch.models.recording import Role
from stemwatch.models.words import counted, listed
from stemwatch.service.config import Plant
from stemwatch.service.store.samples.samples import SampleStore
from stemwatch.service.store.samples.sources import SourceState, TakenFile
from stemwatch.service.store.store import Store
from stemwatch.service.watch.limited_reader import Export, ReaderDied, Rejected, limited_reading

log = logging.getLogger(__name__)

DONE, REJECTED = "done", "rejected"
ATTEMPTS_FILE = ".stemwatch-attempts.json"
QUIET = timedelta(seconds=5)  # how long a file must be unchanged before it is read
MOST_ATTEMPTS = 2  # unfinished attempts after which a file is rejected
_SHOWN = 8  # tags that a note names
_NOTE = ".why.txt"
_BEGUN_IN_VAIN = (
    f"it was begun {MOST_ATTEMPTS} times and the process that read it came to no end: the file may "
    "take more memory than there is, or the service was stopped meanwhile. Look at its size, split "
    "it, and drop it again"
)


_NOT_TAKEN = (
    "{name}: {error}; the account of the service must be able to read the file and to move it into "
    f"{DONE}/ or {REJECTED}/ beside it"
)


@dataclass(frozen=True, kw_only=True)
class Taken:
    """The number of stored samples, their tags, a note on tags that were not in the file and on
    samples too old to stay, and how many of these there are."""

    samples: int
    tags: tuple[str, ...]
    note: str
    too_old: int = 0


def take_in(
    path: Path, plant: Plant, source: str, samples: SampleStore, memory_bytes: int | None = None
) -> Taken:
    """Store the samples in ``path`` of the tags that valves of ``source`` name.

    Existing samples are not changed, so a file may overlap others and may be read again. A separate
    process reads it with at most ``memory_bytes`` of memory, see ``limited_reading``.
    Raises ``Rejected`` for a file that cannot be read, has none of the tags, or whose times have no
    zone; ``ReaderDied`` where the reading process was killed; ``StoreError``.
    """
    tags_wanted = _tags_wanted(plant, source)
    export = Export(
        path=path,
        options=ReadOptions(**plant.read_options(source)),
        source=source,
        wanted=tags_wanted,
    )
    count = old = 0
    kept_from_us = _kept_from_us(plant)
    with limited_reading(export, memory_bytes) as (units, batches):
        samples.describe(source, dict(units))
        for batch in batches:
            samples.write(batch)
            count += len(batch)
            old += int(np.count_nonzero(batch.at_us < kept_from_us))
    missing = sorted(set(tags_wanted) - set(units))
    note = f"{counted(count, 'sample')} of {counted(len(units), 'tag')}"
    if missing:
        note += f"; not in this file: {listed(missing, _SHOWN)}"
    if old:
        which = "all of them are" if old == count else counted(old, "of them is", "of them are")
        note += (
            f"; {which} older than keep_samples_days = "
            f"{plant.service.keep_samples_days:g} days, and will be removed within the hour. To "
            "keep them, raise keep_samples_days in [service], start the service again and drop the "
            "file again. `stemwatch screen` reads the file itself, whatever its age"
        )
    return Taken(samples=count, tags=tuple(units), note=note, too_old=old)


def _kept_from_us(plant: Plant) -> int:
    """The first instant whose samples the service keeps, microseconds since 1970: it removes whole
    days in UTC."""
    oldest = datetime.now(UTC) - timedelta(days=plant.service.keep_samples_days)
    midnight = oldest.replace(hour=0, minute=0, second=0, microsecond=0)
    return round(midnight.timestamp() * 1e6)


def _tags_wanted(plant: Plant, source: str) -> dict[str, bool]:
    """The tags that valves of the source name, and whether each is a controller's mode."""
    return {
        tag.tag: role is Role.MODE
        for valve in plant.valves.values()
        if valve.source == source
        for role, tag in valve.tags.by_role().items()
    }


class FileAttempts:
    """Attempts to read files of a folder, by their digests, in a JSON file in the folder."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / ATTEMPTS_FILE

    def unfinished(self, digest: str) -> int:
        """How many attempts at the file did not come to an end."""
        return self._read().get(digest, 0)

    def begin(self, digest: str) -> None:
        """Record an attempt on disk before it is made."""
        attempts = self._read()
        attempts[digest] = attempts.get(digest, 0) + 1
        self._write(attempts)

    def end(self, digest: str) -> None:
        """Delete the attempts: the file was read or rejected without killing the process."""
        attempts = self._read()
        if attempts.pop(digest, None) is not None:
            self._write(attempts)

    def _read(self) -> dict[str, int]:
        try:
            attempts = json.loads(self._path.read_text(encoding="utf-8"))
            return {str(digest): int(count) for digest, count in attempts.items()}
        except (OSError, ValueError, TypeError, AttributeError):
            return {}  # missing or damaged: as if no file had been attempted

    def _write(self, attempts: dict[str, int]) -> None:
        new = self._path.with_suffix(".new")
        with new.open("w", encoding="utf-8") as file:
            json.dump(attempts, file)
            file.flush()
            os.fsync(file.fileno())
        os.replace(new, self._path)


@dataclass(frozen=True)
class _FileState:
    """Size and modification time of a file; unchanged between two looks, it is complete."""

    size: int
    changed_ns: int


class WatchedFolder:
    """The folder of one source. Each file's samples are stored once, whatever its name, and the
    file is moved to ``done``, or to ``rejected`` with a note that says why.

    A file that is still growing is left for later. A file whose reading was interrupted is read
    once more (samples are not stored twice), and rejected where that is interrupted too, since the
    file itself may be the cause. A separate process reads it, with at most ``memory_bytes`` of
    memory, by default three quarters of what is free.
    """

    def __init__(
        self,
        plant: Plant,
        source: str,
        store: Store,
        quiet: timedelta = QUIET,
        memory_bytes: int | None = None,
    ) -> None:
        folder = plant.sources[source].folder
        if folder is None:
            raise ValueError(f"source {source!r} has a path, not a folder that is watched")
        self.folder = plant.beside(folder)
        self._plant, self._source, self._store = plant, source, store
        self._quiet = quiet
        self._memory_bytes = memory_bytes
        self._attempts = FileAttempts(self.folder)
        self._before: dict[Path, _FileState] = {}
        self._counts = {"taken": 0.0, "rejected": 0.0, "samples": 0.0}
        taken_in = (file.taken for file in store.sources.files(source) if file.accepted)
        self._last: datetime | None = next(taken_in, None)

    def look(self) -> list[TakenFile]:
        """Store the samples of every complete file and return the files. Raises ``StoreError``
        where the store is not available; the files then stay where they are."""
        faults: list[str] = []
        taken_files: list[TakenFile] = []
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            if complete := list(self._complete()):
                for subfolder in (DONE, REJECTED):  # else each look would read the files anew
                    _make_writable(self.folder / subfolder)
        except OSError as error:
            complete = []
            faults.append(f"{error.filename or self.folder}: {error.strerror or error}")
        for path in complete:
            try:
                file = self._take(path)
            except OSError as error:  # of this file alone: the others must not wait for it
                faults.append(_NOT_TAKEN.format(name=path.name, error=error))
            else:
                taken_files += [] if file is None else [file]
        fault = "; ".join(faults)
        if fault:
            log.error("watched folder %s", fault)
        self._store_state(fault, taken_files)
        return taken_files

    def _complete(self) -> Iterator[Path]:
        """Files that have not changed since the last look, nor for ``quiet``."""
        states: dict[Path, _FileState] = {}
        now = datetime.now(UTC)
        for path in sorted(self.folder.iterdir()):
            if path.name.startswith((".", "~")) or path.is_symlink() or not path.is_file():
                continue
            stat = path.stat()
            states[path] = _FileState(stat.st_size, stat.st_mtime_ns)
            # The time is in the future where the clock was set back, or the writing machine's clock
            # is ahead.
            quiet = abs(now - datetime.fromtimestamp(stat.st_mtime, UTC)) >= self._quiet
            if quiet and self._before.get(path) == states[path]:
                yield path
        self._before = states

    def _take(self, path: Path) -> TakenFile | None:
        """The file as read or rejected; ``None`` where it is tried again at the next look."""
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        taken_before = self._store.sources.taken(digest)
        # What was too old to stay may come again: the plant file may say otherwise by now.
        if taken_before is not None and taken_before.accepted and not taken_before.too_old:
            self._move(path, DONE, f"taken in before, as {taken_before.name}; not again")
            return taken_before
        if self._attempts.unfinished(digest) >= MOST_ATTEMPTS:
            return self._reject(path, digest, _BEGUN_IN_VAIN)
        self._attempts.begin(digest)
        try:
            stored = take_in(
                path, self._plant, self._source, self._store.samples, self._memory_bytes
            )
        except Rejected as error:
            return self._reject(path, digest, str(error))
        except ReaderDied as error:
            log.error("%s: %s", path.name, error)
            if self._attempts.unfinished(digest) < MOST_ATTEMPTS:
                return None
            return self._reject(path, digest, f"{_BEGUN_IN_VAIN} ({error})")
        except Exception:
            self._attempts.end(digest)  # not an error of the file: the store may be unavailable
            raise
        taken = TakenFile(
            digest=digest,
            name=path.name,
            source=self._source,
            accepted=True,
            samples=stored.samples,
            note=stored.note,
            too_old=stored.too_old,
        )
        self._over(path, taken)
        return taken

    def _reject(self, path: Path, digest: str, note: str) -> TakenFile:
        file = TakenFile(
            digest=digest, name=path.name, source=self._source, accepted=False, note=note
        )
        self._over(path, file)
        return file

    def _over(self, path: Path, file: TakenFile) -> None:
        """Note the file and move it away."""
        # Stored before moving: after an interruption its digest is known and it is only moved.
        self._store.sources.note_taken(file)
        self._move(path, DONE if file.accepted else REJECTED, "" if file.accepted else file.note)
        level = logging.INFO if file.accepted and not file.too_old else logging.WARNING
        done = "taken in" if file.accepted else "rejected"
        log.log(level, "%s: %s: %s", path.name, done, file.note)
        self._attempts.end(file.digest)

    def _move(self, path: Path, subfolder: str, note: str) -> None:
        target = _free(self.folder / subfolder / path.name)
        if note:
            written = target.with_name(target.name + _NOTE)
            written.write_text(note + "\n", encoding="utf-8", errors="replace")
        os.replace(path, target)

    def _store_state(self, fault: str, files: list[TakenFile]) -> None:
        for file in files:
            self._counts["taken" if file.accepted else "rejected"] += 1
            self._counts["samples"] += file.samples
            if file.accepted:
                self._last = datetime.now(UTC)
        state = SourceState(
            source=self._source,
            kind="folder",
            address=str(self.folder),
            last_good=self._last,
            connected=not fault,
            fault=fault,
            figures=dict(self._counts),
        )
        self._store.sources.note(state)


def _make_writable(folder: Path) -> None:
    """Make the folder where it is not there. Raises ``OSError`` where files cannot be moved into
    it."""
    folder.mkdir(exist_ok=True)
    if not os.access(folder, os.W_OK | os.X_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(folder))


def _free(path: Path) -> Path:
    """``path``, or with a number added to its name where it exists already."""
    number, candidate = 1, path
    while candidate.exists():
        number += 1
        candidate = path.with_name(f"{path.stem}-{number}{path.suffix}")
    return candidate
