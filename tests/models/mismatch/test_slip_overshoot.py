"""Slips of a lightly damped simulated stem: the simulator integrates mass, spring and friction, and
does not use the term.
"""

from __future__ import annotations

import numpy as np
import pytest

from stemwatch.models.mismatch.evidence.describe_effect import MODEL_ERROR, estimates
from stemwatch.models.mismatch.explain import explain
from stemwatch.models.mismatch.findings import Finding
from stemwatch.models.mismatch.terms.slip_overshoot import TERM
from stemwatch.models.studies.simulator.hidden.draws import draw_nulls
from stemwatch.models.studies.simulator.hidden.hidden_effect import with_actuator
from stemwatch.models.studies.simulator.simulate import simulate_loop

LIGHT_S = 0.0008  # drag over spring rate: a damping ratio of 0.15, an overshoot of 63 %


@pytest.mark.parametrize(("speed", "is_bound"), [(4.0, True), (3.95, True), (3.0, False)])
def test_the_end_of_the_search_is_a_bound_and_no_measured_speed(
    speed: float, is_bound: bool
) -> None:
    """A stem that sticks on the quickest moves of its recording does so at that speed or above it:
    no value is said, neither in the sentence nor in the parameter; the test is of a quarter of it.
    """
    values = np.array([speed])
    found = estimates(TERM, values, np.tile(values, (8, 1)), 1.0)
    assert (found["v_c"].value is None) == is_bound
    assert (found["v_c"].high is None) == is_bound
    assert found["v_c"].low == pytest.approx(speed * (1.0 - 1.96 * MODEL_ERROR))
    sentence = TERM.sentence(found, "rising", "falling")
    assert ("on the quickest moves too" in sentence) == is_bound
    assert ("on moves of 3.00" in sentence) != is_bound
    test = TERM.field_test(found)
    assert test is not None
    assert ("over 10 % at 0.9 %/s, and" in test.do) == is_bound


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
