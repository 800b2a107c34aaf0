"""Slips of a lightly damped simulated stem: the simulator integrates mass, spring and friction, and
does not use the term.
"""

from __future__ import annotations

import numpy as np
import pytest

from stemwatch.models.mismatch.explain import explain
from stemwatch.models.mismatch.findings import Finding
from stemwatch.models.studies.simulator.hidden.draws import draw_nulls
from stemwatch.models.studies.simulator.hidden.hidden_effect import with_actuator
from stemwatch.models.studies.simulator.simulate import simulate_loop

LIGHT_S = 0.0008  # drag over spring rate: a damping ratio of 0.15, an overshoot of 63 %


@pytest.mark.long
@pytest.mark.parametrize("place", [2, 9])
def test_light_damping_is_not_named_low_speed_sticking_and_needs_no_work(place: int) -> None:
    """Both valves were once named low-speed re-stick, a defect; S and J are of the longer slip."""
    case = draw_nulls(place + 1, 5151, "routine")[place]
    run = simulate_loop(with_actuator(case.loop, viscous_s=LIGHT_S), case.seed)
    found = explain(run.recording)
    assert found.finding is Finding.CANDIDATES
    (effect,) = found.effects
    assert effect.members == ("slip_overshoot", "low_speed_restick")
    assert effect.inherent
    assert found.defects == ()
    valve = case.loop.valve
    overshoot = float(np.exp(-np.pi * 0.146 / np.sqrt(1.0 - 0.146**2)))
    slip = found.restated.J.value
    assert slip is not None
    assert valve.J < slip <= 1.1 * (1.0 + overshoot) * valve.J
