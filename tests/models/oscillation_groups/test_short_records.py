"""In minutes loops that have nothing to do with each other look alike."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest

from stemwatch.models.oscillation_groups.plant_groups import plant_groups, thinned_loop
from stemwatch.models.recording import PERCENT, Recording, Role, Signal
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


@pytest.mark.parametrize(
    ("samples", "interval_s", "enough"),
    [(720, 10.0, True), (719, 10.0, False), (720, 1.0, False), (1440, 1.0, True)],
)
def test_a_loop_needs_samples_and_time(samples: int, interval_s: float, enough: bool) -> None:
    """720 samples, and twenty-four minutes where they are quick."""
    values = Signal.good(np.sin(0.1 * np.arange(samples)), "PV", unit=PERCENT)
    signals = {Role.OP: values, Role.PV: values}
    recording = Recording(valve="A", signals=signals, interval_s=interval_s)
    assert (thinned_loop(recording) is not None) == enough
