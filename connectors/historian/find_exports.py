"""From a file, folder or pattern to the files to read, with the reason why others are skipped."""

from __future__ import annotations

import glob
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from stemwatch.connectors.connector import ConnectorError, UnreadableSource
from stemwatch.connectors.historian.layouts import parse_source
from stemwatch.connectors.historian.options import ReadOptions
from stemwatch.connectors.historian.reading_notes import ReadingNotes
from stemwatch.connectors.historian.tables.document import read_document
from stemwatch.connectors.historian.tables.layout_input import LayoutInput

_LINES = 400
_BYTES = 1 << 18


def why_no_recording(path: Path) -> str | None:
    """Why the start of ``path`` makes no table of samples, or ``None`` where it does."""
    try:
        with path.open("rb") as file:
            raw = file.read(_BYTES)
    except OSError as error:
        return f"cannot be opened ({error.strerror or error})"
    notes = ReadingNotes()
    try:
        document = read_document(raw, path, None, notes)
        lines = document.lines[:_LINES] if len(raw) < _BYTES else document.lines[:_LINES][:-1]
        parse_source(LayoutInput(replace(document, lines=lines), ReadOptions(), notes))
    except ConnectorError as error:
        return str(error).removeprefix(f"{path}: ")
    return None


ENDINGS = (".csv", ".txt", ".tsv", ".tab", ".dat", ".asc")
_PACKED = ".gz"


class FoundSources(NamedTuple):
    """Files in order of their names, and (file, reason) for each one that is no recording."""

    paths: list[Path]
    skipped: list[tuple[Path, str]]


def find_sources(patterns: Iterable[str | Path]) -> FoundSources:
    """The recordings that ``patterns`` name: files, folders (searched wholly) or globs.

    A file that was named itself is always taken, so that reading it can say what is wrong; of a
    folder or a glob, files that are plainly no recording are skipped with a reason, and hidden ones
    are left out. Raises
    ``UnreadableSource`` for a pattern that names nothing.
    """
    paths: dict[Path, None] = {}
    skipped: dict[Path, str] = {}
    for pattern in patterns:
        matched = _matches(pattern)
        if not matched:
            skipped[Path(pattern)] = _why_nothing(Path(pattern))
        for path in matched:
            reason = None if path == Path(pattern) else why_no_recording(path)
            if reason is None:
                paths[path] = None
            else:
                skipped[path] = reason
    left_out = sorted((path, reason) for path, reason in skipped.items() if path not in paths)
    return FoundSources(sorted(paths), left_out)


def _matches(pattern: str | Path) -> list[Path]:
    path = Path(pattern)
    if path.is_dir():
        files = (p for p in path.rglob("*") if p.is_file() and _has_ending(p))
        return [p for p in files if not p.name.startswith(".")]
    if path.exists():
        return [path]
    paths = [Path(p) for p in glob.glob(str(pattern), recursive=True) if Path(p).is_file()]
    if not paths:
        raise UnreadableSource(
            f"{pattern}: no such file, folder or pattern; expected for example exports/*.csv"
        )
    return paths


def _why_nothing(folder: Path) -> str:
    """Why a folder gave no file."""
    first_entry = next(folder.rglob("*"), None)
    contents = (
        "the folder is empty" if first_entry is None else "no file in the folder may be a recording"
    )
    return f"{contents}; expected exports that end in {', '.join(ENDINGS)}"


def _has_ending(path: Path) -> bool:
    name = path.name.lower().removesuffix(_PACKED)
    return name.endswith(ENDINGS)
