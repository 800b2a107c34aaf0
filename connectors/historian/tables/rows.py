"""Lines to rows of cells, with the line number of each row and a report of every bad one."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from stemwatch.connectors.historian.reading_notes import ReadingNotes

SEPARATORS = "\t;|,"
_QUOTED_LINES = 20  # a quoted cell that goes on for longer is a stray quote
_SHOWN = 60
csv.field_size_limit(2**31 - 1)


@dataclass(frozen=True)
class Rows:
    """``cells[i]`` is the row that begins on line ``numbers[i]`` of the file."""

    cells: list[list[str]]
    numbers: list[int]


def split_rows(
    lines: Sequence[str], separator: str, first_line: int = 1, notes: ReadingNotes | None = None
) -> Rows:
    """Rows of ``lines``, whose first is line ``first_line``; blank lines are left out.

    A quote that is never closed spoils its own line only: it is read as if it were not quoted.
    """
    if not any('"' in line for line in lines):
        filled_lines = [(line, n) for n, line in enumerate(lines, first_line) if line.strip()]
        return Rows(
            [line.split(separator) for line, _ in filled_lines], [n for _, n in filled_lines]
        )
    return whole_rows(lines, separator, first_line, notes)[0]


def whole_rows(
    lines: Sequence[str],
    separator: str,
    first_line: int = 1,
    notes: ReadingNotes | None = None,
    *,
    file_goes_on: bool = False,
) -> tuple[Rows, int]:
    """The rows of lines with quotes, and how many lines they take.

    Where the text ``file_goes_on`` after ``lines``, a row that may end there is left for later.
    """
    cells: list[list[str]] = []
    numbers: list[int] = []
    index = 0
    while index < len(lines):
        if file_goes_on and lines[index].count('"') % 2 and index + _QUOTED_LINES > len(lines):
            break
        row, used = _next_row(lines, index, separator, first_line, notes)
        if any(cell.strip() for cell in row) or len(row) > 1:
            cells.append(row)
            numbers.append(first_line + index)
        index += used
    return Rows(cells, numbers), index


def _next_row(
    lines: Sequence[str], index: int, separator: str, first_line: int, notes: ReadingNotes | None
) -> tuple[list[str], int]:
    """The row that begins at ``lines[index]`` and how many lines it takes."""
    line = lines[index]
    if '"' not in line:
        return line.split(separator), 1
    if line.count('"') % 2 == 0:
        return _split_quoted([line], separator), 1
    for used in range(2, _QUOTED_LINES + 1):
        block = list(lines[index : index + used])
        if len(block) == used and sum(part.count('"') for part in block) % 2 == 0:
            row = _split_quoted(block, separator)
            # Only a cell that itself holds the line end is one quoted cell over several lines.
            if any("\n" in cell for cell in row) and len(row) > 1:
                cells_of_this_line = line.count(separator) + 1
                if len(row) >= cells_of_this_line:
                    return row, used
            break
    if notes is not None:
        notes.problem(
            f"line {first_line + index}: a quotation mark is never closed: {line[:_SHOWN]!r}; the "
            "line was read as if it were not quoted"
        )
    return [cell.strip('"') for cell in line.split(separator)], 1


def _split_quoted(block: list[str], separator: str) -> list[str]:
    joined = [part + "\n" for part in block[:-1]] + block[-1:]
    return next(csv.reader(joined, delimiter=separator), [])


def sniff_separator(lines: Sequence[str]) -> str | None:
    """The separator that divides most of ``lines`` into equally many cells, or ``None``.

    A comma inside numbers divides German files evenly too, so tab, semicolon and bar go first
    when they are nearly as even.
    """
    sample = [line for line in lines if line.strip()][:400]
    best: tuple[float, str] | None = None
    for separator in SEPARATORS:
        counts = Counter(len(row) for row in split_rows(sample, separator).cells)
        width, rows = max(
            ((w, n) for w, n in counts.items() if w > 1),
            key=lambda item: item[1] * min(item[0], 3),
            default=(1, 0),
        )
        share = rows / max(1, len(sample))
        if width > 1 and share > 0 and (best is None or share > 1.25 * best[0]):
            best = (share, separator)
    return best[1] if best else None


def table_rows(rows: Rows, width: int, notes: ReadingNotes, *, ends_whole: bool = True) -> Rows:
    """The rows that have ``width`` cells, trailing empty ones aside; the others are reported.

    In a row with a cell too few or too many it is not known which cell belongs to which tag, so the
    whole row is left out rather than assigned to wrong tags.
    """
    cells: list[list[str]] = []
    numbers: list[int] = []
    for row, number in zip(rows.cells, rows.numbers, strict=True):
        if len(row) == width:
            cells.append(row)
            numbers.append(number)
        elif len(row) > width and not any(cell.strip() for cell in row[width:]):
            cells.append(row[:width])
            numbers.append(number)
        else:
            cut = not ends_whole and number == rows.numbers[-1]
            notes.problem(row_left_out(number, row, width, cut=cut))
    return Rows(cells, numbers)


def row_left_out(number: int, row: Sequence[str], width: int, *, cut: bool) -> str:
    """The sentence about a row of another width; ``cut`` where the file ends inside it."""
    ends = " (the file ends inside it)" if cut else ""
    return (
        f"line {number}: {len(row)} cells where {width} were expected{ends}; the row was "
        f"left out: {'|'.join(row)[:_SHOWN]!r}"
    )
