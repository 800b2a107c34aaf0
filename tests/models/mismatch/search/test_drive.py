"""A drive is named with motor and load, and its S is that of the friction."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from stemwatch.models.mismatch.explain import explain
from stemwatch.models.mismatch.findings import Finding
from stemwatch.models.recording import Role, Signal
from stemwatch.models.studies.simulator import simulate_loop
from stemwatch.models.studies.simulator.defects import PackingDefects
from stemwatch.models.studies.simulator.hidden import draw_nulls
from tests.models.mismatch.simulated_drive import drive


@cache
def explained(S, lag_s, load):
    """What is found in a drive."""
    return explain(drive(S, lag_s=lag_s, load=load))


def named(result):
    """The slugs that are named."""
    return {effect.slug for effect in result.effects}


@pytest.mark.long
@pytest.mark.parametrize(
    ("S", "lag_s", "load"), [(1.2, 0.3, 4.0), (0.6, 0.15, 2.0), (0.3, 0.08, 1.0)]
)
def test_the_same_drive_has_the_same_names_at_every_gain(S, lag_s, load):
    """Friction, lag and pull shrink as one over the gain, the names stay."""
    result = explained(S, lag_s, load)
    assert result.finding is Finding.NAMED
    assert named(result) == {"motor_drive", "load_by_position"}
    assert result.restated.S.value == pytest.approx(S, rel=0.15)
    assert result.restated.S.low <= S <= result.restated.S.high
    assert result.heldout.rmse_extended < 0.5 * result.heldout.rmse_naive


@pytest.mark.parametrize(
    ("S", "lag_s", "run_up_s", "load"),
    [(0.2, 0.018, 0.1, 0.5), pytest.param(0.3, 0.02, 0.12, 1.0, marks=pytest.mark.long)],
)
def test_a_motor_that_is_hardly_damped_is_a_drive_and_no_ringing_positioner(
    S, lag_s, run_up_s, load
):
    """Its lag is shorter than three samples, but its swing takes dozens."""
    recording = drive(S, lag_s=lag_s, run_up_s=run_up_s, load=load, top_speed=400.0)
    found = explain(recording)
    assert "motor_drive" in {effect.slug for effect in found.effects}
    assert {effect.slug for effect in found.effects} <= {"motor_drive", "load_by_position"}
    assert found.restated.S.value == pytest.approx(S, abs=0.03)
    assert found.restated.S.low <= S <= found.restated.S.high


@pytest.mark.long
def test_a_load_that_pulls_by_little_is_not_named():
    """Nor is a span error in its place."""
    result = explained(0.3, 0.08, 0.2)
    assert named(result) == {"motor_drive"}
    assert result.restated.S.value == pytest.approx(0.3, abs=0.05)


def test_the_naive_fit_takes_the_lag_for_a_wide_dead_band():
    """The naive S is shown beside the restated one."""
    result = explained(1.2, 0.3, 4.0)
    assert result.naive.S.value > 5.0


def test_the_pull_is_said_with_its_size_and_direction():
    """The weight pulls towards the middle from either side."""
    result = explained(1.2, 0.3, 4.0)
    load = next(effect for effect in result.effects if effect.slug == "load_by_position")
    assert load.parameters["rise"].value == pytest.approx(8.0, rel=0.2)
    assert "more towards falling at 75 % of travel than at 25 %" in load.sentence


@pytest.mark.long
@pytest.mark.parametrize("factor", [0.001, 100.0])
def test_names_and_S_do_not_depend_on_the_time_unit(factor):
    """The time constants are as much longer."""
    plain = explained(0.6, 0.15, 2.0)
    recording = drive(0.6, lag_s=0.15, load=2.0)
    other = explain(replace(recording, interval_s=0.01 * factor))
    assert named(other) == named(plain)
    assert other.restated.S.value == pytest.approx(plain.restated.S.value)
    taus = [
        next(e for e in item.effects if e.slug == "motor_drive").parameters["tau"].value
        for item in (plain, other)
    ]
    assert taus[1] == pytest.approx(factor * taus[0], rel=1e-6)


def stored_late(case, valve):
    """The loop of ``case`` with this valve, its position stored five samples late."""
    recording = simulate_loop(replace(case.loop, valve=valve), case.seed).recording
    assert recording.mv is not None
    stored = recording.mv.values[np.maximum(np.arange(len(recording)) - 5, 0)]
    late = Signal.good(stored, recording.mv.tag, recording.mv.unit)
    return replace(recording, signals={**recording.signals, Role.MV: late})


@pytest.mark.long
def test_a_late_position_of_a_sticking_valve_is_no_motor() -> None:
    """Stored 5 s late, its smooth answer looks like that of a motor without friction; a dead time
    and friction predict it better. This valve was called healthy (`robustness --seed 2103`)."""
    wide = [case for case in draw_nulls(160, 2103, "routine") if 3.0 <= case.loop.valve.S <= 8.0]
    valve = replace(wide[28].loop.valve, packing=PackingDefects())
    answer = explain(stored_late(wide[28], valve))
    assert [effect.slug for effect in answer.effects] == ["dead_time"]
    assert answer.restated.S.value == pytest.approx(valve.S, abs=0.3)


def test_a_late_position_of_a_healthy_valve_is_no_motor() -> None:
    """Where friction is small, a late clock and a lag of a sample are followed by a motor as well:
    nothing shows that the stem gathers speed over several samples (`robustness --seed 2129`)."""
    case = draw_nulls(40, 2130, "routine")[4]
    valve = replace(case.loop.valve, S=0.32, J=0.1, packing=PackingDefects())
    assert named(explain(stored_late(case, valve))) == {"dead_time"}
