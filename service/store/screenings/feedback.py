"""Feedback from people who inspected a valve, stored with the finding, and counted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from enum import StrEnum

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from stemwatch.models.verdict import Verdict
from stemwatch.service.presenter.work_decision import overall_verdict
from stemwatch.service.store.errors import NotThere
from stemwatch.service.store.screenings.named_effects import (
    KEY,
    confirmed_of,
    defects_of,
    remark_of,
)
from stemwatch.service.store.screenings.tables import FeedbackRow, ScreeningRow
from stemwatch.service.store.storable import from_row

MOST_SHOWN = 500


class Judgement(StrEnum):
    """A person's judgement of a finding."""

    RIGHT = "right"
    WRONG = "wrong"
    PARTLY = "partly right"


@dataclass(frozen=True, kw_only=True)
class Feedback:
    """One label: the finding on a valve and its window, and what a person found there.

    ``verdict`` is that on the valve as a whole, ``effects`` the slugs that stood; S and J in
    percent of OP span, ``None`` where they were not known.
    """

    id: int
    valve: str
    at: datetime
    judgement: Judgement
    found: str
    who: str
    screened: datetime
    window: tuple[datetime | None, datetime | None]
    source: str
    verdict: Verdict
    effects: tuple[str, ...]
    S: float | None
    J: float | None
    software_version: str


def write_feedback(
    session: Session, screening: int, at: datetime, judgement: Judgement, found: str, who: str
) -> str:
    """Keep what a person found of ``screening``; its valve. Raises ``NotThere``."""
    row = session.get(ScreeningRow, screening)
    if row is None:
        raise NotThere(f"there is no screening {screening}")
    effects = [] if remark_of(row.mismatch) else list(row.mismatch_slugs or ())
    defects = effects and defects_of(effects, (row.mismatch or {}).get(KEY))
    confirmed = confirmed_of(row.evidence)
    if confirmed is not None:
        effects, defects = list(dict.fromkeys((*effects, *confirmed))), confirmed
    session.add(
        FeedbackRow(
            valve=row.valve,
            at=at,
            judgement=judgement.value,
            found=found,
            who=who,
            screened=row.at,
            window_start=row.window_start,
            window_end=row.window_end,
            source=row.source,
            verdict=overall_verdict(Verdict(row.verdict), named=bool(defects)).value,
            effects=effects,
            s_percent=row.s_percent,
            j_percent=row.j_percent,
            software_version=row.software_version,
        )
    )
    return row.valve


def read_feedback(
    session: Session, valve: str | None = None, limit: int | None = None
) -> list[Feedback]:
    """Labels of one valve or of all, the newest first."""
    statement = select(FeedbackRow).order_by(FeedbackRow.at.desc(), FeedbackRow.id.desc())
    if valve is not None:
        statement = statement.where(FeedbackRow.valve == valve)
    if limit is not None:
        statement = statement.limit(limit)
    return [_feedback(row) for row in session.scalars(statement)]


def count_feedback(session: Session) -> Mapping[tuple[Verdict, Judgement], int]:
    """How often each verdict was said to be right or wrong."""
    columns = (FeedbackRow.verdict, FeedbackRow.judgement)
    rows = session.execute(select(*columns, func.count()).group_by(*columns))
    return {(Verdict(verdict), Judgement(judgement)): count for verdict, judgement, count in rows}


def count_effects(labels: Sequence[Feedback]) -> Mapping[str, Mapping[Judgement, int]]:
    """How often each effect that stood was said to be right or wrong."""
    counts_of_effect: dict[str, dict[Judgement, int]] = {}
    for label in labels:
        for slug in label.effects:
            counts = counts_of_effect.setdefault(slug, dict.fromkeys(Judgement, 0))
            counts[label.judgement] += 1
    return dict(sorted(counts_of_effect.items()))


def _feedback(row: FeedbackRow) -> Feedback:
    return from_row(
        Feedback,
        row,
        judgement=Judgement(row.judgement),
        window=(row.window_start, row.window_end),
        verdict=Verdict(row.verdict),
        effects=tuple(row.effects),
        S=row.s_percent,
        J=row.j_percent,
    )
