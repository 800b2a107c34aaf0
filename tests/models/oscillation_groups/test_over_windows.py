"""An oscillation is recognised in the next window, and not mistaken for another."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime, timedelta

import pytest

from stemwatch.models.oscillation_groups.over_windows import continued
from stemwatch.models.oscillation_groups.plant_groups import GroupMember, OscillationGroup

MONDAY = datetime(2026, 3, 2, tzinfo=UTC)
DAY = timedelta(days=1)


def group(*loops: str, period_s: float = 200.0, start: datetime | None = MONDAY):
    """A group as the search gives it."""
    members = tuple(GroupMember(loop=loop, share=0.5, probability=0.3) for loop in loops)
    return OscillationGroup(
        period_s=period_s,
        members=members,
        outside=0.1,
        regularity=5.0,
        start=start,
        duration_s=86400.0,
        since=None,
        strength=(1.0,),
        periods_s=(200.0,),
        spectra=((1.0,),) * len(members),
    )


def test_windows_are_counted_and_the_first_one_dates_it() -> None:
    """Three days running, the second of which began in the middle of the first."""
    first = replace(group("A", "B", "C"), since=MONDAY + timedelta(hours=9))
    second = continued(group("A", "B", "C", period_s=210.0, start=MONDAY + DAY), [first])
    third = continued(group("A", "B", start=MONDAY + 2 * DAY), [first, second])
    assert (second.windows, third.windows) == (2, 3)
    assert third.since == first.since
    assert third.first_found == MONDAY


@pytest.mark.parametrize(
    "earlier",
    [
        group("A", "X", "Y", "Z"),  # other loops
        group("A", "B", "C", period_s=260.0),  # another period
        group("A", "B", "C", start=MONDAY - 10 * DAY),  # away for more than a week
        group("A", "B", "C", start=MONDAY + DAY),  # the same window
        group("A", "B", "C", start=MONDAY + 3 * DAY),  # a later one, screened before
        group("A", "B", "C", start=None),  # nobody knows when
    ],
)
def test_another_oscillation_is_not_the_same(earlier: OscillationGroup) -> None:
    """A group that is not certainly the same counts as a new one."""
    now = group("A", "B", "C", start=MONDAY + DAY)
    assert continued(now, [earlier]) == now


def test_without_dates_nothing_is_linked() -> None:
    """Without dates there are no earlier windows."""
    now = group("A", "B", start=None)
    assert continued(now, [group("A", "B")]) == now
