"""Which tags the header of a wide export names, without reading the file.

An export of a day is parsed once, by the worker that screens it. To know which valves are in it,
the process that hands out the work needs the header only, where the plant file says the tags.
"""

from __future__ import annotations

import re
from collections.abc import Set
from pathlib import Path

HEAD_BYTES = 1_000_000
LINES = 12
_SEPARATORS = re.compile(r"[,;\t|]")
_UNIT = re.compile(r"\s*[\[(][^\[\]()]*[\])]$")
# A row of a narrow export names one tag; a header of a wide one names several.
FEWEST = 2


def header_tags(path: str, wanted: Set[str]) -> set[str] | None:
    """What the header of the text file ``path`` names, or ``None`` where only reading all of it
    can tell: where none of its first lines names two of the tags that are ``wanted``.

    Names are given as they stand and without a unit in brackets behind them.
    """
    if path.endswith(".gz"):
        return None
    try:
        with Path(path).open("rb") as file:
            head = file.read(HEAD_BYTES)
    except OSError:
        return None  # reading it will say what is wrong
    for line in head.decode("utf-8-sig", "replace").splitlines()[:LINES]:
        cells = {cell.strip().strip("\"'").strip() for cell in _SEPARATORS.split(line)}
        named = cells | {_UNIT.sub("", cell) for cell in cells}
        if len(named & wanted) >= FEWEST:
            return named
    return None
