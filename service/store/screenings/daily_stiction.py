"""Daily means of S and J of each valve over the last weeks, for their trends: one row a day,
however often a plant is screened."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import date, timedelta

from sqlalchemy import ColumnElement, func, select
from sqlalchemy.orm import Session

from stemwatch.models.history.fall_of_stiction import UnexplainedFall, history_since_fall
from stemwatch.models.history.trend_over_weeks import WEEKS, TrendOverWeeks, trend_over_weeks
from stemwatch.service.store.screenings.baselines import last_work
from stemwatch.service.store.screenings.tables import ScreeningRow

_AT_ONCE = 500


def read_trends(
    session: Session, valves: Sequence[str], limit: float
) -> tuple[dict[str, TrendOverWeeks], dict[str, UnexplainedFall]]:
    """The trend of S, with that of J, of each of ``valves`` that has one: over the weeks before its
    latest screening, since the last work on it and since its S fell the last time; and when S will
    reach ``limit``, percent. Beside it that fall, where it is not explained by recorded work."""
    trends: dict[str, TrendOverWeeks] = {}
    falls: dict[str, UnexplainedFall] = {}
    for first in range(0, len(valves), _AT_ONCE):
        part = list(valves[first : first + _AT_ONCE])
        for valve, points in _daily(session, part).items():
            fall = _fall({day: S for day, (S, _) in points.items()})
            if fall is not None:
                falls[valve] = fall
            trend = _trend({day: S for day, (S, _) in points.items()}, limit)
            if trend is not None:
                begin = date.min if fall is None else fall.on
                of_J = {day: J for day, (_, J) in points.items() if J is not None and day >= begin}
                trend_of_J = _trend(of_J)
                trend_of_J = None if trend_of_J is None else replace(trend_of_J, number="J")
                trends[valve] = replace(trend, J=trend_of_J)
    return trends, falls


def _fall(points: Mapping[date, float]) -> UnexplainedFall | None:
    days = sorted(points)
    since = history_since_fall([day.toordinal() for day in days], [points[day] for day in days])
    if since.fall is None:
        return None
    on = date.fromordinal(int(since.fall.first))
    return UnexplainedFall(before=since.fall.before, after=since.fall.after, on=on)


def _trend(points: Mapping[date, float], limit: float | None = None) -> TrendOverWeeks | None:
    days = sorted(points)
    return trend_over_weeks(
        [(day - days[0]).days for day in days], [points[day] for day in days], limit
    )


def _daily(
    session: Session, valves: Sequence[str]
) -> Mapping[str, Mapping[date, tuple[float, float | None]]]:
    """The means of S and of J in percent of OP span of each day that counts, UTC."""
    conditions = (ScreeningRow.valve.in_(valves), ScreeningRow.s_percent.is_not(None))
    newest = select(ScreeningRow.valve, func.max(ScreeningRow.at)).where(*conditions)
    latest = {
        valve: window_end
        for valve, window_end in session.execute(newest.group_by(ScreeningRow.valve))
    }
    if not latest:
        return {}
    reach = timedelta(weeks=WEEKS)
    work = last_work(session, valves)
    begins = {
        valve: max(window_end - reach, work.get(valve, window_end - reach))
        for valve, window_end in latest.items()
    }
    day = _day(session)
    means = func.avg(ScreeningRow.s_percent), func.avg(ScreeningRow.j_percent)
    statement = select(ScreeningRow.valve, day, *means).where(
        *conditions, ScreeningRow.at >= min(begins.values())
    )
    by_day: dict[str, dict[date, tuple[float, float | None]]] = defaultdict(dict)
    for valve, text, S, J in session.execute(statement.group_by(ScreeningRow.valve, day)):
        when = text if isinstance(text, date) else date.fromisoformat(str(text))
        # The day of the work has screenings of the valve before it as well.
        if when >= begins[valve].date() and (valve not in work or when > work[valve].date()):
            by_day[valve][when] = (float(S), None if J is None else float(J))
    return by_day


def _day(session: Session) -> ColumnElement[date]:
    """The day of a screening in UTC. PostgreSQL would take the zone of its server."""
    is_sqlite = session.get_bind().dialect.name == "sqlite"  # which keeps times in UTC
    return func.date(ScreeningRow.at if is_sqlite else func.timezone("UTC", ScreeningRow.at))
