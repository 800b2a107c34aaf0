"""In minutes loops that have nothing to do with each other look alike."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime

import pytest

from stemwatch.models.oscillation_groups.plant_groups import plant_groups, thinned_loop
from stemwatch.models.studies.simulator import draw_healthy, simulate_loop


@pytest.mark.long
def test_unrelated_loops_make_no_group_in_four_minutes() -> None:
    """Of twenty valves, each in a simulation of its own, screened every few minutes."""
    loops = []
    for number, loop in enumerate(draw_healthy(20, 4060)):
        recording = simulate_loop(loop, 406000 + number).recording.part(0, 240)
        if thinned := thinned_loop(recording):
            at = datetime(2026, 1, 1, tzinfo=UTC)
            loops.append(replace(thinned, loop=f"L{number}", source="plc-1", start=at))
    assert list(plant_groups(loops)) == []
