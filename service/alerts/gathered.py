"""What the rules look at, for many valves at once: a few queries for hundreds of valves, and of
each valve's years no more than the last screenings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from stemwatch.service.alerts.after_maintenance import WRITER
from stemwatch.service.alerts.rules import RATIO, ValveRecord
from stemwatch.service.config import Plant
from stemwatch.service.store.screenings.records import StoredValve
from stemwatch.service.store.store import Store

AT_ONCE = 250  # valves of one round of queries; times the depth, what one statement may name


def gathered(store: Store, plant: Plant, valves: Sequence[str]) -> Iterator[ValveRecord]:
    """What is known of each of ``valves``, in their order. Raises ``StoreError``."""
    depth = max(plant.alerts.of_runs, plant.alerts.clear_after_runs) * 3
    for first in range(0, len(valves), AT_ONCE):
        part = valves[first : first + AT_ONCE]
        known = store.recent(part, depth, RATIO)
        for valve in part:
            recent = known[valve]
            yield ValveRecord(
                valve=_facts(plant, valve),
                screenings=recent.screenings,
                at_baseline=recent.at_baseline,
                ratios=recent.indicator,
                ratio_limit=plant.limits.baseline_ratio_watch,
                worked_at=recent.worked_at,
            )


def awaiting_aftermath(store: Store, valves: Sequence[str]) -> list[str]:
    """Those of ``valves`` whose last maintenance no note compares with what followed yet."""
    found: list[str] = []
    for first in range(0, len(valves), AT_ONCE):
        found += store.work_without_note(valves[first : first + AT_ONCE], WRITER)
    return found


def _facts(plant: Plant, valve: str) -> StoredValve:
    entry = plant.valves.get(valve)
    if entry is None:
        return StoredValve(id=valve)
    return StoredValve(
        id=valve,
        description=entry.description,
        area=entry.area,
        criticality=entry.criticality,
    )
