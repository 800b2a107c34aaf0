"""The line of each key in a TOML text, which ``tomllib`` does not tell."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from typing import Any

Path = tuple[str | int, ...]

_HEADER = re.compile(r"\s*(\[\[|\[)")
# Only lines holding one of these can end a statement that spans several lines.
_CLOSERS = ("]", "}", '"""', "'''")


class TomlLines:
    """Where each key of a TOML text stands; the text must be one that ``tomllib`` accepts.

    A path is the keys and list positions from the top: ``("valves", 3, "tags", "op", "low")``.
    """

    def __init__(self, text: str) -> None:
        self._lines: dict[Path, int] = {}
        self._lists: dict[Path, int] = {}  # how many [[tables]] of this name there were so far
        table: Path = ()
        for line, statement in _statements(text):
            parsed = tomllib.loads(statement)
            if header := _HEADER.match(statement):
                table = self._enter(_single_path(parsed), header[1] == "[[", line)
            else:
                self._note(table, parsed, line)

    def of(self, path: Path) -> int | None:
        """The line (from 1) of ``path``, or of the nearest table around it that has one."""
        while path:
            if path in self._lines:
                return self._lines[path]
            path = path[:-1]
        return None

    def _enter(self, names: list[str], is_list_item: bool, line: int) -> Path:
        path: Path = ()
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

    def _within(self, path: Path, name: str) -> Path:
        inner: Path = (*path, name)
        return (*inner, self._lists[inner]) if inner in self._lists else inner

    def _note(self, table: Path, value: Any, line: int) -> None:
        entries = value.items() if isinstance(value, dict) else enumerate(value)
        for name, inner in entries:
            path = (*table, name)
            self._lines.setdefault(path, line)
            if isinstance(inner, dict | list):
                self._note(path, inner, line)


def _single_path(parsed: dict[str, Any]) -> list[str]:
    """The names in a table header, from what it parses to: one key inside another."""
    names: list[str] = []
    level: Any = parsed
    while level:
        name, level = next(iter(level.items()))
        names.append(name)
        level = level[0] if isinstance(level, list) else level
    return names


def _statements(text: str) -> Iterator[tuple[int, str]]:
    """Each header or ``key = value`` with the number of its first line."""
    begun: list[str] = []
    first = 1
    for number, line in enumerate(text.split("\n"), start=1):
        if not begun:
            first = number
        begun.append(line)
        if len(begun) > 1 and not any(closer in line for closer in _CLOSERS):
            continue
        statement = "\n".join(begun)
        if _is_complete(statement):
            yield first, statement
            begun = []


def _is_complete(statement: str) -> bool:
    try:
        tomllib.loads(statement)
    except tomllib.TOMLDecodeError:
        return False
    return True
