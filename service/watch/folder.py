"""``WatchedFolder``: looks at a folder, takes in what is whole, and clears it away."""

from __future__ import annotations

import hashlib
import json
import logging
import os
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from stemwatch.service.config import Plant
from stemwatch.service.store.samples.sources import SourceState, TakenFile
from stemwatch.service.store.store import Store
from stemwatch.service.watch.intake import take_in
from stemwatch.service.watch.limited_reader import ReaderDied, Rejected

NAME = ".stemwatch-attempts.json"

log = logging.getLogger(__name__)
DONE, REJECTED = "done", "rejected"
QUIET = timedelta(seconds=5)  # how long a file is left alone after it last changed
MOST_ATTEMPTS = 2  # that came to no end, before a file is rejected unread
_NOTE = ".why.txt"
_BEGUN_IN_VAIN = (
    f"it was begun {MOST_ATTEMPTS} times and the process that read it came to no end: the file may "
    "take more memory than there is, or the service was stopped meanwhile. Look at its size, split "
    "it, and drop it again"
)


class FileAttempts:
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
        """Forget the attempts: the file was read or rejected, and the process lived."""
        noted = self._read()
        if noted.pop(digest, None) is not None:
            self._write(noted)

    def _read(self) -> dict[str, int]:
        try:
            noted = json.loads(self._path.read_text(encoding="utf-8"))
            return {str(digest): int(count) for digest, count in noted.items()}
        except (OSError, ValueError, TypeError, AttributeError):
            return {}  # not there, or damaged: nothing is known of any file

    def _write(self, noted: dict[str, int]) -> None:
        new = self._path.with_suffix(".new")
        with new.open("w", encoding="utf-8") as file:
            json.dump(noted, file)
            file.flush()
            os.fsync(file.fileno())
        os.replace(new, self._path)


@dataclass(frozen=True)
class _Looks:
    """Size and time of change of a file: the same at two looks means that nobody writes to it."""

    size: int
    changed_ns: int


class WatchedFolder:
    """The folder of one source. Each file is taken in once, whatever its name, and moved to
    ``done``, or to ``rejected`` beside a note that says why.

    A file that is still growing waits. What was begun when a process died is begun once more (the
    store takes no sample twice), and rejected where that too came to no end: it may be the file
    that brings the process down. A file is read in a process of its own that may take
    ``memory_bytes``, by default three quarters of what is free.
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
        self._before: dict[Path, _Looks] = {}
        self._counts = {"taken": 0.0, "rejected": 0.0, "samples": 0.0}
        self._last: datetime | None = None

    def look(self) -> list[TakenFile]:
        """Take in every file that is whole; what became of each. Raises ``StoreError`` where the
        store is away: the files then stay where they are."""
        fault = ""
        taken: list[TakenFile] = []
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            became = [self._take(path) for path in list(self._whole())]
            taken += [file for file in became if file is not None]
        except OSError as error:
            fault = f"{self.folder}: {error.strerror or error}"
            log.error("watched folder %s", fault)
        self._say(fault, taken)
        return taken

    def _whole(self) -> Iterator[Path]:
        """Files that have not changed since the last look, nor for a while."""
        looks: dict[Path, _Looks] = {}
        now = datetime.now(UTC)
        for path in sorted(self.folder.iterdir()):
            if path.name.startswith((".", "~")) or path.is_symlink() or not path.is_file():
                continue
            stat = path.stat()
            looks[path] = _Looks(stat.st_size, stat.st_mtime_ns)
            quiet = now - datetime.fromtimestamp(stat.st_mtime, UTC) >= self._quiet
            if quiet and self._before.get(path) == looks[path]:
                yield path
        self._before = looks

    def _take(self, path: Path) -> TakenFile | None:
        """What became of the file; ``None`` where it is tried once more at the next look."""
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        known = self._store.sources.taken(digest)
        if known is not None and known.accepted:
            self._move(path, DONE, f"taken in before, as {known.name}; not again")
            return known
        if self._attempts.unfinished(digest) >= MOST_ATTEMPTS:
            return self._reject(path, digest, _BEGUN_IN_VAIN)
        self._attempts.begin(digest)
        try:
            taken = take_in(
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
            self._attempts.end(digest)  # the store is away, say: nothing against the file
            raise
        note = self._note(path, digest, accepted=True, samples=taken.samples, note=taken.note)
        self._attempts.end(digest)
        return note

    def _reject(self, path: Path, digest: str, note: str) -> TakenFile:
        rejected = self._note(path, digest, accepted=False, samples=0, note=note)
        self._attempts.end(digest)
        return rejected

    def _note(
        self, path: Path, digest: str, *, accepted: bool, samples: int, note: str
    ) -> TakenFile:
        file = TakenFile(
            digest=digest,
            name=path.name,
            source=self._source,
            accepted=accepted,
            samples=samples,
            note=note,
        )
        # First noted, then moved: in between it is known by its digest and only moved.
        self._store.sources.note_taken(file)
        self._move(path, DONE if accepted else REJECTED, "" if accepted else note)
        level = logging.INFO if accepted else logging.WARNING
        log.log(level, "%s: %s: %s", path.name, "taken in" if accepted else "rejected", note)
        return file

    def _move(self, path: Path, where: str, note: str) -> None:
        folder = self.folder / where
        folder.mkdir(exist_ok=True)
        target = _free(folder / path.name)
        if note:
            written = target.with_name(target.name + _NOTE)
            written.write_text(note + "\n", encoding="utf-8", errors="replace")
        os.replace(path, target)

    def _say(self, fault: str, taken: list[TakenFile]) -> None:
        for file in taken:
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


def _free(path: Path) -> Path:
    """``path``, or the same with a number where something is there already."""
    number, free = 1, path
    while free.exists():
        number += 1
        free = path.with_name(f"{path.stem}-{number}{path.suffix}")
    return free
