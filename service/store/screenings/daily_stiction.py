"""S of each valve by day over the last weeks, for its trend: a row a day, however often a plant is
screened."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from datetime import date, timedelta

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from stemwatch.service.presenter.trend_over_weeks import WEEKS, TrendOverWeeks, trend_over_weeks
from stemwatch.service.store.screenings.tables import MaintenanceRow, ScreeningRow

_AT_ONCE = 500


def read_trends(session: Session, valves: Sequence[str], limit: float) -> dict[str, TrendOverWeeks]:
    """The trend of S of each of ``valves`` that has one: over the weeks before its latest
    screening, and since the last work on it; and when it will reach ``limit``, percent."""
    trends: dict[str, TrendOverWeeks] = {}
    for first in range(0, len(valves), _AT_ONCE):
        part = list(valves[first : first + _AT_ONCE])
        for valve, points in _daily(session, part).items():
            start = min(points)
            days = sorted(points)
            trend = trend_over_weeks(
                [(day - start).days for day in days], [points[day] for day in days], limit
            )
            if trend is not None:
                trends[valve] = trend
    return trends


def _daily(session: Session, valves: Sequence[str]) -> Mapping[str, Mapping[date, float]]:
    """The mean of S in percent of OP span of each day that counts, UTC."""
    conditions = (ScreeningRow.valve.in_(valves), ScreeningRow.s_percent.is_not(None))
    newest = select(ScreeningRow.valve, func.max(ScreeningRow.at)).where(*conditions)
    latest = {
        valve: window_end
        for valve, window_end in session.execute(newest.group_by(ScreeningRow.valve))
    }
    if not latest:
        return {}
    reach = timedelta(weeks=WEEKS)
    worked = select(MaintenanceRow.valve, func.max(MaintenanceRow.at))
    worked = worked.where(MaintenanceRow.valve.in_(valves)).group_by(MaintenanceRow.valve)
    work = {valve: work_time for valve, work_time in session.execute(worked)}
    begins = {
        valve: max(window_end - reach, work.get(valve, window_end - reach))
        for valve, window_end in latest.items()
    }
    day = func.date(ScreeningRow.at)
    statement = select(ScreeningRow.valve, day, func.avg(ScreeningRow.s_percent)).where(
        *conditions, ScreeningRow.at >= min(begins.values())
    )
    lowest_by_day: dict[str, dict[date, float]] = defaultdict(dict)
    for valve, text, mean in session.execute(statement.group_by(ScreeningRow.valve, day)):
        when = text if isinstance(text, date) else date.fromisoformat(str(text))
        # The day of the work has screenings of the valve before it as well.
        if when >= begins[valve].date() and (valve not in work or when > work[valve].date()):
            lowest_by_day[valve][when] = float(mean)
    return lowest_by_day
