"""The simulated motors: repeatable, as hidden as they say, and counted right."""

from __future__ import annotations

import numpy as np
import pytest

from tests.benchmarks.bench_other_motors import Found, Motor, _angle, draw, summary

MOTOR = Motor(
    S=1.0, load=3.0, lag_s=0.1, run_up_s=0.02, most_error=20.0, per_second=100.0, encoder=0.1
)


def test_a_seed_gives_the_same_motor_and_recording() -> None:
    """To the bit; another number gives another motor."""
    (first, recording), (again, repeated) = draw(3, 1), draw(3, 1)
    assert first == again != draw(3, 2)[0]
    assert recording.mv is not None
    assert repeated.mv is not None
    np.testing.assert_array_equal(recording.mv.values, repeated.mv.values)


@pytest.mark.parametrize("friction", [0.0, 0.05, 0.4])
def test_an_arm_that_has_come_to_rest_is_held_by_motor_and_friction(friction: float) -> None:
    """Stiffness times what it is off, less the pull of the load, is no more than friction."""
    stiffness, load = 8.0, 1.5
    numbers = np.array([stiffness, 0.5, 1.0, 0.02, load, friction, 0.0, 0.0, 2.0])
    angle = np.empty(600)
    _angle(np.full(600, 0.9), 20, numbers, angle)
    net = stiffness * (0.9 - angle[-1]) - load * np.sin(angle[-1])
    assert angle[-1] == pytest.approx(angle[-100], abs=1e-6)
    assert abs(net) <= friction + 1e-4
    assert abs(net) >= 0.5 * friction  # it came from above, and friction let it go no further


def test_the_summary_counts_names_loads_and_intervals() -> None:
    """Of four motors two are drives, one of two loads is named, two intervals hold S, and one has
    no S."""
    light, middling = (Motor(**{**vars(MOTOR), "load": load}) for load in (0.2, 1.0))
    rows = [
        Found(MOTOR, "named", ("load_by_position", "motor_drive"), 1.1, 0.9, 1.3),
        Found(MOTOR, "unknown", (), 4.0, 3.0, 5.0),
        Found(light, "named", ("motor_drive",), 1.0, 0.8, 1.2),
        Found(middling, "not_testable", (), None, None, None),
    ]
    assert summary(rows) == [
        "- 4 motors: 2 named as a drive, 1 unknown",
        "- S off by 0.05 % of a turn (median) where a drive is named, 3.00 where none is; the "
        "interval holds it in 2 of 4, 1 have no S but a reason",
        "- a load of 2 % and more is named in 1 of 2, one below 0.5 % in 0 of 1",
    ]
