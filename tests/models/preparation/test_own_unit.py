"""A unit of a recording's own time is a sample, unless the valve takes dozens of them to answer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from stemwatch.models.preparation.own_clock import on_own_clock
from stemwatch.models.preparation.own_unit import samples_in_unit
from stemwatch.models.recording import Recording, Role, Signal


def drive(lag, *, samples=7200, held=200, gain=1.0, interval_s=0.01):
    """A command in steps, and a position that follows with a lag of so many samples, with noise."""
    rng = np.random.default_rng(3)
    op = np.repeat(rng.uniform(30.0, 70.0, samples // held), held)
    share = 1.0 - np.exp(-1.0 / lag)
    followed, _ = lfilter([share], [1.0, share - 1.0], op, zi=[(1.0 - share) * op[0]])
    mv = 50.0 + gain * (followed - 50.0) + 0.05 * rng.standard_normal(op.size)
    signals = {Role.OP: Signal.good(op, "V.OP"), Role.MV: Signal.good(mv, "V.ZT")}
    return Recording(valve="V", signals=signals, interval_s=interval_s)


@pytest.mark.parametrize("lag", [1.0, 4.0, 12.0])
def test_a_valve_that_answers_within_the_usual_reach_has_a_sample_for_a_unit(lag):
    """Nothing is gained by a coarser clock there."""
    assert 1 == samples_in_unit(drive(lag))


@pytest.mark.parametrize(("lag", "unit"), [(60.0, 4), (120.0, 16)])
@pytest.mark.parametrize("gain", [1.0, -1.0, 0.5])
def test_a_drive_that_takes_many_samples_has_a_coarser_clock(lag, unit, gain):
    """Whatever the span and the sense of its position."""
    assert unit == samples_in_unit(drive(lag, gain=gain))


@pytest.mark.parametrize("interval_s", [0.001, 1.0, 60.0])
def test_the_time_unit_does_not_matter(interval_s):
    """How far apart they were does not matter."""
    own = on_own_clock(drive(120.0, interval_s=interval_s))
    assert own.unit_s == pytest.approx(16 * interval_s)
    assert own.interval_s == pytest.approx(1 / 16)


def test_a_recording_keeps_three_hundred_units():
    """A short one is not made shorter."""
    assert 4 == samples_in_unit(drive(120.0).part(0, 2400))
    assert 1 == samples_in_unit(drive(120.0).part(0, 1000))


def test_a_recording_in_short_pieces_shows_no_move_that_is_slow():
    """Sixty samples of each piece count, and no move over sixty begins and ends in these."""
    whole = drive(120.0)
    in_hole = np.arange(len(whole)) % 820 >= 780
    signals = {
        role: replace(signal, values=np.where(in_hole, np.nan, signal.values))
        for role, signal in whole.signals.items()
    }
    assert 1 == samples_in_unit(replace(whole, signals=signals))


def test_without_a_position_a_unit_is_a_sample():
    """There is nothing that answers."""
    recording = drive(120.0)
    alone = replace(recording, signals={Role.OP: recording.op})
    assert 1 == samples_in_unit(alone)
