"""What people are told of an alert beside its text: its kind, S when it was raised, and that it was
opened again."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime, tzinfo
from typing import Any

from stemwatch.models.estimate import Estimate
from stemwatch.models.words import times
from stemwatch.service.presenter.wording import instant, interval, span_percent

_KIND_WORDS = {
    "sticky": "the stem sticks",
    "foreseen": "the stem will stick",
    "grown": "friction has grown",
    "baseline": "moves differently from its baseline",
    "mismatch": "an effect beside friction",
    "suspected": "sticking is suspected",
    "no_data": "no data",
    "common": "several valves at once",
}


def kind_words(kind: str) -> str:
    """The kind of an alert for a reader; one that another version made as it is stored."""
    return _KIND_WORDS.get(kind, kind.replace("_", " "))


def last_opened_again(evidence: Mapping[str, Any]) -> datetime | None:
    """When an alert with this evidence was opened again, the last time; ``None`` where never."""
    reopened = evidence.get("reopened", ())
    return datetime.fromisoformat(reopened[-1]["again"]) if reopened else None


def opened_again(evidence: Mapping[str, Any], zone: tzinfo, zone_name: str) -> str:
    """One sentence; empty where the alert was not opened again."""
    reopened = evidence.get("reopened", ())
    if not reopened:
        return ""
    last = reopened[-1]
    again, closed = (datetime.fromisoformat(last[when]) for when in ("again", "closed"))
    count = f", {times(len(reopened))} by now" if len(reopened) > 1 else ""
    why = f" ({last['why']})" if last["why"] else ""
    return (
        f"Opened again {instant(again, zone)} ({zone_name}){count}: the same trouble came back, "
        f"after the alert had closed {instant(closed, zone)}{why}."
    )


def when_raised(evidence: Mapping[str, Any]) -> dict[str, float | None]:
    """S and its interval in the window for which the alert was raised first."""
    first = evidence.get("when_raised", evidence)
    return {key: first.get(key) for key in ("S", "S_low", "S_high")}


def S_since_raised(evidence: Mapping[str, Any]) -> str:
    """One sentence with S then and in the newest window that shows the finding; empty where S lies
    inside the interval that it had then, or is not known."""
    now, low, high = (evidence.get(key) for key in ("S", "S_low", "S_high"))
    first = when_raised(evidence)
    if now is None or first["S_low"] is None or first["S_high"] is None:
        return ""
    if first["S_low"] <= now <= first["S_high"]:
        return ""
    return f"S {_size(**first)} when raised, {_size(now, low, high)} when last found."


def _size(S: float | None, S_low: float | None, S_high: float | None) -> str:
    between = interval(Estimate(value=S, low=S_low, high=S_high, unit="%"))
    return f"{span_percent(S)} % ({between})" if between else f"{span_percent(S)} %"
