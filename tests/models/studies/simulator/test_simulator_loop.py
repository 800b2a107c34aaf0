"""Closed loops: sticky ones cycle, well-tuned healthy ones do not, and chance is repeatable."""

import json
from dataclasses import replace

import numpy as np
import pytest

from stemwatch.models.recording import Quality, Role
from stemwatch.models.studies.simulator import (
    PlantLoop,
    SimulatedValve,
    draw_healthy,
    draw_sticky,
    simulate_loop,
)
from stemwatch.models.studies.simulator.loop import (
    Compression,
    CompressionKind,
    Controller,
    Load,
    LoadKind,
    ManualSpan,
    Process,
    ProcessKind,
    SimulatedArchive,
    Span,
    Transmitters,
)

_FLOW = PlantLoop(setpoints=((10.0, 51.3),), duration_s=3600.0)
_LEVEL = replace(
    _FLOW,
    process=Process(
        kind=ProcessKind.LEVEL, gain=0.01, integrating=True, second_lag_s=1.0, dead_time_s=5.0
    ),
    controller=Controller(gain=6.0, reset_s=60.0),
)


@pytest.mark.parametrize(
    ("loop", "valve"),
    [
        (_FLOW, SimulatedValve(S=4.0, J=2.5)),
        (_FLOW, SimulatedValve(S=3.0, J=3.0)),
        (_FLOW, SimulatedValve(S=3.0, J=3.8)),
        (_LEVEL, SimulatedValve(S=4.0, J=0.0)),
        (_LEVEL, SimulatedValve(S=4.0, J=2.0)),
    ],
    ids=["undershoot", "no offset", "overshoot", "dead band on a level", "undershoot on a level"],
)
def test_a_sticky_loop_cycles_by_itself(loop: PlantLoop, valve: SimulatedValve) -> None:
    """Without any disturbance a sticking valve keeps its loop in a limit cycle to the end."""
    run = simulate_loop(replace(loop, valve=valve), seed=5)
    late = slice(len(run.recording) // 2, None)
    assert np.ptp(run.recording.op.values[late]) > 0.7 * valve.S
    # Several strokes in the second half: there, back, there and back.
    stroke = np.ptp(run.stem[late])
    assert np.abs(np.diff(run.stem[late])).sum() > 3.9 * stroke > 2.0


def test_the_truth_tells_the_period_of_a_cycle() -> None:
    """The period of a limit cycle is the time between its openings; a drawn wave gives its own."""
    sticky = simulate_loop(replace(_LEVEL, valve=SimulatedValve(S=4.0, J=4.0, scatter=0.0)), seed=5)
    opened = np.flatnonzero(np.diff(sticky.stem) > 2.0)
    assert opened.size > 8
    assert pytest.approx(np.diff(opened).mean(), rel=0.1) == sticky.truth.period_s
    wave = (Load(kind=LoadKind.OSCILLATING, size=3.0, time_s=60.0),)
    assert 60.0 == simulate_loop(replace(_FLOW, loads=wave), seed=5).truth.period_s


@pytest.mark.parametrize("loop", [_FLOW, _LEVEL], ids=["flow", "level"])
def test_a_well_tuned_healthy_loop_comes_to_rest(loop: PlantLoop) -> None:
    """The same loops with a healthy valve settle at the set point."""
    calm = Transmitters(pv_noise=0.01)
    run = simulate_loop(
        replace(loop, valve=SimulatedValve(S=0.2, J=0.0), transmitters=calm), seed=5
    )
    late = slice(len(run.recording) // 2, None)
    assert np.ptp(run.stem[late]) < 0.5
    pv, sp = run.recording.signals[Role.PV], run.recording.signals[Role.SP]
    assert abs(np.mean((pv.values - sp.values)[late])) < 0.2
    assert run.truth.period_s is None


@pytest.mark.long
def test_a_badly_tuned_loop_rings() -> None:
    """A healthy valve in a loop at gain margin 1.05 swings widely and is still called healthy."""
    loops = [loop for loop in draw_healthy(24, seed=1) if loop.story == "healthy, badly tuned"]
    assert 4 == len(loops)
    for loop in loops:
        quiet = replace(loop, controller=replace(loop.controller, gain=loop.controller.gain / 3))
        ringing, calm = simulate_loop(loop, seed=1), simulate_loop(quiet, seed=1)
        assert np.abs(np.diff(ringing.stem)).sum() > 2.0 * np.abs(np.diff(calm.stem)).sum()
        assert ringing.truth.healthy


def test_the_same_seed_gives_the_same_recording() -> None:
    """Two runs of one seed are equal to the last bit; another seed differs."""
    loop = replace(_FLOW, valve=SimulatedValve(S=4.0, J=2.0), duration_s=300.0)
    first, repeated, other = (simulate_loop(loop, seed) for seed in (7, 7, 8))
    for role, signal in first.recording.signals.items():
        np.testing.assert_array_equal(signal.values, repeated.recording.signals[role].values)
    assert first.truth == repeated.truth
    assert not np.array_equal(first.recording.op.values, other.recording.op.values)


def test_a_step_of_the_load_is_regulated_away() -> None:
    """The controller answers a lasting load with the opposite opening and PV returns."""
    loads = (Load(kind=LoadKind.STEPS, size=8.0, time_s=900.0),)
    run = simulate_loop(replace(_FLOW, setpoints=(), loads=loads, duration_s=3600.0), seed=3)
    pv = run.recording.signals[Role.PV].values
    assert np.ptp(run.stem) > 4.0
    assert pytest.approx(50.0, abs=0.3) == np.median(pv)


def test_the_output_is_limited_and_comes_back_at_once() -> None:
    """At its limit OP stays there, and leaves it soon after the set point does: no windup."""
    loop = replace(
        _FLOW,
        controller=Controller(gain=0.4, reset_s=6.0, output=90.0),
        setpoints=((50.0, 75.0), (650.0, 50.0)),
        duration_s=800.0,
    )
    op = simulate_loop(loop, seed=1).recording.op.values
    assert pytest.approx(100.0, abs=0.05) == op[400:640].min() == op.max()
    assert op[660] < 95.0


def test_manual_is_bumpless() -> None:
    """In manual OP follows the operator; on return to automatic it goes on from where it was."""
    span = ManualSpan(
        start_s=100.0, stop_s=200.0, knots=((100.0, 50.0), (110.0, 56.0), (200.0, 51.0))
    )
    run = simulate_loop(replace(_FLOW, setpoints=(), manual=(span,), duration_s=400.0), seed=1)
    op, mode = run.recording.op.values, run.recording.signals[Role.MODE].values
    assert pytest.approx(56.0, abs=0.1) == op[111]
    assert [1.0, 0.0, 0.0, 1.0] == [mode[index] for index in (99, 100, 199, 200)]
    assert abs(op[203] - op[199]) < 1.0
    assert "manual" in run.truth.effects


def test_the_archive_marks_gaps_and_bad_status() -> None:
    """A gap is missing in every signal; bad status is bad in its own signal only, and both NaN."""
    archive = SimulatedArchive(
        gaps=(Span(start_s=10.0, stop_s=20.0),),
        bad=(Span(start_s=30.0, stop_s=35.0, role=Role.MV),),
    )
    recording = simulate_loop(replace(_FLOW, archive=archive, duration_s=60.0), seed=1).recording
    for signal in recording.signals.values():
        assert [Quality.MISSING] * 10 == signal.quality[10:20].tolist()
        assert np.isnan(signal.values[10:20]).all()
    assert recording.mv is not None
    assert [Quality.BAD] * 5 == recording.mv.quality[30:35].tolist()
    assert [Quality.GOOD] * 5 == recording.op.quality[30:35].tolist()


def test_a_frozen_transmitter_repeats_while_the_stem_moves() -> None:
    """A frozen position repeats one value with good quality; the true stem goes on."""
    archive = SimulatedArchive(frozen=(Span(start_s=5.0, stop_s=60.0, role=Role.MV),))
    run = simulate_loop(replace(_FLOW, archive=archive, duration_s=60.0), seed=1)
    mv = run.recording.mv
    assert mv is not None
    assert 0.0 == np.ptp(mv.values[5:])
    assert mv.usable.all()
    assert np.ptp(run.stem[5:]) > 0.5


def test_exception_reporting_holds_and_the_door_stays_within_its_width() -> None:
    """Both ways of thinning stay within the deviation; exceptions are held, doors are sloped."""
    moving = replace(
        _FLOW, valve=SimulatedValve(), loads=(Load(kind=LoadKind.COLOURED, size=2.0, time_s=20.0),)
    )
    values = simulate_loop(moving, seed=2).recording.op.values
    thinned = {}
    for kind in CompressionKind:
        archive = SimulatedArchive(
            compression=(Compression(role=Role.OP, kind=kind, deviation=0.5),)
        )
        thinned[kind] = simulate_loop(replace(moving, archive=archive), seed=2).recording.op.values
        assert np.max(np.abs(thinned[kind] - values)) <= 0.5 + 1e-9
    steps = np.diff(thinned[CompressionKind.EXCEPTION])
    assert np.mean(steps == 0.0) > 0.5
    bends = np.abs(np.diff(thinned[CompressionKind.SWINGING_DOOR], n=2))
    assert np.mean(bends < 1e-9) > 0.5


def test_transmitter_errors_are_on_the_reading_only() -> None:
    """Zero, span and rounding change the reported position and not the stem."""
    seen = Transmitters(
        position_noise=0.0, position_zero=0.7, position_span=1.02, position_step=0.1
    )
    true = simulate_loop(_FLOW, seed=2)
    read = simulate_loop(replace(_FLOW, transmitters=seen), seed=2)
    np.testing.assert_array_equal(true.stem, read.stem)
    expected = 1.02 * (true.stem - 50.0) + 50.7
    mv = read.recording.mv
    assert mv is not None
    np.testing.assert_allclose(mv.values, expected, atol=0.05 + 1e-9)
    np.testing.assert_allclose(mv.values * 10.0, np.round(mv.values * 10.0), atol=1e-6)


def test_the_truth_of_a_drawn_loop_serialises() -> None:
    """Truth goes through JSON unchanged and its parameters are flat and plain."""
    run = simulate_loop(replace(draw_sticky(4, seed=1)[3], duration_s=60.0), seed=9)
    back = json.loads(json.dumps(run.truth.as_json()))
    assert run.truth.as_json() == back
    assert run.loop.valve.S == back["parameters"]["valve.S"]
    assert "overshoot" == back["shape"]
    assert all(isinstance(v, float | int | str | bool | None) for v in back["parameters"].values())


def test_a_record_of_one_sample_is_refused() -> None:
    """Too short a duration names the loop, the duration and the interval."""
    with pytest.raises(ValueError, match=r"FIC-101: .*two samples.*1\.0 s at an interval of 1\.0"):
        PlantLoop(duration_s=1.0)


def test_a_loop_that_lasts_longer_moves_its_set_point_again() -> None:
    """As often as its recording goes into the longer one, and no set point lies behind its end."""
    loop = replace(_FLOW, setpoints=((10.0, 51.0), (1800.0, 49.0)))
    assert loop.lasting(3600.0) == loop
    longer = loop.lasting(9000.0)
    assert longer.duration_s == 9000.0
    assert longer.setpoints == ((10.0, 51.0), (1800.0, 49.0), (3610.0, 51.0), (5400.0, 49.0))
