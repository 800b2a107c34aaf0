"""The ranking of the pages: valves with their latest screening, filtered, sorted and paged.

Severity and state of work are decided by the presenter, as in reports.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import groupby
from typing import Any

from sqlalchemy import ColumnElement, Select, and_, case, literal, or_, select
from sqlalchemy.orm import Session

from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.findings import Finding
from stemwatch.models.recording import PERCENT
from stemwatch.models.screening_result import PreviousFinding
from stemwatch.models.verdict import WORST_FIRST, Shape, Verdict
from stemwatch.models.without_position.suspicion import WithoutPosition
from stemwatch.service.presenter.plant_path import (
    LEVELS,
    PartOfPlant,
    PlantPath,
    UnknownPart,
    levels_of,
    names_by_level,
)
from stemwatch.service.presenter.suspicion_words import score_of_suspicion
from stemwatch.service.presenter.wording import finite
from stemwatch.service.presenter.work_decision import (
    STATE_OF,
    WorkState,
    confidence_in,
    kinds_of,
    ne107_word,
    overall_verdict,
    severity_of,
)
from stemwatch.service.store.screenings.named_effects import standing_columns, standing_defects
from stemwatch.service.store.screenings.previous import read_previous_of
from stemwatch.service.store.screenings.rows import without_position_of
from stemwatch.service.store.screenings.screenings import latest_screening_id
from stemwatch.service.store.screenings.tables import ScreeningRow, ValveRow

PAGE = 50
MOST_PAGE = 500
NOT_SCREENED = "none"
SORTS = (
    *("rank", "valve", "area", "unit", "criticality", "cost", "S", "J", "severity", "confidence"),
    *("at", "grade"),
)
# Columns that are sorted with the largest value first by default.
LARGEST_FIRST = ("criticality", "cost", "S", "J", "severity", "confidence", "at")


@dataclass(frozen=True, kw_only=True)
class RankingFilter:
    """Which valves, in which order. Empty filters keep everything; ``page`` counts from 1."""

    text: str = ""
    sites: tuple[str, ...] = ()
    areas: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    verdicts: tuple[str, ...] = ()  # of ``Verdict``, or "none": not screened yet
    criticalities: tuple[int, ...] = ()
    sort: str = "rank"
    descending: bool = False
    page: int = 1
    size: int = PAGE

    @property
    def part(self) -> PartOfPlant:
        """The sites, areas and units."""
        return PartOfPlant(sites=self.sites, areas=self.areas, units=self.units)


@dataclass(frozen=True, kw_only=True)
class LoopWithoutVerdict:
    """A valve whose latest screening has no verdict, and what OP and PV alone say there."""

    valve: str
    verdict: Verdict
    reason: str
    without_position: WithoutPosition | None


@dataclass(frozen=True, kw_only=True)
class RankingLine(PlantPath):
    """A valve in the ranking. ``verdict`` is on the valve, ``stem_verdict`` by S and J alone, both
    ``None`` where it has not been screened. ``confidence`` is that in ``stem_verdict``."""

    place: int
    valve: str
    description: str
    criticality: int
    verdict: Verdict | None
    stem_verdict: Verdict | None
    at: datetime | None
    severity: float
    confidence: float | None
    grade: str
    shape: str | None
    S: Estimate
    J: Estimate
    left_out: tuple[str, ...]
    held_back: bool  # the named effects do not stand among all valves of the run
    previous: PreviousFinding | None

    @property
    def state(self) -> WorkState | None:
        """Whether the valve needs work; ``None`` where it has not been screened."""
        return None if self.verdict is None else STATE_OF[self.verdict]

    @property
    def ne107(self) -> str | None:
        """Its state by NAMUR NE 107; ``None`` where there is no verdict."""
        return ne107_word(self.verdict)

    @property
    def sure(self) -> float | None:
        """The confidence in ``verdict``, 0 to 1."""
        return None if self.verdict is None else confidence_in(self.verdict, self.confidence)


@dataclass(frozen=True, kw_only=True)
class RankingPage:
    """One page of the ranking. ``counts`` by verdict and ``states`` by state of work count the
    valves before the filter by verdict."""

    lines: tuple[RankingLine, ...]
    counts: Mapping[str, int]
    states: Mapping[WorkState, int]
    total: int
    levels: Mapping[str, tuple[str, ...]]  # the names of sites, areas and units that there are
    largest_percent: float  # the largest S or J of all filtered valves, the scale of the bars

    def unknown(self, ranking_filter: RankingFilter) -> str:
        """Which site, area or unit of the filter there is not, with those there are; empty where
        each is there."""
        try:
            ranking_filter.part.check(self.levels)
        except UnknownPart as error:
            return str(error)
        return ""


def _joined(*columns: Any, until: datetime | None = None) -> Select[Any]:
    latest = ScreeningRow.id == latest_screening_id(until=until)
    return select(*columns).select_from(ValveRow).outerjoin(ScreeningRow, latest)


def _conditions(ranking_filter: RankingFilter) -> list[ColumnElement[bool]]:
    """All filters except that by verdict, which is applied after the verdicts are counted."""
    conditions: list[ColumnElement[bool]] = []
    for word in ranking_filter.text.split():
        named = (ValveRow.id, ValveRow.description, *(getattr(ValveRow, level) for level in LEVELS))
        conditions.append(or_(*(column.icontains(word, autoescape=True) for column in named)))
    conditions += in_part(ranking_filter.part)
    if ranking_filter.criticalities:
        conditions.append(ValveRow.criticality.in_(ranking_filter.criticalities))
    return conditions


def _deciding() -> tuple[Any, ...]:
    """The columns from which state of work and order are decided.

    Long columns are read only where needed: the remark where an effect was named, the reason where
    there is no verdict.
    """
    undetermined = ScreeningRow.verdict == Verdict.UNDETERMINED.value
    return (
        ValveRow.id,
        ValveRow.criticality,
        ScreeningRow.id.label("screening_id"),
        ScreeningRow.verdict,
        ScreeningRow.shape,
        ScreeningRow.severity,
        ScreeningRow.s_percent,
        ScreeningRow.j_percent,
        ScreeningRow.mismatch_finding.label("finding"),
        ScreeningRow.mismatch_slugs,
        *standing_columns(),
        case((undetermined, ScreeningRow.reason)).label("why"),
        case((undetermined, ScreeningRow.without_position)).label("suspicion"),
    )


_SORTED_IN_SQL: dict[str, Any] = {
    "valve": ValveRow.id,
    "area": ValveRow.area,
    "unit": ValveRow.unit,
    "criticality": ValveRow.criticality,
    "S": ScreeningRow.s_percent,
    "J": ScreeningRow.j_percent,
    "confidence": ScreeningRow.confidence,
    "at": ScreeningRow.at,
    "grade": ScreeningRow.grade,
}


def _decided(row: Any) -> tuple[Verdict | None, float]:
    """Verdict on the valve and severity of a row with the columns of ``_deciding``, as in every
    report; ``None`` and 0 where the valve has not been screened."""
    if row.verdict is None:
        return None, 0.0
    verdict = Verdict(row.verdict)
    named = standing_defects(row)
    kinds = kinds_of(
        verdict,
        shape=None if row.shape is None else Shape(row.shape),
        reason=row.why or "",
        named=named,
        finding=None if row.finding is None else Finding(row.finding),
    )
    severity = finite(severity_of(verdict, row.severity, kinds)) or 0.0
    return overall_verdict(verdict, named=bool(named)), severity


def _in_order(
    rows: Sequence[Any], ranking_filter: RankingFilter, costs: Mapping[str, float]
) -> list[tuple[Any, Verdict | None, float]]:
    """The rows in the wanted order, each with verdict and severity. Where the database has sorted
    them, rows with equal values are ordered worst first."""
    decided = {row.id: _decided(row) for row in rows}

    def urgency(row: Any) -> tuple[int, float, float]:
        verdict, severity = decided[row.id]
        if verdict is None:
            return len(WORST_FIRST), 0.0, 0.0
        score = score_of_suspicion(verdict, without_position_of(row.suspicion))
        return WORST_FIRST.index(verdict), -severity, -score

    def worst_first(row: Any) -> tuple[Any, ...]:
        return *urgency(row), -row.criticality

    ordered: list[Any] = []
    if ranking_filter.sort in _SORTED_IN_SQL:
        for _, equal_rows in groupby(rows, key=lambda row: row.sorted_by):
            ordered += sorted(equal_rows, key=worst_first)
    elif ranking_filter.sort == "severity":
        sign = -1.0 if ranking_filter.descending else 1.0
        ordered = sorted(rows, key=worst_first)
        ordered.sort(key=lambda row: (row.verdict is None, sign * decided[row.id][1]))
    elif ranking_filter.sort == "cost":
        sign = -1.0 if ranking_filter.descending else 1.0
        ordered = sorted(rows, key=worst_first)
        ordered.sort(key=lambda row: (row.id not in costs, sign * costs.get(row.id, 0.0)))
    elif ranking_filter.descending:
        ordered = sorted(rows, key=urgency, reverse=True)
    else:
        ordered = sorted(rows, key=worst_first)
    return [(row, *decided[row.id]) for row in ordered]


_COLUMNS = (
    ValveRow.id,
    ValveRow.description,
    *(getattr(ValveRow, level) for level in LEVELS),
    ValveRow.criticality,
    ScreeningRow.id.label("screening_id"),
    ScreeningRow.verdict,
    ScreeningRow.at,
    ScreeningRow.confidence,
    ScreeningRow.grade,
    ScreeningRow.shape,
    ScreeningRow.s_percent,
    ScreeningRow.s_low_percent,
    ScreeningRow.s_high_percent,
    ScreeningRow.s_reason,
    ScreeningRow.j_percent,
    ScreeningRow.j_low_percent,
    ScreeningRow.j_high_percent,
    ScreeningRow.j_reason,
    ScreeningRow.mismatch_slugs,
    *standing_columns(),
)


def read_ranking(
    session: Session, ranking_filter: RankingFilter, costs: Mapping[str, float]
) -> RankingPage:
    """One page of the ranking; ``costs`` of valves a month, for an order by them.

    All latest screenings are read with the few columns that order and counts need; the other
    columns only for the lines of the page. Texts are compared by the database.
    """
    column = _SORTED_IN_SQL.get(ranking_filter.sort, literal(0))
    direction = column.desc() if ranking_filter.descending else column.asc()
    statement = _joined(*_deciding(), column.label("sorted_by")).where(*_conditions(ranking_filter))
    statement = statement.order_by(direction.nulls_last(), ValveRow.id)
    counts = dict.fromkeys([*(verdict.value for verdict in WORST_FIRST), NOT_SCREENED], 0)
    chosen: list[tuple[str, int | None, float]] = []
    states = dict.fromkeys(WorkState, 0)
    largest = 0.0
    # Not through the session, whose rows cost several times as much: these are all valves.
    rows = session.connection().execute(statement).all()
    for row, verdict, severity in _in_order(rows, ranking_filter, costs):
        word = NOT_SCREENED if verdict is None else verdict.value
        counts[word] += 1
        if verdict is not None:
            states[STATE_OF[verdict]] += 1
        largest = max(largest, row.s_percent or 0.0, row.j_percent or 0.0)
        if not ranking_filter.verdicts or word in ranking_filter.verdicts:
            chosen.append((row.id, row.screening_id, severity))
    first = (ranking_filter.page - 1) * ranking_filter.size
    page = chosen[first : first + ranking_filter.size]
    return RankingPage(
        lines=_lines(session, page, first + 1),
        counts=counts,
        states=states,
        total=len(chosen),
        levels=read_levels(session),
        largest_percent=largest,
    )


def read_work_states(session: Session, until: datetime) -> dict[WorkState, int]:
    """How many valves stood where at ``until``, by the latest screening that each had then."""
    states = dict.fromkeys(WorkState, 0)
    for row in session.connection().execute(_joined(*_deciding(), until=until)).all():
        verdict, _ = _decided(row)
        if verdict is not None:
            states[STATE_OF[verdict]] += 1
    return states


def read_without_verdict(session: Session) -> list[LoopWithoutVerdict]:
    """The valves whose latest screening has no verdict and says what OP and PV alone tell."""
    statement = _joined(ValveRow.id, ScreeningRow.reason, ScreeningRow.without_position).where(
        ScreeningRow.verdict == Verdict.UNDETERMINED.value
    )
    return [
        LoopWithoutVerdict(
            valve=row.id,
            verdict=Verdict.UNDETERMINED,
            reason=row.reason,
            without_position=without_position_of(row.without_position),
        )
        for row in session.execute(statement)
        if row.without_position is not None
    ]


def _lines(
    session: Session, chosen: Sequence[tuple[str, int | None, float]], rank: int
) -> tuple[RankingLine, ...]:
    """The lines of these valves and screenings, in this order, counted from ``rank``."""
    screenings = [number for _, number, _ in chosen if number is not None]
    of_valve = and_(ScreeningRow.valve == ValveRow.id, ScreeningRow.id.in_(screenings))
    statement = select(*_COLUMNS).select_from(ValveRow).outerjoin(ScreeningRow, of_valve)
    valves = [valve for valve, _, _ in chosen]
    rows: dict[str, Any] = {
        row.id: row for row in session.execute(statement.where(ValveRow.id.in_(valves)))
    }
    before = read_previous_of(session, screenings)
    return tuple(
        _line(rows[valve], rank + k, severity, None if number is None else before.get(number))
        for k, (valve, number, severity) in enumerate(chosen)
    )


def in_part(part: PartOfPlant) -> list[ColumnElement[bool]]:
    """The conditions for a row of valves to be in ``part``."""
    return [getattr(ValveRow, level).in_(names) for level, names in part.asked.items()]


def read_levels(session: Session) -> dict[str, tuple[str, ...]]:
    """The sites, areas and units that valves are in, by name."""
    columns = (getattr(ValveRow, level) for level in LEVELS)
    rows = session.execute(select(*columns).distinct())
    return names_by_level(PlantPath(**dict(zip(LEVELS, row, strict=True))) for row in rows)


def read_valves_in(session: Session, part: PartOfPlant) -> list[str]:
    """The valves of a part of the plant, by id."""
    query = select(ValveRow.id).where(*in_part(part)).order_by(ValveRow.id)
    return list(session.scalars(query))


def _line(row: Any, rank: int, severity: float, previous: PreviousFinding | None) -> RankingLine:
    stem = None if row.verdict is None else Verdict(row.verdict)
    defects = standing_defects(row)
    return RankingLine(
        place=rank,
        valve=row.id,
        description=row.description,
        **levels_of(row),
        criticality=row.criticality,
        verdict=None if stem is None else overall_verdict(stem, named=bool(defects)),
        stem_verdict=stem,
        at=row.at,
        severity=severity,
        confidence=row.confidence,
        grade=row.grade or "",
        shape=row.shape,
        S=_estimate(row.s_percent, row.s_low_percent, row.s_high_percent, row.s_reason),
        J=_estimate(row.j_percent, row.j_low_percent, row.j_high_percent, row.j_reason),
        left_out=tuple(dict.fromkeys((*defects, *(row.mismatch_slugs or ())))),
        held_back=bool(row.held_back),
        previous=previous,
    )


def _estimate(
    value: float | None, low: float | None, high: float | None, reason: str | None
) -> Estimate:
    if value is None:
        return Estimate.unknown(reason or "not screened yet", unit=PERCENT)
    return Estimate(value=value, low=low, high=high, unit=PERCENT)
