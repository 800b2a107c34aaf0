"""The lines on the first screen of a report beside the verdicts: states by NE 107, the largest
response figures, valves that get worse over weeks, and the cost of sticking."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from stemwatch.models.history.trend_over_weeks import TrendOverWeeks
from stemwatch.models.screening_result import Screening
from stemwatch.models.verdict import Verdict
from stemwatch.service.presenter.wording import finite, span_percent
from stemwatch.service.presenter.work_decision import Ne107, ne107_word

MOST_NAMED = 2  # valves that get worse
# Of the verdicts of one valve the first counts; none is no state.
_WORST_STATE_FIRST = (
    Verdict.STICKY,
    Verdict.DEFECTIVE,
    Verdict.WATCH,
    Verdict.HEALTHY,
    Verdict.UNDETERMINED,
)


@dataclass(frozen=True, kw_only=True)
class SummaryLine:
    """What a line is about, and what it says."""

    about: str
    says: str


def summary_lines(
    screenings: Sequence[Screening],
    verdicts: Sequence[Verdict],
    weeks: Mapping[str, TrendOverWeeks | None],
    cost: str,
) -> tuple[SummaryLine, ...]:
    """The lines for which there are data; ``verdicts`` are on the valves of ``screenings``,
    ``weeks`` by valve, ``cost`` is the plant's in words."""
    lines = {
        "NE 107": _states(screenings, verdicts),
        "Response": _response(screenings),
        "Trend": _worse(weeks),
        "Cost": cost,
    }
    return tuple(SummaryLine(about=about, says=says) for about, says in lines.items() if says)


def _states(screenings: Sequence[Screening], verdicts: Sequence[Verdict]) -> str:
    """How many valves are in each state, worst first; no verdict is no state. Of several
    recordings of a valve that with the worst state counts."""
    worst: dict[str, Verdict] = {}
    for screening, verdict in zip(screenings, verdicts, strict=True):
        worst[screening.valve] = min(
            worst.get(screening.valve, verdict), verdict, key=_WORST_STATE_FIRST.index
        )
    counts = Counter(ne107_word(verdict) for verdict in worst.values())
    order = (Ne107.OUT_OF_SPECIFICATION, Ne107.MAINTENANCE_REQUIRED, Ne107.NORMAL)
    said = [f"{counts[state.value]} {state.value}" for state in order if counts[state.value]]
    said += [f"{counts[None]} without a state"] if counts[None] else []
    return ", ".join(said)


def _response(screenings: Sequence[Screening]) -> str:
    """The largest dead band and resolution in the words of ISA-75.25: S and J."""
    said = []
    for word, name in (("dead band", "S"), ("resolution", "J")):
        known = [
            (value, screening.valve)
            for screening in screenings
            if (value := finite(getattr(screening, name).value)) is not None
        ]
        if known:
            value, valve = max(known)
            said.append(f"{word} ({name}) up to {span_percent(value)} % of OP ({valve})")
    return ", ".join(said)


def _worse(weeks: Mapping[str, TrendOverWeeks | None]) -> str:
    """The valves whose S rises over weeks: those that reach the limit soonest first, then the
    fastest."""
    rising = {
        valve: trend
        for valve, trend in weeks.items()
        if trend is not None and trend.is_change and trend.per_month > 0.0
    }

    def soonest(valve: str) -> tuple[float, float]:
        forecast = rising[valve].forecast
        until = None if forecast is None else forecast.until.value
        return (float("inf") if until is None else until, -rising[valve].per_month)

    first = sorted(rising, key=soonest)
    said = [f"{valve}: {rising[valve].words}" for valve in first[:MOST_NAMED]]
    said += [f"and {len(first) - MOST_NAMED} more"] if len(first) > MOST_NAMED else []
    return "; ".join(said)
