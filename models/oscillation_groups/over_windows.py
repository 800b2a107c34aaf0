"""Groups of one window recognised in the next: since when they oscillate, in how many windows."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta

from stemwatch.models.oscillation_groups.plant_groups import OscillationGroup

LINKED_WITHIN = timedelta(days=7)  # an oscillation that was absent longer counts as a new one
SAME_LOOPS = 0.5  # of all loops of both groups (Jaccard index), from which they are the same
SAME_PERIOD = math.log(1.25)  # the width within which loops of one window are grouped


@dataclass(frozen=True, kw_only=True)
class OscillationWindow:
    """One window of an oscillation: its end, the mean share of its loops' variance, its period and
    the likeliest source (empty where that is outside)."""

    at: datetime
    variance_share: float
    period_s: float
    source: str


def is_same_oscillation(group: OscillationGroup, earlier: OscillationGroup) -> bool:
    """Whether ``earlier`` is the oscillation of ``group`` in a window before: half of the loops of
    both are in both (Jaccard), and the periods are within a quarter of each other."""
    loops, before = ({member.loop for member in either.members} for either in (group, earlier))
    shared = len(loops & before) / len(loops | before)
    period_ratio = abs(math.log(group.period_s / earlier.period_s))
    return shared >= SAME_LOOPS and period_ratio <= SAME_PERIOD


def continued(group: OscillationGroup, earlier: Iterable[OscillationGroup]) -> OscillationGroup:
    """``group`` with the windows in which it was found before, since when it oscillates, and the
    start of the first of them. ``earlier`` are groups of windows that began before its own; of
    those that are the same oscillation the newest counts. Groups without dates are never linked."""
    start = group.start
    if start is None:
        return group
    earlier_groups = [
        earlier_group
        for earlier_group in earlier
        if earlier_group.start is not None
        and earlier_group.start
        < start
        <= earlier_group.start + timedelta(seconds=earlier_group.duration_s) + LINKED_WITHIN
        and is_same_oscillation(group, earlier_group)
    ]
    if not earlier_groups:
        return group
    before = max(earlier_groups, key=lambda one: str(one.start))
    return replace(
        group,
        windows=before.windows + 1,
        first_found=before.first_found or before.start,
        since=before.since,
    )


def told_once(groups: Sequence[OscillationGroup]) -> list[OscillationGroup]:
    """``groups`` of several windows without those that a later window shows again: whoever reads of
    two would look for two sources."""
    return [
        group
        for group in groups
        if not any(
            group.start is not None
            and later.start is not None
            and later.start > group.start
            and is_same_oscillation(later, group)
            for later in groups
        )
    ]
