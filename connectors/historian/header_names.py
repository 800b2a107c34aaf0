"""The names in the header of a text export, read from its top alone.

Which files of a folder hold a valve's tags is then known without parsing any of them.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Set
from contextlib import suppress
from pathlib import Path

# The top of a file, in which its header is looked for.
_BYTES, _LINES = 1_000_000, 12
_SEPARATORS = ",;\t|"
_ANY_SEPARATOR = re.compile(f"[{_SEPARATORS}]")
_UNIT = re.compile(r"\s*[\[(][^\[\]()]*[\])]$")
# A header of a wide export names several tags; a row of a narrow one names a single tag.
_FEWEST_TAGS = 2


def header_names(path: str, tags_wanted: Set[str]) -> set[str] | None:
    """The names in the header of the export ``path``; ``None`` where no line near its top names two
    of the ``tags_wanted`` tags, so that the whole file has to be parsed.

    Each name is given as written and without a trailing unit in brackets. A line that is not UTF-8
    proves nothing: another encoding may hold names that would be missed.
    """
    if path.endswith(".gz"):
        return None
    try:
        with Path(path).open("rb") as file:
            head = file.read(_BYTES)
    except OSError:
        return None  # reading the file reports the error
    for line in head.decode("utf-8-sig", "replace").splitlines()[:_LINES]:
        if "\ufffd" in line:
            return None
        cells = {cell.strip().strip("\"'").strip() for cell in _cells(line)}
        names = cells | {_UNIT.sub("", cell) for cell in cells}
        if len(names & tags_wanted) >= _FEWEST_TAGS:
            return names
    return None


def _cells(line: str) -> list[str]:
    """The cells of a header by each separator that an export may have. Within quotes a separator
    belongs to the name, and a doubled quote is one."""
    if '"' not in line:
        return _ANY_SEPARATOR.split(line)
    cells: list[str] = []
    for separator in _SEPARATORS:
        with suppress(csv.Error):  # by a separator that it does not have, a long line is one cell
            cells += next(csv.reader([line], delimiter=separator), [])
    return cells
