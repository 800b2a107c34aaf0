"""Effects of the recorder are named from the numbers alone, and effects of the valve are not among
them.
"""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stemwatch.models.mismatch.measurement.record_effects import measured_record, scan_sentence
from stemwatch.models.preparation.own_clock import on_own_clock
from stemwatch.models.record_checks.frozen import after_the_first, without_frozen
from stemwatch.models.recording import ClockFacts, Recording, Role, Signal
from stemwatch.models.signals.refresh_period import refresh_period
from stemwatch.models.studies.simulator import PlantLoop, SimulatedValve, simulate_loop
from stemwatch.models.studies.simulator.historian import swinging_door
from stemwatch.models.studies.simulator.loop import (
    Compression,
    CompressionKind,
    Load,
    LoadKind,
    SimulatedArchive,
    Span,
    Transmitters,
)

VALVES = [(4.0, 1.5), (0.3, 0.0), (6.0, 6.0)]
DOOR, EXCEPTION = CompressionKind.SWINGING_DOOR, CompressionKind.EXCEPTION
NOISELESS = Transmitters(position_noise=0.0, pv_noise=0.0)


@cache
def plant(S=4.0, J=1.5, transmitters=None, archive=None, seed=3) -> Recording:
    """An hour of a flow loop under load with set-point steps."""
    loop = PlantLoop(
        valve=SimulatedValve(S=S, J=J),
        setpoints=tuple((float(t), 50.0 + 9.0 * (-1) ** (t // 300)) for t in range(10, 3500, 310)),
        loads=(Load(kind=LoadKind.COLOURED, size=1.0, time_s=20.0),),
        transmitters=transmitters or Transmitters(position_noise=0.05),
        archive=archive or SimulatedArchive(),
    )
    return simulate_loop(loop, seed).recording


def with_position(mv, base=None) -> Recording:
    """A recording with another position."""
    base = base or plant()
    return replace(base, signals={**base.signals, Role.MV: Signal.good(mv, "FV-7.ZT")})


def printed(recording, digits) -> Recording:
    """The recording rounded to so many decimals, as in an export."""
    signals = {
        role: replace(signal, values=np.round(signal.values, digits))
        for role, signal in recording.signals.items()
    }
    return replace(recording, signals=signals)


def compressed(kind, deviation, role=Role.MV) -> SimulatedArchive:
    """An archive that thins one signal."""
    return SimulatedArchive(compression=(Compression(role=role, kind=kind, deviation=deviation),))


def frozen(start_s, stop_s) -> SimulatedArchive:
    """An archive whose position stands still from one time to another."""
    return SimulatedArchive(frozen=(Span(start_s=start_s, stop_s=stop_s, role=Role.MV),))


def found(recording) -> dict:
    """Record effects by slug; each says so in one sentence or more, without NaN."""
    effects = measured_record(recording).effects
    for effect in effects:
        assert effect.sentence[0].isupper()
        assert effect.sentence.endswith(".")
        assert all(np.isfinite(value) for value in effect.parameters.values())
    return {effect.slug: effect for effect in effects}


@pytest.mark.parametrize("digits", [None, 4, 2])
@pytest.mark.parametrize("transmitters", [None, NOISELESS])
@pytest.mark.parametrize(("S", "J"), VALVES)
def test_a_clean_record_has_no_effect(S, J, transmitters, digits):
    """A noisy or noiseless position of any valve, printed with any digits, is left alone."""
    recording = plant(S, J, transmitters)
    measured = measured_record(recording if digits is None else printed(recording, digits))
    assert () == measured.effects
    assert measured.real.all()
    assert (0.0, 1.0) == (measured.sigma_floor, measured.spacing_s)


@pytest.mark.parametrize(("S", "J"), VALVES)
@pytest.mark.parametrize(
    "step", [0.1, *(pytest.param(step, marks=pytest.mark.long) for step in (0.25, 0.5)), 1.0]
)
def test_a_coarse_position_is_quantised_and_nothing_else(S, J, step):
    """Steps from 0.1 to 1 % are measured; that a resting stem then repeats itself is not frozen."""
    measured = measured_record(plant(S, J, Transmitters(position_noise=0.05, position_step=step)))
    (effect,) = measured.effects
    assert "quantisation" == effect.slug
    assert effect.parameters["step_percent"] == pytest.approx(step)
    assert f"the position in steps of {step:.2g} %" in effect.sentence
    assert measured.sigma_floor == pytest.approx(step / np.sqrt(12.0))
    assert measured.real.all()


def test_a_coarse_command_is_named_as_such():
    """Steps of OP are separated from steps of the position, and do not change its noise."""
    measured = measured_record(plant(transmitters=Transmitters(op_step=0.5)))
    (effect,) = measured.effects
    assert {"op_step_percent": pytest.approx(0.5)} == effect.parameters
    assert 0.0 == measured.sigma_floor


@pytest.mark.parametrize("digits", [None, 4])
@pytest.mark.parametrize(("S", "J"), VALVES)
@pytest.mark.parametrize("deviation", [0.1, pytest.param(0.3, marks=pytest.mark.long), 1.0])
def test_interpolated_samples_are_left_out(S, J, deviation, digits):
    """Behind a swinging door exactly the stored points count as measured."""
    true = plant(S, J).signals[Role.MV].values
    recording = plant(S, J, None, compressed(DOOR, deviation))
    measured = measured_record(recording if digits is None else printed(recording, digits))
    (effect,) = measured.effects
    assert "historian_compression" == effect.slug
    assert "drew straight lines between them" in effect.sentence
    kept = measured.real.mean()
    assert effect.parameters["kept_share"] == pytest.approx(kept)
    assert 0.01 < kept < 0.5
    error = np.abs(recording.signals[Role.MV].values - true)
    assert np.mean(error[measured.real] < 1e-9) > 0.9
    assert np.mean(error[~measured.real] < 1e-9) < 0.1


def test_held_reports_are_left_out():
    """Exception reporting is recognised by steps that are never small; its deviation is
    estimated.
    """
    measured = measured_record(plant(archive=compressed(EXCEPTION, 0.1)))
    (effect,) = measured.effects
    assert effect.parameters["deviation_percent"] == pytest.approx(0.1, rel=0.05)
    assert "held the last between them" in effect.sentence
    assert measured.sigma_floor == pytest.approx(0.1 / np.sqrt(3.0), rel=0.05)


def test_a_compressed_command_is_named_and_leaves_out_no_sample():
    """Lines in OP are reported; the position still counts as measured."""
    measured = measured_record(plant(archive=compressed(DOOR, 0.3, Role.OP)))
    (effect,) = measured.effects
    assert {"op_kept_share"} == set(effect.parameters)
    assert measured.real.all()


def test_a_ramped_command_is_not_compressed():
    """Ramps by hand, however many, are straight lines too, and so is a stem that follows them."""
    t = np.arange(3600.0)
    knots = np.arange(0.0, 3601.0, 40.0)
    op = np.interp(t, knots, np.random.default_rng(4).uniform(20.0, 70.0, knots.size))
    base = plant()
    for mv in (op - 1.0, op + 0.05 * np.random.default_rng(1).standard_normal(t.size)):
        signals = {Role.OP: Signal.good(op, "OP"), Role.MV: Signal.good(mv, "ZT")}
        assert {} == found(replace(base, signals=signals))


def test_a_noiseless_speed_limit_is_not_compressed():
    """A stem at its top speed draws straight lines as well, all at the same slope."""
    op = plant(transmitters=NOISELESS).op.values
    mv = np.empty_like(op)
    mv[0] = op[0]
    for k in range(1, op.size):
        mv[k] = mv[k - 1] + np.clip(op[k] - mv[k - 1], -0.7, 0.4)
    assert "historian_compression" not in found(with_position(mv, plant(transmitters=NOISELESS)))


@pytest.mark.parametrize(("S", "J"), VALVES)
@pytest.mark.parametrize(("start_s", "stop_s"), [(1300.0, 1360.0), (900.0, 1900.0)])
def test_a_frozen_reading_is_left_out(S, J, start_s, stop_s):
    """Exact repeats of a noisy reading are frozen, from their second sample on, and no others."""
    measured = measured_record(plant(S, J, None, frozen(start_s, stop_s)))
    (effect,) = measured.effects
    assert "frozen_signal" == effect.slug
    assert stop_s - start_s - 1.0 == effect.parameters["frozen_s"]
    assert "check the transmitter" in effect.sentence
    inside = slice(int(start_s) + 1, int(stop_s))
    assert not measured.real[inside].any()
    assert np.count_nonzero(~measured.real) == stop_s - start_s - 1.0


def test_a_coarse_reading_freezes_where_the_command_moves_on():
    """A quantised reading is frozen where OP moves by more than friction ever held the stem."""
    coarse = Transmitters(position_noise=0.02, position_step=0.5)
    effects = found(plant(0.3, 0.0, coarse, frozen(900.0, 1900.0)))
    assert {"quantisation", "frozen_signal"} == set(effects)
    assert effects["frozen_signal"].parameters["frozen_s"] == pytest.approx(1000.0, abs=40.0)


@pytest.mark.parametrize("S", [4.0, 8.0])
def test_a_freeze_behind_an_archive_that_draws_lines(S):
    """A line as good as flat is frozen where OP moves by more than friction ever held the stem; the
    lines of a stem that sticks widely, and those of a stem at its stop, are not.
    """
    door = compressed(DOOR, 0.4)
    effects = found(plant(S, 1.5, None, replace(door, frozen=frozen(900.0, 1900.0).frozen)))
    assert {"historian_compression", "frozen_signal"} == set(effects)
    assert effects["frozen_signal"].parameters["frozen_s"] == pytest.approx(1000.0, abs=40.0)
    assert "frozen_signal" not in found(plant(S, 1.5, None, door))
    position = plant(S).mv.values
    stopped = np.minimum(position, np.percentile(position, 70.0))
    knots = np.flatnonzero(swinging_door(stopped, 0.4))
    at_a_stop = np.interp(np.arange(stopped.size), knots, stopped[knots])
    assert "frozen_signal" not in found(with_position(at_a_stop, plant(S)))


def test_a_frozen_position_is_masked_but_for_its_first_sample():
    """Nothing but the position's quality changes: the values of a frozen stretch are left out."""
    recording = plant()
    masked = without_frozen(recording, after_the_first([(100, 400), (900, 1000)], len(recording)))
    left_out = np.flatnonzero(~masked.mv.usable)
    assert np.array_equal(left_out, np.r_[101:400, 901:1000])
    assert np.array_equal(masked.mv.values[:101], recording.mv.values[:101])
    assert masked.op is recording.op
    assert without_frozen(recording, np.zeros(len(recording), dtype=bool)) is recording


def test_a_stuck_valve_is_not_frozen():
    """A stem that never moves under a noisy or a coarse reading is not called frozen."""
    n = plant().op.values.size
    noisy = 50.0 + 0.05 * np.random.default_rng(2).standard_normal(n)
    for mv in (noisy, np.round(noisy), np.full(n, 50.0)):
        assert "frozen_signal" not in found(with_position(mv))


@given(period=st.integers(2, 30), place=st.integers(0, 29), seed=st.integers(0, 2**16))
@settings(max_examples=30, deadline=None)
def test_a_slow_scan_is_measured(period, place, seed):
    """A signal that is refreshed every few samples gives period and phase."""
    place %= period
    rng = np.random.default_rng(seed)
    values = rng.standard_normal(3600)[(np.arange(3600) - place) // period]
    assert (period, place) == refresh_period(values)


def test_a_slowly_scanned_position_is_scored_where_it_is_fresh():
    """Of a position that is read every 5 s only the fresh readings are real."""
    mv = plant().signals[Role.MV].values
    measured = measured_record(with_position(mv[np.arange(mv.size) // 5 * 5]))
    (effect,) = measured.effects
    assert "sampling_jitter" == effect.slug
    assert {"spacing_s": 5.0} == effect.parameters
    assert "The values change only every 5 s" in effect.sentence
    assert 5.0 == measured.spacing_s
    assert measured.real.mean() == pytest.approx(0.2)


def test_a_controller_that_scans_slowly_is_no_record_effect():
    """OP that is held between scans is the true command."""
    base = plant()
    op = base.op.values[np.arange(len(base)) // 5 * 5]
    assert {} == found(replace(base, signals={**base.signals, Role.OP: Signal.good(op, "OP")}))


@pytest.mark.parametrize(
    ("op_s", "position_s", "text"),
    [
        (1, 1, ""),
        (5, 5, ""),
        (5, 1, "OP changes every 5 s, the position every 1 s: each has its own scan."),
        (2, 10, "OP changes every 2 s, the position every 10 s: each has its own scan."),
    ],
)
def test_the_scan_of_either_tag_is_said_where_they_differ(op_s, position_s, text):
    """In seconds of the plant, whatever the recording's own clock."""
    base, times = plant(), {Role.OP: op_s, Role.MV: position_s}
    samples = np.arange(len(base))
    signals = {
        role: Signal.good(base.signals[role].values[samples // scan_s * scan_s], role.value)
        for role, scan_s in times.items()
    }
    scanned = replace(base, signals={**base.signals, **signals})
    assert text == scan_sentence(scanned)
    fast = scan_sentence(on_own_clock(replace(scanned, interval_s=0.001)))
    assert re.sub(r"(\d) s", r"\1 ms", text) == fast


@given(period=st.integers(2, 30), stray=st.integers(0, 2), seed=st.integers(0, 2**16))
@settings(max_examples=30, deadline=None)
def test_a_scan_with_a_few_changes_off_it_is_still_measured(period, stray, seed):
    """One change in fifty may fall elsewhere, next to another or not."""
    rng = np.random.default_rng(seed)
    values = rng.standard_normal(7200)[np.arange(7200) // period]
    for index in rng.choice(np.arange(1, 7199), stray, replace=False):
        values[index] += 1.0
    assert period == refresh_period(values)[0]


def test_an_uneven_clock_is_said():
    """Time stamps that scatter by more than a tenth of the interval are named with their size."""
    recording = replace(plant(), clock=ClockFacts(jitter_s=0.4))
    (effect,) = measured_record(recording).effects
    assert ("sampling_jitter", {"jitter_s": 0.4}) == (effect.slug, effect.parameters)
    assert "scatter by 0.4 s about 1 s" in effect.sentence
    assert () == measured_record(replace(plant(), clock=ClockFacts(jitter_s=0.05))).effects


def test_missing_samples_are_left_out_without_a_record_effect():
    """Missing samples are left out without a word about the archive."""
    mv = plant().signals[Role.MV].values.copy()
    mv[500:600] = np.nan
    measured = measured_record(with_position(mv))
    assert () == measured.effects
    assert 100 == np.count_nonzero(~measured.real)


def test_without_a_position_nothing_is_real():
    """A recording of OP and PV alone has nothing to score, and its clock can still be said."""
    base = plant()
    signals = {role: s for role, s in base.signals.items() if role is not Role.MV}
    measured = measured_record(replace(base, signals=signals, clock=ClockFacts(jitter_s=0.5)))
    assert not measured.real.any()
    assert ["sampling_jitter"] == [effect.slug for effect in measured.effects]
