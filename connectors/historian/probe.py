"""A quick look at the start of a file: could it be a recording at all?"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from stemwatch.connectors.connector import ConnectorError
from stemwatch.connectors.historian.document import read_document
from stemwatch.connectors.historian.layouts import parse_source
from stemwatch.connectors.historian.notes import Notes
from stemwatch.connectors.historian.options import ReadOptions
from stemwatch.connectors.historian.source import Source

_LINES = 400
_BYTES = 1 << 18


def why_no_recording(path: Path) -> str | None:
    """Why the start of ``path`` makes no table of samples, or ``None`` where it does."""
    try:
        with path.open("rb") as file:
            raw = file.read(_BYTES)
    except OSError as error:
        return f"cannot be opened ({error.strerror or error})"
    notes = Notes()
    try:
        document = read_document(raw, path, None, notes)
        lines = document.lines[:_LINES] if len(raw) < _BYTES else document.lines[:_LINES][:-1]
        parse_source(Source(replace(document, lines=lines), ReadOptions(), notes))
    except ConnectorError as error:
        return str(error).removeprefix(f"{path}: ")
    return None
