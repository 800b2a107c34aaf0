"""Since when a finding has been seen, and in how many screenings in a row."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, tzinfo

from stemwatch.models.mismatch.findings import Finding
from stemwatch.models.screening_result import PreviousFinding
from stemwatch.models.verdict import Verdict
from stemwatch.service.maintenance.valve_history import LOOK_BACK
from stemwatch.service.presenter.wording import instant
from stemwatch.service.presenter.work_decision import (
    DEPARTED,
    HEALTHY,
    RECORDING,
    SIGNAL,
    STICTION,
    UNEXPLAINED,
    UNKNOWN,
    WATCH,
    verdict_before,
)
from stemwatch.service.store.screenings.records import Remark


@dataclass(frozen=True, kw_only=True)
class FirstSeen:
    """``count`` screenings in a row have shown it, this one included.

    ``first`` is the earliest of them but this one, ``None`` where this is the only one; ``before``
    the last one that did not show it. ``at_least`` where the record was not read any further back.
    """

    count: int
    first: PreviousFinding | None = None
    before: PreviousFinding | None = None
    at_least: bool = False


def first_seen(kind: str, earlier: Sequence[PreviousFinding]) -> FirstSeen:
    """How far back ``kind`` goes without a break. Screenings without a verdict neither show nor
    exclude friction and are skipped."""
    judged = earlier if _of_signal(kind) else [before for before in earlier if _is_judged(before)]
    run: list[PreviousFinding] = []
    for before in judged:
        if not shows(kind, before):
            return FirstSeen(count=1 + len(run), first=run[-1] if run else None, before=before)
        run.append(before)
    first = run[-1] if run else None
    return FirstSeen(count=1 + len(run), first=first, at_least=len(earlier) >= LOOK_BACK)


def shows(kind: str, past: PreviousFinding) -> bool:
    """Whether an earlier screening shows the same kind of finding."""
    if kind in STICTION.values():
        return past.verdict is Verdict.STICKY
    if kind in (WATCH, DEPARTED):
        return past.verdict in (Verdict.WATCH, Verdict.STICKY)
    if kind == HEALTHY:
        return past.verdict is Verdict.HEALTHY
    if kind == UNKNOWN:
        return past.finding == Finding.UNKNOWN.value
    if _of_signal(kind):
        return past.verdict is Verdict.UNDETERMINED
    return kind in past.effects


def seen_sentence(seen: FirstSeen, zone: tzinfo) -> str:
    """Since when and how often it was found, as a sentence; dates in ``zone``."""
    if seen.first is None:
        if seen.before is None:
            return "First screening that is known of this valve: nothing to compare with."
        return f"New in this screening; the one before, {_past_sentence(seen.before, zone)}."
    begins = "at least since" if seen.at_least else "since"
    text = (
        f"Seen {begins} {instant(seen.first.at, zone)} (run {seen.first.run}), "
        f"in {seen.count} screenings in a row"
    )
    if seen.before is None:
        return f"{text}; nothing earlier is stored." if not seen.at_least else f"{text}."
    return f"{text}; the one before, {_past_sentence(seen.before, zone)}."


def work_sentence(
    work: Sequence[Remark],
    seen_since: datetime | None,
    newest: datetime | None,
    zone: tzinfo,
) -> str:
    """The last work on the valve, against the instant since which the finding is seen; empty
    without. Only where the ``newest`` window begins after the work can anybody say that the finding
    outlived it."""
    if not work:
        return ""
    last = work[-1]
    text = f"Last work: {instant(last.at, zone)}, {last.note}."
    if seen_since is None:
        return text
    if last.at > seen_since:
        if newest is None or newest < last.at:
            return f"{text} Whether it helped is not known: no window after it was screened."
        return f"{text} It was seen before that work already, and is still there."
    days = (seen_since - last.at).days
    return f"{text} It came {days} {'day' if days == 1 else 'days'} after that work."


def _past_sentence(past: PreviousFinding, zone: tzinfo) -> str:
    return f"of {instant(past.at, zone)}, said {verdict_before(past).value} and did not show it"


def _of_signal(kind: str) -> bool:
    return kind in SIGNAL or kind in (UNEXPLAINED, RECORDING)


def _is_judged(past: PreviousFinding) -> bool:
    return past.verdict is not Verdict.UNDETERMINED
