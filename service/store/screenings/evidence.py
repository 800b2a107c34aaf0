"""The windows of the last weeks of many valves, for their joint evidence."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from datetime import datetime, timedelta

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from stemwatch.models.history.evidence_over_windows import WindowEvidence
from stemwatch.models.mismatch.findings import Finding
from stemwatch.service.store.screenings.baselines import last_work
from stemwatch.service.store.screenings.evidence_json import evidence_of
from stemwatch.service.store.screenings.tables import ScreeningRow

WEEKS = 8  # of history before the valve's latest screening
_NAMED = (Finding.NAMED.value, Finding.CANDIDATES.value)
_AT_ONCE = 250  # valves of one statement


def read_evidence(session: Session, valves: Sequence[str]) -> dict[str, list[WindowEvidence]]:
    """The windows of the last weeks, in order of time, of those of ``valves`` on which at least one
    of these windows named an effect; the others have no evidence to weigh.

    Windows before or during the last work on the valve do not count. A window stored by an older
    version has the effects that it named and no scores for others.
    """
    evidence_of_valve: dict[str, list[WindowEvidence]] = {}
    for first in range(0, len(valves), _AT_ONCE):
        evidence_of_valve |= _of_part(session, list(valves[first : first + _AT_ONCE]))
    return evidence_of_valve


def _of_part(session: Session, valves: Sequence[str]) -> dict[str, list[WindowEvidence]]:
    begins = _begins(session, valves)
    if not begins:
        return {}
    table = ScreeningRow
    named = select(table.valve, table.at).where(
        table.valve.in_(list(begins)),
        table.at >= min(begins.values()),
        table.mismatch_finding.in_(_NAMED),
    )
    valves_named = {
        valve for valve, named_at in session.execute(named) if named_at >= begins[valve]
    }
    if not valves_named:
        return {}
    statement = select(
        table.valve,
        table.at,
        table.window_start,
        table.evidence,
        table.mismatch_slugs,
    ).where(
        table.valve.in_(sorted(valves_named)),
        table.at >= min(begins[valve] for valve in valves_named),
        table.mismatch_finding.is_not(None),
    )
    work = last_work(session, sorted(valves_named))
    windows: dict[str, list[WindowEvidence]] = defaultdict(list)
    for row in session.execute(statement.order_by(table.valve, table.at, table.id)):
        counts = row.at >= begins[row.valve]
        if row.valve in work:
            counts = counts and (row.window_start or row.at) >= work[row.valve]
        if counts:
            stored = row.evidence or {"named": [[slug] for slug in row.mismatch_slugs or ()]}
            windows[row.valve].append(evidence_of(stored, row.window_start, row.at))
    return dict(windows)


def _begins(session: Session, valves: Sequence[str]) -> dict[str, datetime]:
    """For each valve that was screened, how far back is looked."""
    latest = select(ScreeningRow.valve, func.max(ScreeningRow.at)).where(
        ScreeningRow.valve.in_(valves)
    )
    rows = session.execute(latest.group_by(ScreeningRow.valve))
    return {valve: window_end - timedelta(weeks=WEEKS) for valve, window_end in rows}
