"""Reading a TOML file, with the line number of each key."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from stemwatch.connectors.settings import KeyPath, Problem
from stemwatch.service.config.problems import PlantFileError

_HEADER = re.compile(r"\s*(\[\[|\[)")
# Only lines that end so can end a statement that spans several lines; of one with a # nobody knows
# whether it ends in a comment.
_CLOSERS = ("]", "}", '"""', "'''")


class TomlLines:
    """The line of each key of a TOML text, which must be valid for ``tomllib``.

    A path is the keys and list positions from the top: ``("valves", 3, "tags", "op", "low")``.
    """

    def __init__(self, text: str) -> None:
        self._lines: dict[KeyPath, int] = {}
        self._lists: dict[KeyPath, int] = {}  # number of [[tables]] of this name so far
        table: KeyPath = ()
        for line, statement in _statements(text):
            parsed = tomllib.loads(statement)
            if header := _HEADER.match(statement):
                table = self._enter(_single_path(parsed), header[1] == "[[", line)
            else:
                self._note(table, parsed, line)

    def of(self, path: KeyPath) -> int | None:
        """The line (counted from 1) of ``path``, or of the nearest enclosing table that has one."""
        while path:
            if path in self._lines:
                return self._lines[path]
            path = path[:-1]
        return None

    def _enter(self, names: list[str], is_list_item: bool, line: int) -> KeyPath:
        path: KeyPath = ()
        for name in names[:-1]:
            path = self._within(path, name)
            self._lines.setdefault(path, line)
        path = (*path, names[-1])
        self._lines.setdefault(path, line)
        if is_list_item:
            position = self._lists.get(path, -1) + 1
            self._lists[path] = position
            path = (*path, position)
            self._lines[path] = line
        return path

    def _within(self, path: KeyPath, name: str) -> KeyPath:
        inner: KeyPath = (*path, name)
        return (*inner, self._lists[inner]) if inner in self._lists else inner

    def _note(self, table: KeyPath, value: Any, line: int) -> None:
        entries = value.items() if isinstance(value, dict) else enumerate(value)
        for name, inner in entries:
            path = (*table, name)
            self._lines.setdefault(path, line)
            if isinstance(inner, dict | list):
                self._note(path, inner, line)


def _single_path(parsed: dict[str, Any]) -> list[str]:
    """The names in a table header, from its parsed form, nested dicts with one key each."""
    names: list[str] = []
    level: Any = parsed
    while level:
        name, level = next(iter(level.items()))
        names.append(name)
        level = level[0] if isinstance(level, list) else level
    return names


def _statements(text: str) -> Iterator[tuple[int, str]]:
    """Each header or ``key = value`` with the number of its first line."""
    open_statement: list[str] = []
    first = 1
    for number, line in enumerate(text.split("\n"), start=1):
        if not open_statement:
            first = number
        open_statement.append(line)
        if len(open_statement) > 1 and not _may_end(line):
            continue
        statement = "\n".join(open_statement)
        if _is_complete(statement):
            yield first, statement
            open_statement = []


def _may_end(line: str) -> bool:
    return "#" in line or line.rstrip().endswith(_CLOSERS)


def _is_complete(statement: str) -> bool:
    try:
        tomllib.loads(statement)
    except tomllib.TOMLDecodeError:
        return False
    return True


_AT_LINE = re.compile(r"\s*\(at line (\d+), column (\d+)\)")
_AT_END = re.compile(r"\s*\(at end of document\)")


def read_toml(file: Path) -> tuple[dict[str, Any], TomlLines]:
    """The tables of ``file`` and the line of each key. Raises ``PlantFileError`` when there is no
    such file, when it is not UTF-8 and when it is not TOML."""
    text = _text(file)
    try:
        return tomllib.loads(text), TomlLines(text)
    except tomllib.TOMLDecodeError as error:
        raise _not_toml(file, text, str(error)) from None
    except RecursionError:
        raise _error(file, None, "brackets inside brackets without end", "plain tables") from None


def _text(file: Path) -> str:
    try:
        raw = file.read_bytes()
    except FileNotFoundError:
        raise _error(file, None, f"no such file in {file.parent}", "a plant file") from None
    except OSError as error:
        found_text = f"a file that cannot be read ({error.strerror})"
        raise _error(file, None, found_text, "a plant file") from None
    try:
        # Windows editors begin UTF-8 with a byte order mark and end lines with two characters.
        return raw.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        found_text = f"the byte 0x{raw[error.start]:02x}, which is not UTF-8"
        raise _error(file, line, found_text, "the file saved as UTF-8") from None


def _not_toml(file: Path, text: str, message: str) -> PlantFileError:
    line = text.count("\n") + 1
    if position := _AT_LINE.search(message):
        line = int(position[1])
    found_text = _AT_LINE.sub("", _AT_END.sub(" at the end of the file", message))
    return _error(file, line, f"text that is not TOML ({found_text})", _advice(text, line, message))


def _advice(text: str, line: int, message: str) -> str:
    shown_line = text.split("\n")[line - 1]
    if "\\" in shown_line and ("Unescaped" in message or "Hex value" in message):
        return "Windows paths in single quotes ('C:\\exports\\*.csv') or with forward slashes"
    if "Cannot overwrite" in message or "Cannot declare" in message:
        return 'each key and each table once; lists of tables have double brackets: "[[valves]]"'
    if "Invalid value" in message:
        return 'a text in quotation marks, a number with a decimal point, true or false, "[list]"'
    return 'TOML: one key = value on a line, texts in "quotation marks"'


def _error(file: Path, line: int | None, found: str, expected: str) -> PlantFileError:
    problem = Problem(file=file.name, line=line, key="file", found=found, expected=expected)
    return PlantFileError([problem])
