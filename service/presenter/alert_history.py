"""What people are told of an alert beside its text: its kind, and that it was opened again."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime, tzinfo
from typing import Any

from stemwatch.models.words import times
from stemwatch.service.presenter.wording import instant

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
