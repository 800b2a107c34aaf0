"""The ranking of the pages: valves with their latest screening, filtered, sorted and paged.

Severity and state of work are decided by the presenter, as in reports.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import groupby
from typing import Any, Literal, get_args

from sqlalchemy import ColumnElement, Select, and_, case, literal, or_, select
from sqlalchemy.orm import Session

from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.findings import Finding
from stemwatch.models.oscillation_groups.plant_groups import OscillationGroup
from stemwatch.models.recording import PERCENT
from stemwatch.models.screening_result import PreviousFinding
from stemwatch.models.verdict import WORST_FIRST, NoVerdict, Shape, Verdict
from stemwatch.models.without_position.suspicion import WithoutPosition
from stemwatch.service.plant_path import (
    LEVELS,
    PartOfPlant,
    PlantPath,
    UnknownPart,
    levels_of,
)
from stemwatch.service.presenter.suspicion_words import score_of_suspicion
from stemwatch.service.presenter.urgency import Priority, UrgencyKey, priority_of, urgency_key
from stemwatch.service.presenter.wording import finite
from stemwatch.service.presenter.work_decision import (
    NO_POSITION,
    STATE_OF,
    WorkDecision,
    WorkState,
    confidence_in,
    is_moved,
    kinds_of,
    ne107_word,
    overall_verdict,
    severity_of,
)
from stemwatch.service.store.screenings.named_effects import standing_columns, standing_defects
from stemwatch.service.store.screenings.part_of_plant import in_part, read_levels
from stemwatch.service.store.screenings.previous import read_previous_of
from stemwatch.service.store.screenings.rows import no_verdict_of, without_position_of
from stemwatch.service.store.screenings.screenings import latest_screening_id
from stemwatch.service.store.screenings.tables import ScreeningRow, ValveRow

PAGE = 50
MOST_PAGE = 500
NOT_SCREENED = "none"
Sort = Literal[
    "rank",
    "valve",
    "area",
    "unit",
    "criticality",
    "cost",
    "S",
    "J",
    "severity",
    "confidence",
    "at",
    "grade",
]
SORTS: tuple[str, ...] = get_args(Sort)
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
    advice: str
    no_verdict: NoVerdict
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
    priority: Priority | None  # of its work order, where it has one
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
    valves before the filter by verdict, and so do ``orders``."""

    lines: tuple[RankingLine, ...]
    counts: Mapping[str, int]
    states: Mapping[WorkState, int]
    orders: int  # of the valves that cannot be judged, those with a work order to find out why
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

    Long columns are read only where needed: the remark where an effect was named, what OP and PV
    alone say where there is no verdict.
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
        ScreeningRow.no_verdict,
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


def _decided(row: Any, groups: Sequence[OscillationGroup] = ()) -> WorkDecision | None:
    """The decision on a row with the columns of ``_deciding``, as in every report; ``None`` where
    the valve has not been screened."""
    if row.verdict is None:
        return None
    verdict = Verdict(row.verdict)
    named = standing_defects(row)
    kinds = kinds_of(
        verdict,
        shape=None if row.shape is None else Shape(row.shape),
        no_verdict=no_verdict_of(row),
        named=named,
        finding=None if row.finding is None else Finding(row.finding),
    )
    told = without_position_of(row.suspicion)
    alone = told if kinds[0] == NO_POSITION else None
    return WorkDecision(
        verdict=overall_verdict(verdict, named=bool(named)),
        kinds=kinds,
        severity=finite(severity_of(verdict, row.severity, kinds, told)) or 0.0,
        no_sign=alone is not None and alone.leaves_nothing_to_do,
        moved=is_moved(kinds, told, groups, row.id),
    )


def _urgency(row: Any, decision: WorkDecision | None) -> UrgencyKey:
    score = 0.0
    if decision is not None and row.suspicion is not None:
        score = score_of_suspicion(Verdict(row.verdict), without_position_of(row.suspicion))
    return urgency_key(decision, str(row.criticality), score, row.id)


def _in_order(
    rows: Sequence[Any],
    decided: Mapping[str, WorkDecision | None],
    ranking_filter: RankingFilter,
    costs: Mapping[str, float],
) -> list[Any]:
    """The rows in the wanted order. Where the database has sorted them, rows with equal values are
    ordered by urgency."""

    def urgency(row: Any) -> UrgencyKey:
        return _urgency(row, decided[row.id])

    sign = -1.0 if ranking_filter.descending else 1.0
    if ranking_filter.sort in _SORTED_IN_SQL:
        groups = groupby(rows, key=lambda row: row.sorted_by)
        return [row for _, equal_rows in groups for row in sorted(equal_rows, key=urgency)]
    ordered = sorted(rows, key=urgency)
    if ranking_filter.sort == "severity":
        severities = {valve: one.severity for valve, one in decided.items() if one is not None}
        ordered.sort(key=lambda row: (row.id not in severities, sign * severities.get(row.id, 0.0)))
    elif ranking_filter.sort == "cost":
        ordered.sort(key=lambda row: (row.id not in costs, sign * costs.get(row.id, 0.0)))
    elif ranking_filter.descending:
        ordered.reverse()
    return ordered


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
    session: Session,
    ranking_filter: RankingFilter,
    costs: Mapping[str, float],
    groups: Sequence[OscillationGroup],
) -> RankingPage:
    """One page of the ranking; ``costs`` of valves a month, for an order by them; ``groups`` of
    loops that oscillate together, one of which may move a valve without a position.

    All latest screenings are read with the few columns that order and counts need; the other
    columns only for the lines of the page. Texts are compared by the database.
    """
    column = _SORTED_IN_SQL.get(ranking_filter.sort, literal(0))
    direction = column.desc() if ranking_filter.descending else column.asc()
    statement = _joined(*_deciding(), column.label("sorted_by")).where(*_conditions(ranking_filter))
    statement = statement.order_by(direction.nulls_last(), ValveRow.id)
    counts = dict.fromkeys([*(verdict.value for verdict in WORST_FIRST), NOT_SCREENED], 0)
    chosen: list[tuple[str, int | None, WorkDecision | None]] = []
    states = dict.fromkeys(WorkState, 0)
    largest, orders = 0.0, 0
    # Not through the session, whose rows cost several times as much: these are all valves.
    rows = session.connection().execute(statement).all()
    decided = {row.id: _decided(row, groups) for row in rows}
    for row in _in_order(rows, decided, ranking_filter, costs):
        decision = decided[row.id]
        word = NOT_SCREENED if decision is None else decision.verdict.value
        counts[word] += 1
        if decision is not None:
            states[decision.state] += 1
            orders += decision.has_order and not decision.needs_work
        largest = max(largest, row.s_percent or 0.0, row.j_percent or 0.0)
        if not ranking_filter.verdicts or word in ranking_filter.verdicts:
            chosen.append((row.id, row.screening_id, decision))
    first = (ranking_filter.page - 1) * ranking_filter.size
    page = chosen[first : first + ranking_filter.size]
    return RankingPage(
        lines=_lines(session, page, first + 1),
        counts=counts,
        states=states,
        orders=orders,
        total=len(chosen),
        levels=read_levels(session),
        largest_percent=largest,
    )


def read_work_states(session: Session, until: datetime) -> dict[WorkState, int]:
    """How many valves stood where at ``until``, by the latest screening that each had then."""
    states = dict.fromkeys(WorkState, 0)
    for row in session.connection().execute(_joined(*_deciding(), until=until)).all():
        decision = _decided(row)
        if decision is not None:
            states[decision.state] += 1
    return states


def read_places(session: Session) -> dict[str, int]:
    """The place in the ranking, from 1, of each valve that was screened, by its latest screening.

    A loop that another one moves has the place of one that is to be found out about: no alert is
    raised on either.
    """
    screened = _joined(*_deciding()).where(ScreeningRow.id.is_not(None))
    rows = session.connection().execute(screened).all()
    ordered = sorted(rows, key=lambda row: _urgency(row, _decided(row)))
    return {row.id: place for place, row in enumerate(ordered, start=1)}


def read_worst(session: Session, run_id: int, limit: int) -> list[str]:
    """The valves of a run, the one to work on first at the front, at most ``limit``."""
    of_run = select(*_deciding()).join(ScreeningRow, ScreeningRow.valve == ValveRow.id)
    rows = session.connection().execute(of_run.where(ScreeningRow.run_id == run_id)).all()
    ordered = sorted(rows, key=lambda row: _urgency(row, _decided(row)))
    return list(dict.fromkeys(row.id for row in ordered))[:limit]


def read_without_verdict(session: Session) -> list[LoopWithoutVerdict]:
    """The valves whose latest screening has no verdict and says what OP and PV alone tell."""
    told = (
        ScreeningRow.verdict,
        ScreeningRow.no_verdict,
        ScreeningRow.reason,
        ScreeningRow.advice,
        ScreeningRow.without_position,
    )
    statement = _joined(ValveRow.id, *told).where(
        ScreeningRow.verdict == Verdict.UNDETERMINED.value
    )
    return [
        LoopWithoutVerdict(
            valve=row.id,
            verdict=Verdict.UNDETERMINED,
            reason=row.reason,
            advice=row.advice,
            no_verdict=no_verdict_of(row) or NoVerdict.UNKNOWN,
            without_position=without_position_of(row.without_position),
        )
        for row in session.execute(statement)
        if row.without_position is not None
    ]


def _lines(
    session: Session, chosen: Sequence[tuple[str, int | None, WorkDecision | None]], rank: int
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
        _line(rows[valve], rank + k, decision, None if number is None else before.get(number))
        for k, (valve, number, decision) in enumerate(chosen)
    )


def _line(
    row: Any, rank: int, decision: WorkDecision | None, previous: PreviousFinding | None
) -> RankingLine:
    defects = standing_defects(row)
    return RankingLine(
        place=rank,
        valve=row.id,
        description=row.description,
        **levels_of(row),
        criticality=row.criticality,
        verdict=None if decision is None else decision.verdict,
        stem_verdict=None if row.verdict is None else Verdict(row.verdict),
        at=row.at,
        severity=0.0 if decision is None else decision.severity,
        priority=None if decision is None else priority_of(decision, str(row.criticality)),
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
