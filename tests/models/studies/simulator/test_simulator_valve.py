"""The friction of the simulated valve is the one its nameplate says, read off a slow stroke."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stemwatch.models.recording import Floats
from stemwatch.models.studies.simulator import Actuator, PlantLoop, SimulatedValve, simulate_loop
from stemwatch.models.studies.simulator.loop import Controller, ManualSpan, SimulatedArchive
from stemwatch.models.studies.simulator.simulate import STEP_S
from stemwatch.models.studies.simulator.valve import slip_share
from stemwatch.models.verdict import Shape

_RATE = 0.2  # percent per second, slow against every air lag below
_INTERVAL_S = 0.05
_ACTUATOR = Actuator(air_lag_s=0.2)


def _stroke(valve: SimulatedValve, *turns: float) -> tuple[Floats, Floats]:
    """(OP, true stem) of an open-loop stroke through ``turns`` percent at a steady rate."""
    times = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(turns)) / _RATE)])
    knots = tuple((float(t), float(op)) for t, op in zip(times, turns, strict=True))
    loop = PlantLoop(
        valve=valve,
        controller=Controller(scan_s=0.05, output=turns[0]),
        manual=(ManualSpan(start_s=-100.0, stop_s=1e6, knots=knots),),
        archive=SimulatedArchive(interval_s=_INTERVAL_S),
        duration_s=float(times[-1]),
        warmup_s=10.0,
    )
    run = simulate_loop(loop, seed=0)
    return run.recording.op.values, run.stem


def _slips(op: Floats, stem: Floats) -> list[tuple[float, float]]:
    """(OP, signed height) of every slip: 0.5 s in which the stem moves five times the ramp's way.

    The height is that of 1 s less what the ramp itself moves in it.
    """
    width = round(0.5 / _INTERVAL_S)
    moved = stem[width:] - stem[:-width]
    fast = np.abs(moved) > 5.0 * _RATE * 0.5
    starts = np.flatnonzero(fast[1:] & ~fast[:-1]) + 1
    matching = []
    for start in starts:
        place = start + width  # the window first sees the slip in its last sample
        after = min(place + 2 * width, stem.size - 1)
        height = stem[after] - stem[place - 2]
        matching.append((float(op[place - 1]), float(height - np.sign(height) * _RATE * 1.0)))
    return matching


@pytest.mark.parametrize(("S", "J"), [(5.0, 2.0), (8.0, 6.0), (4.0, 4.0), (3.0, 3.9)])
def test_a_reversal_shows_S_and_the_slip_shows_J(S: float, J: float) -> None:
    """The input travel from a reversal to the slip is S and the slip's height J, within 5 %."""
    valve = SimulatedValve(S=S, J=J, scatter=0.0, actuator=_ACTUATOR)
    op, stem = _stroke(valve, 40.0, 60.0, 40.0)
    slips = _slips(op, stem)
    assert [1.0, -1.0] == [np.sign(height) for _, height in slips]
    assert pytest.approx(S, rel=0.05) == op.max() - slips[1][0]
    assert pytest.approx(J, rel=0.05) == abs(slips[1][1])


@pytest.mark.parametrize(("S", "J"), [(5.0, 0.0), (5.0, 2.0), (4.0, 4.0), (3.0, 3.9)])
def test_a_sliding_stem_keeps_its_distance(S: float, J: float) -> None:
    """The rising and the falling line of the loop lie S - J apart, also where that is negative."""
    op, stem = _stroke(SimulatedValve(S=S, J=J, scatter=0.0, actuator=_ACTUATOR), 40.0, 60.0, 40.0)
    half = op.size // 2
    rising = (op - stem)[int(0.8 * half)]
    falling = (op - stem)[half + int(0.8 * half)]
    lag = 2.0 * _RATE * (_ACTUATOR.air_lag_s + _ACTUATOR.viscous_s)
    assert pytest.approx(S - J, abs=0.05 * S) == rising - falling - lag


def test_a_dead_band_has_no_slip() -> None:
    """With J = 0 the stem waits through S and then follows without a jump."""
    op, stem = _stroke(
        SimulatedValve(S=5.0, J=0.0, scatter=0.0, actuator=_ACTUATOR), 40.0, 60.0, 40.0
    )
    assert [] == _slips(op, stem)
    turn = int(np.argmax(op))
    left = turn + int(np.argmax(stem[turn:] < stem.max() - 0.05))
    assert pytest.approx(5.0, rel=0.05) == op.max() - op[left]


def test_a_positioner_drives_past() -> None:
    """On a packing that lets go suddenly a slow positioner makes S < J without any push."""
    actuator = replace(_ACTUATOR, air_lag_s=0.6)
    valve = SimulatedValve.showing(3.0, 3.8, positioner_gain=1.5, scatter=0.0, actuator=actuator)
    assert valve.S > valve.J
    # The first slip upwards comes at half the packing's S + J over 1 + G = 3.4 %; turn soon after.
    op, stem = _stroke(valve, 40.0, 44.0, 38.0)
    slips = _slips(op, stem)
    assert [1.0, -1.0] == [np.sign(height) for _, height in slips]
    # The stem stands after the slip, so nothing of the ramp is to be taken off its height.
    heights = [abs(height) + _RATE * 1.0 for _, height in slips]
    assert pytest.approx([3.8, 3.8], rel=0.02) == heights
    # S is what the input travels from the opening that made the slip, not from where it turned.
    # The pressure lags its ramp of (1 + G) times the input's at either slip.
    late = 2.0 * _RATE * actuator.air_lag_s
    assert pytest.approx(3.0, rel=0.05) == slips[0][0] - slips[1][0] - late
    assert stem.max() > op.max() - 0.3


@pytest.mark.parametrize("gain", [5.0, 10.0])
def test_a_positioner_hides_friction(gain: float) -> None:
    """A positioner of gain G leaves the dead band S / (1 + G) of a packing without slip jump."""
    valve = SimulatedValve.showing(0.4, 0.0, positioner_gain=gain, scatter=0.0, actuator=_ACTUATOR)
    op, stem = _stroke(valve, 40.0, 50.0, 40.0)
    turn = int(np.argmax(op))
    left = turn + int(np.argmax(stem[turn:] < stem.max() - 0.01))
    assert pytest.approx(0.4 * (1.0 + gain)) == valve.S
    assert 0.0 == valve.J
    assert pytest.approx(0.4, abs=0.08) == op.max() - op[left]


def test_scatter_spreads_the_slips() -> None:
    """With breakaway scatter successive reversals need different travel, around S."""
    turns = (40.0, *([48.0, 40.0] * 12))
    op, stem = _stroke(SimulatedValve(S=5.0, J=4.0, scatter=0.08, actuator=_ACTUATOR), *turns)
    slips = _slips(op, stem)
    travel = [48.0 - at if height < 0 else at - 40.0 for at, height in slips[1:]]
    assert pytest.approx(5.0, rel=0.05) == np.mean(travel)
    # Half the scatter of the breakaway level (S + J)/2 = 4.5 %, at least.
    assert 0.5 * 0.08 * 4.5 < np.std(travel) < 2.0 * 0.08 * 4.5


def test_the_stem_stays_within_its_stroke() -> None:
    """The stem never leaves 0 to 100 %, and friction keeps it from following OP off the stop."""
    op, stem = _stroke(
        SimulatedValve(S=6.0, J=2.0, actuator=_ACTUATOR), 90.0, 100.0, 85.0, 0.0, 12.0
    )
    assert stem.min() >= 0.0
    assert stem.max() <= 100.0
    assert pytest.approx(0.0, abs=2.1) == stem[np.argmin(op)]


@pytest.mark.parametrize(
    ("S", "J", "shape"),
    [
        (5.0, 0.0, Shape.DEADBAND),
        (5.0, 2.0, Shape.UNDERSHOOT),
        (5.0, 5.0, Shape.NO_OFFSET),
        (3.0, 4.0, Shape.OVERSHOOT),
    ],
)
@pytest.mark.parametrize("gain", [0.0, 1.5])
def test_a_valve_reports_the_S_and_J_that_it_shows(
    S: float, J: float, shape: Shape, gain: float
) -> None:
    """``SimulatedValve.showing`` gives the asked S, J and shape with and without positioner."""
    valve = SimulatedValve.showing(S, J, positioner_gain=gain)
    assert pytest.approx((S, J)) == (valve.S_read, valve.J_read)
    assert shape is valve.shape
    assert not valve.healthy


def test_negative_friction_is_refused() -> None:
    """A negative S is an error that names the field and the value."""
    with pytest.raises(ValueError, match=r"Valve\.S must not be negative: -1\.0"):
        SimulatedValve(S=-1.0)


def test_whole_numbers_simulate_like_fractions() -> None:
    """A loop written with integers behaves exactly as with floats."""
    fraction = PlantLoop(valve=SimulatedValve(S=5.0, J=2.0), controller=Controller(output=40.0))
    loop = replace(fraction, valve=SimulatedValve(S=5, J=2), controller=Controller(output=40))
    runs = [
        simulate_loop(replace(x, duration_s=300.0, setpoints=((10.0, 56.0),)), seed=2)
        for x in (fraction, loop)
    ]
    np.testing.assert_array_equal(runs[0].stem, runs[1].stem)
    assert np.ptp(runs[0].stem) > 1.0


def test_the_step_is_a_millisecond() -> None:
    """The default step resolves the quickest slip drawn, 15 ms, at least tenfold."""
    assert 0.015 / STEP_S >= 10.0


@settings(max_examples=50, deadline=None)
@given(gain=st.floats(0.1, 20.0), air_lag_s=st.floats(0.01, 5.0), viscous_s=st.floats(0.005, 0.1))
def test_a_slip_covers_between_all_and_the_positioners_share_of_J(
    gain: float, air_lag_s: float, viscous_s: float
) -> None:
    """However slow the air, the slip is at most J; however quick, the stem gets the static way."""
    share = slip_share(gain, air_lag_s, viscous_s)
    assert 1.0 / (1.0 + gain) <= share * (1.0 + 1e-9)
    assert share <= 1.0
    assert share <= slip_share(gain, 2.0 * air_lag_s, viscous_s) + 1e-9
