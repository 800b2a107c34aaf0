"""Each defect of the simulated valve, against its plain twin, does what it says and no more."""

from dataclasses import replace

import numpy as np
import pytest

from stemwatch.models.recording import Floats, Role
from stemwatch.models.studies.simulator import Actuator, PlantLoop, SimulatedValve, simulate_loop
from stemwatch.models.studies.simulator.defects import AirLine, BodyDefects, PackingDefects, Upsets
from stemwatch.models.studies.simulator.loop import (
    Compression,
    CompressionKind,
    Controller,
    ManualSpan,
    SimulatedArchive,
    Transmitters,
)

_INTERVAL_S = 0.1
_QUICK = Actuator(air_lag_s=0.1)
_FREE = SimulatedValve(S=0.2, J=0.0, scatter=0.0, actuator=_QUICK)
_STICKY = SimulatedValve(S=4.0, J=2.0, scatter=0.0, actuator=_QUICK)
_RAMP = ((0.0, 40.0), (100.0, 60.0), (200.0, 40.0))


def _played(
    valve: SimulatedValve,
    knots: tuple[tuple[float, float], ...],
    *,
    archive: SimulatedArchive | None = None,
    seen: Transmitters | None = None,
    upsets: Upsets | None = None,
) -> PlantLoop:
    """The valve alone on the OP through ``knots``, recorded ten times a second without noise."""
    return PlantLoop(
        valve=valve,
        controller=Controller(scan_s=_INTERVAL_S, output=knots[0][1]),
        transmitters=seen or Transmitters(position_noise=0.0),
        manual=(ManualSpan(start_s=-100.0, stop_s=1e6, knots=knots),),
        archive=archive or SimulatedArchive(interval_s=_INTERVAL_S),
        upsets=upsets or Upsets(),
        duration_s=knots[-1][0],
        warmup_s=10.0,
    )


def _stem(valve: SimulatedValve, knots: tuple[tuple[float, float], ...], **more) -> Floats:
    return simulate_loop(_played(valve, knots, **more), seed=0).stem


def _at(time_s: float) -> int:
    return round(time_s / _INTERVAL_S)


def _leaves(stem: Floats, since_s: float = 0.0) -> float:
    """When the stem has first moved by 0.05 %."""
    away = np.abs(stem - stem[_at(since_s)]) > 0.05
    return float(np.flatnonzero(away[_at(since_s) :])[0] * _INTERVAL_S + since_s)


def _offset(valve: SimulatedValve, knots: tuple[tuple[float, float], ...], time_s: float) -> float:
    """By how much OP leads the sliding stem at one time, percent."""
    run = simulate_loop(_played(valve, knots), seed=0)
    return float((run.output - run.stem)[_at(time_s)])


def test_a_lag_delays_the_breakaway_and_a_drag_does_not() -> None:
    """On a ramp the lagging valve starts a lag later; the dragging one on time, and slides late."""
    plain = _leaves(_stem(_STICKY, _RAMP))
    lag = replace(_STICKY, actuator=replace(_QUICK, air_lag_s=3.1))
    drag = replace(_STICKY, actuator=replace(_QUICK, viscous_s=3.0))
    assert pytest.approx(plain + 3.0, abs=0.3) == _leaves(_stem(lag, _RAMP))
    assert pytest.approx(plain, abs=0.4) == _leaves(_stem(drag, _RAMP))
    late = _offset(drag, _RAMP, 80.0) - _offset(_STICKY, _RAMP, 80.0)
    assert pytest.approx(0.2 * 3.0, abs=0.1) == late


def test_filling_and_venting_have_their_own_lag() -> None:
    """The stem covers 63 % of a step in the filling lag when opening, in the venting lag back."""
    valve = replace(_FREE, air_line=AirLine(vent_lag_s=4.0), actuator=Actuator(air_lag_s=1.0))
    knots = ((0.0, 40.0), (1.0, 40.0), (1.1, 60.0), (40.0, 60.0), (40.1, 40.0), (80.0, 40.0))
    stem = _stem(valve, knots)
    up = np.flatnonzero(stem > 40.0 + 0.632 * 20.0)[0] * _INTERVAL_S - 1.1
    down = np.flatnonzero(stem[_at(40.1) :] < 60.0 - 0.632 * 20.0)[0] * _INTERVAL_S
    assert pytest.approx([1.0, 4.0], abs=0.25) == [up, down]


def test_a_restriction_caps_the_speed_in_its_direction_only() -> None:
    """A vent that lets out 2 %/s closes the valve at that speed; opening is as quick as before."""
    knots = ((0.0, 40.0), (1.0, 40.0), (1.1, 70.0), (20.0, 70.0), (20.1, 40.0), (50.0, 40.0))
    limited = _stem(replace(_FREE, air_line=AirLine(vent_percent_per_s=2.0)), knots)
    plain = _stem(_FREE, knots)
    np.testing.assert_allclose(limited[: _at(20.0)], plain[: _at(20.0)], atol=1e-9)
    speed = np.diff(limited[_at(21.0) : _at(33.0)]) / _INTERVAL_S
    np.testing.assert_allclose(speed, -2.0, rtol=0.02)


def test_a_relay_rings_at_its_frequency_and_damping() -> None:
    """The overshoot is ``exp(-pi z/sqrt(1 - z^2))`` of the step, half a period after it."""
    ring = AirLine(ring_rad_per_s=0.6, ring_damping=0.3)
    stem = _stem(replace(_FREE, air_line=ring), ((0.0, 40.0), (0.1, 60.0), (30.0, 60.0)))
    over = np.exp(-np.pi * 0.3 / np.sqrt(1.0 - 0.3**2))
    assert pytest.approx(20.0 * over, rel=0.05) == stem.max() - 60.0
    assert pytest.approx(np.pi / (0.6 * np.sqrt(1.0 - 0.3**2)), abs=0.4) == stem.argmax() * 0.1


def test_a_weak_supply_leaves_the_valve_short_after_an_opening() -> None:
    """Soon after a large opening a tenth of the way is missing, and a minute later little of it;
    closing, which takes no air, is as without."""
    knots = ((0.0, 40.0), (0.1, 70.0), (150.0, 70.0), (150.1, 40.0), (170.0, 40.0))
    sagging = replace(_FREE, air_line=AirLine(sag_share=0.1, sag_s=20.0))
    short = _stem(_FREE, knots) - _stem(sagging, knots)
    assert pytest.approx(30.0 * 0.1 / 1.1, rel=0.2) == short[_at(1.5)]
    assert abs(short[_at(100.0)]) < 0.3
    assert abs(short[_at(168.0)]) < 0.3


def test_a_skewed_packing_jumps_further_one_way() -> None:
    """With skew 0.5 the slips on a ramp are 3 % up and 1 % down at J = 2 %; S stays."""
    knots = ((0.0, 40.0), (100.0, 60.0), (200.0, 40.0))
    stem = _stem(replace(_STICKY, packing=PackingDefects(J_skew=0.5)), knots)
    step = stem[10:] - stem[:-10]
    assert pytest.approx(3.0, abs=0.3) == step.max()
    assert pytest.approx(-1.0, abs=0.3) == step[_at(100.0) :].min()


def test_a_tight_spot_holds_the_stem_back_there_only() -> None:
    """Sliding through the spot OP leads by its height more; three widths away by nothing."""
    knots = ((0.0, 30.0), (200.0, 70.0))
    tight = replace(_STICKY, packing=PackingDefects(bump_percent=2.0, bump_width_percent=4.0))
    runs = [simulate_loop(_played(valve, knots), seed=0) for valve in (_STICKY, tight)]
    leads = [np.interp([36.0, 50.0, 66.0], run.stem, run.output - run.stem) for run in runs]
    assert pytest.approx([0.0, 2.0, 0.0], abs=0.1) == leads[1] - leads[0]


def test_growing_friction_widens_the_loop_evenly() -> None:
    """At the end of the record the kinetic level is twice, in the middle one and a half times."""
    knots = ((0.0, 40.0), (100.0, 60.0), (200.0, 40.0))
    run = simulate_loop(_played(_STICKY, knots, upsets=Upsets(growth=1.0)), seed=0)
    lead = np.abs(run.output - run.stem)
    plain = 0.5 * (_STICKY.S - _STICKY.J)
    for time in (90.0, 190.0):
        assert pytest.approx(plain * (1.0 + time / 200.0), rel=0.05) == lead[_at(time)]


@pytest.mark.parametrize(
    ("settles", "expected"), [(False, 0.4 * np.log(1.0 + 300.0 / 5.0)), (True, 0.4)]
)
def test_a_long_rest_raises_the_breakaway(settles: bool, expected: float) -> None:
    """After 300 s of rest the stem needs ``b ln(1 + t/5)`` more than a plain one, or b at most."""
    packing = PackingDefects(dwell_percent=0.4, dwell_settles=settles)
    knots = ((0.0, 40.0), (50.0, 50.0), (350.0, 50.0), (400.0, 60.0))
    dwelling = replace(_STICKY, packing=packing)
    op = {valve: _leaves(_stem(valve, knots), 300.0) * 0.2 for valve in (_STICKY, dwelling)}
    assert pytest.approx(expected, abs=0.12) == op[dwelling] - op[_STICKY]


def test_a_creeping_stem_moves_while_it_stands() -> None:
    """Held in the middle of its dead band the stem creeps at the stated speed, and not when it
    slides."""
    creeping = replace(_STICKY, packing=PackingDefects(creep_percent_per_s=0.02))
    stem = _stem(creeping, ((0.0, 50.0), (50.0, 50.0)))
    assert (
        pytest.approx(0.02, rel=0.02) == np.polyfit(np.arange(200) * _INTERVAL_S, stem[:200], 1)[0]
    )
    plain, other = (_offset(valve, _RAMP, 80.0) for valve in (_STICKY, creeping))
    assert pytest.approx(plain, abs=0.01) == other


def test_a_stop_is_never_passed() -> None:
    """The stem rests on the stop while OP goes on, and comes off when the force turns."""
    stopped = replace(_STICKY, body=BodyDefects(high_percent=52.0, low_percent=45.0))
    stem = _stem(stopped, _RAMP)
    assert 52.0 == pytest.approx(stem.max())
    assert 45.0 == pytest.approx(stem.min())
    free = stem < 51.9
    np.testing.assert_allclose(stem[free][: _at(20.0)][-1], stem[_at(20.0) - 1])


def test_a_flow_force_shifts_the_stem_at_both_ends_of_the_stroke() -> None:
    """The sliding stem leads its plain twin by U near the ends and by nothing at the peak."""
    knots = ((0.0, 2.0), (250.0, 98.0))
    forced = replace(_FREE, body=BodyDefects(flow_percent=3.0))
    gain = _stem(forced, knots) - _stem(_FREE, knots)
    middle = np.argmin(np.abs(_stem(_FREE, knots) - 50.0))
    assert pytest.approx(0.0, abs=0.1) == gain[middle]
    assert pytest.approx(3.0 * (1.0 - np.sin(np.pi * 0.1)), abs=0.5) == gain[_at(20.0)]


def test_play_and_errors_are_between_stem_and_reading_only() -> None:
    """Play, drift and a bowed linkage leave stem and OP to the bit; the reading has them."""
    seen = Transmitters(position_noise=0.0, position_play=1.0)
    simulated = simulate_loop(_played(_FREE, _RAMP), seed=0)
    loose = simulate_loop(_played(_FREE, _RAMP, seen=seen), seed=0)
    drifting = simulate_loop(
        _played(_FREE, _RAMP, seen=replace(seen, position_play=0.0, position_drift=2.0)), seed=0
    )
    bowed = replace(seen, position_play=0.0, position_bow=1.5)
    bent = simulate_loop(_played(_FREE, _RAMP, seen=bowed), seed=0)
    for run in (loose, drifting, bent):
        np.testing.assert_array_equal(simulated.stem, run.stem)
    lost = loose.stem - loose.reading
    assert pytest.approx([0.5, -0.5], abs=1e-6) == [lost[_at(90.0)], lost[_at(190.0)]]
    gained = drifting.reading - drifting.stem
    np.testing.assert_allclose(gained, np.linspace(0.0, 2.0, gained.size), atol=1e-9)
    np.testing.assert_allclose(bent.reading - bent.stem, 1.5 * np.sin(np.pi * bent.stem / 50.0))


def test_bristles_show_the_same_S_and_J() -> None:
    """On a ramp LuGre friction slips by J and turns by S like Karnopp's, within a tenth."""
    soft = replace(_STICKY, packing=PackingDefects(presliding_percent=0.002))
    stems = [_stem(valve, _RAMP) for valve in (_STICKY, soft)]
    heights = [np.max(stem[10:] - stem[:-10]) for stem in stems]
    assert pytest.approx(heights[0], rel=0.1) == heights[1]
    turns = [np.flatnonzero(stem[_at(100.0) :] < stem.max() - 0.3)[0] for stem in stems]
    assert pytest.approx(turns[0], rel=0.1) == turns[1]


def test_a_higher_stribeck_speed_makes_a_slow_ramp_a_staircase() -> None:
    """At 0.2 %/s a plain stem slides; with a Stribeck speed of 1 %/s it stops again and again."""
    sticking = replace(_STICKY, actuator=replace(_QUICK, stribeck_percent_per_s=1.0))
    smooth = replace(_STICKY, actuator=replace(_QUICK, stribeck_percent_per_s=0.005))
    still = [
        np.mean(np.diff(_stem(valve, _RAMP)[_at(30.0) : _at(95.0)]) == 0.0)
        for valve in (smooth, sticking)
    ]
    assert still[0] < 0.05
    assert still[1] > 0.7


def test_jitter_reads_the_position_at_another_time_and_averages_hold() -> None:
    """A jittered reading is the stem of at most the jitter ago; an averaged one comes in blocks."""
    knots = ((0.0, 40.0), (100.0, 90.0))
    jittered = SimulatedArchive(interval_s=1.0, position_jitter_s=2.0)
    run = simulate_loop(_played(_FREE, knots, archive=jittered), seed=0)
    late_s = (run.stem - run.recording.mv.values)[5:] / 0.5
    assert 0.0 <= late_s.min() < 0.3
    assert 1.7 < late_s.max() <= 2.1
    averaged = SimulatedArchive(interval_s=1.0, average_s=5.0)
    mean = simulate_loop(_played(_FREE, knots, archive=averaged), seed=0)
    mv, op = mean.recording.mv.values, mean.recording.op.values
    assert 20 == np.unique(mv).size == np.unique(op).size
    assert pytest.approx(np.mean(mean.stem[10:15]), abs=0.3) == mv[17]


def test_an_export_of_raw_values_has_only_what_was_kept() -> None:
    """Unfilled, the samples between the knots are missing; the knots are the filled one's."""
    doors = [
        Compression(role=Role.MV, kind=CompressionKind.SWINGING_DOOR, deviation=0.5, filled=filled)
        for filled in (True, False)
    ]
    filled, raw = (
        simulate_loop(
            _played(_STICKY, _RAMP, archive=SimulatedArchive(compression=(door,))), seed=0
        )
        for door in doors
    )
    usable = raw.recording.mv.usable
    assert 0.02 < usable.mean() < 0.5
    np.testing.assert_array_equal(
        filled.recording.mv.values[usable], raw.recording.mv.values[usable]
    )


def test_pushes_and_binding_come_and_go() -> None:
    """A push by hand moves a standing stem; binding holds a sliding one back for its episodes."""
    still = ((0.0, 50.0), (400.0, 50.0))
    pushed = _stem(_STICKY, still, upsets=Upsets(push_percent=8.0, push_every_s=100.0))
    assert 0.0 == np.ptp(_stem(_STICKY, still))
    assert np.ptp(pushed) > 2.0
    slow = ((0.0, 20.0), (400.0, 80.0))
    binding = Upsets(binding=3.0, binding_every_s=100.0, binding_lasts_s=20.0)
    held = _stem(_STICKY, slow) - _stem(_STICKY, slow, upsets=binding)
    assert held.max() > 1.5
    assert np.mean(np.abs(held) < 0.1) > 0.4


_EVERYTHING = replace(
    _STICKY,
    packing=PackingDefects(
        J_skew=0.2, bump_percent=0.5, dwell_percent=0.2, creep_percent_per_s=0.005
    ),
    body=BodyDefects(high_percent=58.0, flow_percent=2.0, hysteresis_percent=0.5),
    air_line=AirLine(vent_lag_s=0.5, fill_percent_per_s=3.0, ring_rad_per_s=0.8, sag_share=0.1),
)


@pytest.mark.parametrize(
    "valve",
    [_EVERYTHING, replace(_STICKY, packing=PackingDefects(presliding_percent=0.002))],
    ids=["all of it", "bristles"],
)
def test_half_the_step_gives_the_same_stroke(valve: SimulatedValve) -> None:
    """With every defect at once, and with bristles, 1 ms and 0.5 ms agree to 0.05 % of travel."""
    loop = _played(valve, _RAMP, upsets=Upsets(growth=0.5))
    complete, half = (simulate_loop(loop, seed=4, step_s=step).stem for step in (1e-3, 5e-4))
    assert np.percentile(np.abs(complete - half), 98) < 0.05
    assert np.ptp(complete) > 8.0
