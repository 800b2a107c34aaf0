"""The answers to a benchmark: a CSV file with one row a case, in which every field may be empty."""

from __future__ import annotations

import csv
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from math import isfinite
from pathlib import Path

from stemwatch.connectors.settings import nearest
from stemwatch.connectors.spreadsheet import ListFault, decoded, records_of, separator_of
from stemwatch.models.mismatch.terms import catalogue
from stemwatch.service.studies.benchmark.truth import NONE, OTHER

COLUMNS = ("case", "stiction", "S", "S_low", "S_high", "J", "J_low", "J_high", "cause")
MOST_CAUSES = 3
_BETWEEN = ";"  # between two causes; the cell is quoted where the file is separated by it too


class Sticks(StrEnum):
    """Whether the valve sticks."""

    YES = "yes"
    NO = "no"
    CANNOT_TELL = "cannot tell"


@dataclass(frozen=True, kw_only=True)
class Number:
    """A value and its 95 % interval, percent of OP span; what is not known is ``None``."""

    value: float | None = None
    low: float | None = None
    high: float | None = None

    @property
    def interval(self) -> tuple[float, float] | None:
        """The interval, where both ends are given."""
        return None if self.low is None or self.high is None else (self.low, self.high)


@dataclass(frozen=True, kw_only=True)
class CaseAnswer:
    """What a program says of one recording; the default says nothing."""

    stiction: Sticks = Sticks.CANNOT_TELL
    S: Number = Number()
    J: Number = Number()
    causes: tuple[str, ...] = ()  # at most ``MOST_CAUSES``; none of them: nothing is said


class MalformedAnswers(ValueError):
    """A row of an answers file that cannot be read: file, line, what was found and expected."""


def cause_words() -> dict[str, str]:
    """The words for a cause, each with what it means."""
    words = {slug: term.words.plain for slug, term in catalogue().items()}
    nothing = "nothing beside friction and the loop's own quick air"
    return {NONE: nothing, **words, OTHER: "an effect that this list does not have"}


def read_answers(file: Path, cases: Collection[str]) -> dict[str, CaseAnswer]:
    """The answers of ``file`` by case. A case without a row has none.

    Separated by comma, semicolon or tab; a decimal comma is read where the separator is another.
    Raises ``MalformedAnswers``.
    """
    try:
        text = decoded(file.read_bytes())
        separator = separator_of(text)
        records = records_of(text, separator)
    except ListFault as fault:
        raise MalformedAnswers(f"{file}, {fault}") from None
    if not records:
        raise MalformedAnswers(f"{file}: found no row; expected the heading {','.join(COLUMNS)}")
    heading = _heading(file, *records[0])
    answers: dict[str, CaseAnswer] = {}
    for line, cells in records[1:]:
        row = _Row(f"{file}, line {line}", heading, cells, decimal_comma=separator != ",")
        case = row.case(cases)
        if case in answers:
            raise row.fault("case", case, "each case once")
        answers[case] = row.answer()
    return answers


def write_answers(file: Path, answers: Mapping[str, CaseAnswer]) -> None:
    """One row a case, in the order of their names."""
    with file.open("w", encoding="utf-8", newline="") as out:
        rows = csv.writer(out, lineterminator="\n")
        rows.writerow(COLUMNS)
        for case in sorted(answers):
            answer = answers[case]
            numbers = [
                "" if x is None else f"{x:.4f}"
                for n in (answer.S, answer.J)
                for x in (n.value, n.low, n.high)
            ]
            rows.writerow([case, answer.stiction.value, *numbers, _BETWEEN.join(answer.causes)])


def _heading(file: Path, line: int, cells: Sequence[str]) -> dict[str, int]:
    heading: dict[str, int] = {}
    for place, cell in enumerate(cells):
        name = cell.strip()
        if name not in COLUMNS or name in heading:
            raise MalformedAnswers(
                f"{file}, line {line}: found the column {name!r}; expected some of "
                f"{', '.join(COLUMNS)}, each once{nearest(name, COLUMNS)}"
            )
        heading[name] = place
    if "case" not in heading:
        raise MalformedAnswers(f"{file}, line {line}: found no column 'case'; expected one")
    return heading


class _Row:
    """One record of the file, read cell by cell."""

    def __init__(
        self, place: str, heading: Mapping[str, int], cells: Sequence[str], *, decimal_comma: bool
    ) -> None:
        self.place, self.decimal_comma = place, decimal_comma
        if len(cells) > len(heading):
            raise MalformedAnswers(
                f"{place}: found {len(cells)} cells; expected {len(heading)}, as in the heading"
            )
        self.cells = {name: cells[at].strip() for name, at in heading.items() if at < len(cells)}

    def fault(self, column: str, found: str, expected: str) -> MalformedAnswers:
        return MalformedAnswers(f"{self.place}: {column}: found {found!r}; expected {expected}")

    def case(self, cases: Collection[str]) -> str:
        case = self.cells.get("case", "").removesuffix(".csv")
        if case not in cases:
            expected = f"the name of a recording of this benchmark{nearest(case, cases)}"
            raise self.fault("case", case, expected)
        return case

    def answer(self) -> CaseAnswer:
        return CaseAnswer(
            stiction=self._stiction(),
            S=self._number("S"),
            J=self._number("J"),
            causes=self._causes(),
        )

    def _stiction(self) -> Sticks:
        word = self.cells.get("stiction", "").lower()
        try:
            return Sticks(word) if word else Sticks.CANNOT_TELL
        except ValueError:
            words = "yes, no, cannot tell, or nothing"
            raise self.fault("stiction", word, words) from None

    def _number(self, name: str) -> Number:
        value, low, high = (self._float(column) for column in (name, f"{name}_low", f"{name}_high"))
        if (low is None) != (high is None):
            raise self.fault(f"{name}_low", self.cells.get(f"{name}_low", ""), "both ends, or none")
        if low is not None and high is not None and low > high:
            raise self.fault(f"{name}_low", str(low), f"at most {name}_high, {high}")
        return Number(value=value, low=low, high=high)

    def _float(self, column: str) -> float | None:
        cell = self.cells.get(column, "")
        if not cell:
            return None
        try:
            number = float(cell.replace(",", ".") if self.decimal_comma else cell)
        except ValueError:
            number = float("nan")
        if not cell.isascii() or "_" in cell:  # Python's float reads 1_0 as 10
            number = float("nan")
        if not isfinite(number) or not 0.0 <= number <= 1000.0:
            raise self.fault(column, cell, "a number of percent from 0 to 1000, or nothing")
        return number

    def _causes(self) -> tuple[str, ...]:
        words = [word.strip() for word in self.cells.get("cause", "").split(_BETWEEN)]
        causes = tuple(dict.fromkeys(word for word in words if word))
        known = cause_words()
        for word in causes:
            if word not in known:
                expected = f"a word of the benchmark's page{nearest(word, known)}"
                raise self.fault("cause", word, expected)
        if len(causes) > MOST_CAUSES:
            raise self.fault("cause", self.cells["cause"], f"at most {MOST_CAUSES} causes")
        return causes
