"""S and J over months, and what happened to the valve in between."""

from __future__ import annotations

from datetime import datetime

from sqlalchemy.orm import Session

from stemwatch.service.store.screenings.baselines import read_remarks
from stemwatch.service.store.screenings.tables import MaintenanceRow, NoteRow
from stemwatch.service.web.api.schemas import HistoryAnswer, HistoryLine, Mark
from stemwatch.service.web.dependencies import Dependencies
from stemwatch.service.web.queries.valve import HistoryPoint, read_baselines, read_history


def history_of(deps: Dependencies, valve: str, since: datetime | None = None) -> HistoryAnswer:
    """Every screening since ``since``, oldest first, with limits and marks."""
    with deps.reading() as session:
        points = read_history(session, valve, since)
        marks = read_marks(session, valve)
    limits = deps.site.limits
    return HistoryAnswer(
        valve=valve,
        watch_S_percent=limits.watch_S_percent,
        sticky_S_percent=limits.sticky_S_percent,
        points=[_line(point) for point in points],
        marks=marks,
    )


def read_marks(session: Session, valve: str) -> list[Mark]:
    """Baselines, work and notes of a valve, oldest first."""
    found = [
        Mark(kind="baseline" if one.active else "former baseline", at=one.at, text=one.reason)
        for one in read_baselines(session, valve)
    ]
    for kind, table in (("maintenance", MaintenanceRow), ("note", NoteRow)):
        found.extend(
            Mark(kind=kind, at=remark.at, text=remark.note, who=remark.who)
            for remark in read_remarks(session, table, valve)
        )
    return sorted(found, key=lambda mark: mark.at)


def _line(point: HistoryPoint) -> HistoryLine:
    return HistoryLine(
        at=point.at,
        verdict=point.verdict.value,
        S=point.S[0],
        S_low=point.S[1],
        S_high=point.S[2],
        J=point.J[0],
        J_low=point.J[1],
        J_high=point.J[2],
        severity=point.severity,
        grade=point.grade,
        run=point.run,
        baseline=point.baseline,
    )
