"""Lists that people keep in a spreadsheet and save as CSV: of valves, or of registers."""

from __future__ import annotations

import csv
import io

# Control codes that Python counts as blanks and no spreadsheet writes: the separators of files,
# groups, records and units. A row with one of them is damaged, not empty.
_SEPARATOR_CODES = "\x1c\x1d\x1e\x1f"


class ListFault(Exception):
    """Why a list cannot be read at all: the ``line``, what was found and what was expected."""

    def __init__(self, line: int, found: str, expected: str) -> None:
        self.line, self.found, self.expected = line, found, expected
        super().__init__(f"line {line}: found {found}; expected {expected}")


def decoded(raw: bytes) -> str:
    """The text of a file in UTF-8, or in UTF-16 where a byte order mark says so.

    Raises ``ListFault`` at the first byte that is not UTF-8.
    """
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        return raw.decode("utf-16", errors="replace")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        # What was decoded is ``error.object``: the file without its byte order mark.
        line = error.object.count(b"\n", 0, error.start) + 1
        found_text = f"the byte 0x{error.object[error.start]:02x}, which is not UTF-8"
        raise ListFault(line, found_text, "a file saved as UTF-8") from None


def separator_of(text: str) -> str:
    """The comma, semicolon or tab, whichever the heading row has most of."""
    heading = text.lstrip().split("\n", 1)[0]
    return max(",;\t", key=heading.count)


def records_of(text: str, separator: str) -> list[tuple[int, list[str]]]:
    """The cells of each record that is not blank, with the number of its first line.

    Raises ``ListFault`` for a quotation mark that is never closed: all records after it would be
    read as one cell.
    """
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator, strict=True)
    records: list[tuple[int, list[str]]] = []
    line = 1
    while True:
        try:
            cells = next(reader, None)
        except csv.Error as error:
            found_text = f"a row that is not CSV ({error})"
            raise ListFault(line, found_text, "quotation marks in pairs") from None
        if cells is None:
            return records
        if not all(map(is_blank, cells)):
            records.append((line, cells))
        line = reader.line_num + 1


def is_blank(cell: str) -> bool:
    """Whether a cell holds nothing but spaces, tabs and the like; a control code is not blank."""
    return not cell.strip() and not any(code in cell for code in _SEPARATOR_CODES)
