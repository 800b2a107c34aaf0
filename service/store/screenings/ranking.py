"""The ranking: one page of valves, each with its latest screening, filtered and sorted in SQL."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from sqlalchemy import ColumnElement, Select, and_, case, func, or_, select
from sqlalchemy.orm import Session

from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.findings import Finding
from stemwatch.models.recording import PERCENT
from stemwatch.models.screening_result import PreviousFinding
from stemwatch.models.verdict import WORST_FIRST, Verdict
from stemwatch.service.presenter.work_decision import WorkState, work_state
from stemwatch.service.store.screenings.false_discoveries import remark_column
from stemwatch.service.store.screenings.previous import read_previous_of
from stemwatch.service.store.screenings.screenings import latest_screening_id
from stemwatch.service.store.screenings.tables import ScreeningRow, ValveRow

PAGE = 50
MOST_PAGE = 500
NOT_SCREENED = "none"
SORTS = ("rank", "valve", "area", "criticality", "S", "J", "severity", "confidence", "at", "grade")
# What reads best from its large end.
LARGEST_FIRST = ("criticality", "S", "J", "severity", "confidence", "at")


@dataclass(frozen=True, kw_only=True)
class RankingFilter:
    """Which valves, in which order. Empty filters keep everything; ``page`` counts from 1."""

    text: str = ""
    areas: tuple[str, ...] = ()
    verdicts: tuple[str, ...] = ()  # of ``Verdict``, or "none": not screened yet
    criticalities: tuple[int, ...] = ()
    sort: str = "rank"
    descending: bool = False
    page: int = 1
    size: int = PAGE


@dataclass(frozen=True, kw_only=True)
class RankingLine:
    """A valve in the ranking; ``verdict`` is ``None`` where it was not screened yet."""

    place: int
    valve: str
    description: str
    area: str
    criticality: int
    verdict: Verdict | None
    at: datetime | None
    severity: float
    confidence: float | None
    grade: str
    shape: str | None
    S: Estimate
    J: Estimate
    left_out: tuple[str, ...]
    held_back: bool  # what was left out does not stand among all valves of its run
    previous: PreviousFinding | None

    @property
    def state(self) -> WorkState | None:
        """Where the valve stands with maintenance; ``None`` where it was not screened yet."""
        named = bool(self.left_out) and not self.held_back
        return None if self.verdict is None else work_state(self.verdict, named=named)


@dataclass(frozen=True, kw_only=True)
class RankingPage:
    """One page, and how many valves there are of each verdict and in each state of work before the
    filter of the verdict."""

    lines: tuple[RankingLine, ...]
    counts: Mapping[str, int]
    states: Mapping[WorkState, int]
    total: int
    areas: tuple[str, ...]
    largest_percent: float  # the largest S or J of all that is wanted, for the bars


def _joined(*columns: Any) -> Select[Any]:
    latest = ScreeningRow.id == latest_screening_id()
    return select(*columns).select_from(ValveRow).outerjoin(ScreeningRow, latest)


def _conditions(wanted: RankingFilter) -> list[ColumnElement[bool]]:
    """Every filter but that of the verdict, before which the verdicts are counted."""
    found: list[ColumnElement[bool]] = []
    for word in wanted.text.split():
        named = (ValveRow.id, ValveRow.description, ValveRow.area)
        found.append(or_(*(column.icontains(word, autoescape=True) for column in named)))
    if wanted.areas:
        found.append(ValveRow.area.in_(wanted.areas))
    if wanted.criticalities:
        found.append(ValveRow.criticality.in_(wanted.criticalities))
    return found


def _stands() -> ColumnElement[int]:
    """1 where an effect beside friction was named and is not held back, else 0.

    The remark is looked up only where something was named: it lies in a large column.
    """
    held_back = func.coalesce(remark_column(), "") != ""
    named = ScreeningRow.mismatch_finding.in_([Finding.NAMED.value, Finding.CANDIDATES.value])
    return case((named, case((held_back, 0), else_=1)), else_=0)


def _order(wanted: RankingFilter) -> list[Any]:
    gravity = case(
        {verdict.value: place for place, verdict in enumerate(WORST_FIRST)},
        value=ScreeningRow.verdict,
        else_=len(WORST_FIRST),
    )
    needs_work = case(
        (ScreeningRow.verdict == Verdict.STICKY.value, 0), (_stands() == 1, 0), else_=1
    )
    worst_first = [
        needs_work.asc(),
        gravity.asc(),
        func.coalesce(ScreeningRow.severity, 0.0).desc(),
        ValveRow.criticality.desc(),
    ]
    columns: dict[str, Any] = {
        "valve": ValveRow.id,
        "area": ValveRow.area,
        "criticality": ValveRow.criticality,
        "S": ScreeningRow.s_percent,
        "J": ScreeningRow.j_percent,
        "severity": ScreeningRow.severity,
        "confidence": ScreeningRow.confidence,
        "at": ScreeningRow.at,
        "grade": ScreeningRow.grade,
    }
    if wanted.sort not in columns:
        turned = [
            needs_work.desc(),
            gravity.desc(),
            func.coalesce(ScreeningRow.severity, 0.0).asc(),
        ]
        return [*(turned if wanted.descending else worst_first), ValveRow.id]
    column = columns[wanted.sort]
    way = column.desc() if wanted.descending else column.asc()
    return [way.nulls_last(), *worst_first, ValveRow.id]


_COLUMNS = (
    ValveRow.id,
    ValveRow.description,
    ValveRow.area,
    ValveRow.criticality,
    ScreeningRow.id.label("screening_id"),
    ScreeningRow.verdict,
    ScreeningRow.at,
    ScreeningRow.severity,
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
    remark_column(),
)


def read_ranking(session: Session, wanted: RankingFilter) -> RankingPage:
    """One page of the ranking.

    The latest screenings are looked up once, with the few numbers that order and counts need; the
    rest is read of the lines that are shown.
    """
    stands = _stands().label("stands")
    numbers = (ScreeningRow.verdict, stands, ScreeningRow.s_percent, ScreeningRow.j_percent)
    statement = _joined(ValveRow.id, ScreeningRow.id.label("screening_id"), *numbers)
    statement = statement.where(*_conditions(wanted)).order_by(*_order(wanted))
    counts = dict.fromkeys([*(verdict.value for verdict in WORST_FIRST), NOT_SCREENED], 0)
    chosen: list[tuple[str, int | None]] = []
    states = dict.fromkeys(WorkState, 0)
    largest = 0.0
    # Past the session, whose rows cost several times as much: here are all valves there are.
    for valve, number, verdict, named, S, J in session.connection().execute(statement):
        word = verdict or NOT_SCREENED
        counts[word] += 1
        if verdict:
            states[work_state(Verdict(verdict), named=bool(named))] += 1
        largest = max(largest, S or 0.0, J or 0.0)
        if not wanted.verdicts or word in wanted.verdicts:
            chosen.append((valve, number))
    first = (wanted.page - 1) * wanted.size
    shown = chosen[first : first + wanted.size]
    return RankingPage(
        lines=_lines(session, shown, first + 1),
        counts=counts,
        states=states,
        total=len(chosen),
        areas=read_areas(session),
        largest_percent=largest,
    )


def _lines(
    session: Session, shown: Sequence[tuple[str, int | None]], place: int
) -> tuple[RankingLine, ...]:
    """The lines of these valves and screenings, in this order, counted from ``place``."""
    screenings = [number for _, number in shown if number is not None]
    of_valve = and_(ScreeningRow.valve == ValveRow.id, ScreeningRow.id.in_(screenings))
    statement = select(*_COLUMNS).select_from(ValveRow).outerjoin(ScreeningRow, of_valve)
    valves = [valve for valve, _ in shown]
    rows: dict[str, Any] = {
        row.id: row for row in session.execute(statement.where(ValveRow.id.in_(valves)))
    }
    before = read_previous_of(session, screenings)
    return tuple(
        _line(rows[valve], place + k, None if number is None else before.get(number))
        for k, (valve, number) in enumerate(shown)
    )


def read_areas(session: Session) -> tuple[str, ...]:
    """The areas that valves are in, by name."""
    every = session.scalars(select(ValveRow.area).distinct().order_by(ValveRow.area))
    return tuple(area for area in every if area)


def read_valves_in(session: Session, area: str) -> list[str]:
    """The valves of one area, by id."""
    wanted = select(ValveRow.id).where(ValveRow.area == area).order_by(ValveRow.id)
    return list(session.scalars(wanted))


def _line(row: Any, place: int, previous: PreviousFinding | None) -> RankingLine:
    return RankingLine(
        place=place,
        valve=row.id,
        description=row.description,
        area=row.area,
        criticality=row.criticality,
        verdict=None if row.verdict is None else Verdict(row.verdict),
        at=row.at,
        severity=row.severity or 0.0,
        confidence=row.confidence,
        grade=row.grade or "",
        shape=row.shape,
        S=_estimate(row.s_percent, row.s_low_percent, row.s_high_percent, row.s_reason),
        J=_estimate(row.j_percent, row.j_low_percent, row.j_high_percent, row.j_reason),
        left_out=tuple(row.mismatch_slugs or ()),
        held_back=bool(row.held_back),
        previous=previous,
    )


def _estimate(
    value: float | None, low: float | None, high: float | None, reason: str | None
) -> Estimate:
    if value is None:
        return Estimate.unknown(reason or "not screened yet", unit=PERCENT)
    return Estimate(value=value, low=low, high=high, unit=PERCENT)
