"""S and J over months, and what happened to the valve in between."""

from __future__ import annotations

from datetime import datetime

from stemwatch.service.store.screenings.history import HistoryPoint
from stemwatch.service.store.store import Store
from stemwatch.service.web.api.schemas import HistoryAnswer, HistoryLine, Mark
from stemwatch.service.web.dependencies import Dependencies


def history_of(deps: Dependencies, valve: str, since: datetime | None = None) -> HistoryAnswer:
    """Every screening since ``since``, oldest first, with limits and marks."""
    points = deps.store.s_and_j(valve, since)
    marks = read_marks(deps.store, valve)
    limits = deps.site.limits
    return HistoryAnswer(
        valve=valve,
        watch_S_percent=limits.watch_S_percent,
        sticky_S_percent=limits.sticky_S_percent,
        points=[_line(point) for point in points],
        marks=marks,
    )


def read_marks(store: Store, valve: str) -> list[Mark]:
    """Baselines, work and notes of a valve, oldest first."""
    marks = [
        Mark(kind="baseline" if mark.active else "former baseline", at=mark.at, text=mark.reason)
        for mark in store.baseline_marks(valve)
    ]
    for kind, remarks_of_kind in (
        ("maintenance", store.maintenance(valve)),
        ("note", store.notes(valve)),
    ):
        marks.extend(
            Mark(kind=kind, at=remark.at, text=remark.note, who=remark.who)
            for remark in remarks_of_kind
        )
    return sorted(marks, key=lambda mark: mark.at)


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
