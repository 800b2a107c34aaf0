"""``Problem``: one mistake in a plant file, said so that it can be mended without asking."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Problem:
    """One mistake: where it stands, what was found there and what was expected."""

    file: str
    line: int | None  # None where no line can be named: the file itself is not there
    key: str  # valves[FIC-101].tags.op.low, or the column of a valve list
    found: str
    expected: str

    def __str__(self) -> str:
        line = "" if self.line is None else f", line {self.line}"
        return f"{self.file}{line}: {self.key}: found {self.found}; expected {self.expected}"


class PlantFileError(Exception):
    """The plant file cannot be used as a whole. ``problems`` holds every mistake found."""

    def __init__(self, problems: Sequence[Problem]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(str(problem) for problem in self.problems))

    def __reduce__(self) -> tuple[type[PlantFileError], tuple[tuple[Problem, ...]]]:
        return PlantFileError, (self.problems,)
