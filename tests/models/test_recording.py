"""The types that hold one valve's signals."""

from __future__ import annotations

import pickle
from datetime import UTC, datetime, timedelta, timezone

import numpy as np
import pytest

from stemwatch.models.recording import Quality, Recording, Role, Signal, kept

START = datetime(2026, 3, 1, 12, 0, tzinfo=UTC)


def recorded(n=100, interval_s=2.0, start=START, **more) -> Recording:
    signals = {Role.OP: Signal.good(np.arange(float(n)), "V.OP")}
    signals |= {Role(role): signal for role, signal in more.items()}
    return Recording(valve="V", signals=signals, interval_s=interval_s, start=start)


def test_bad_samples_hold_no_number():
    """Whatever a bad sample's value was, it is NaN; good and held ones keep theirs."""
    codes = np.array([Quality.GOOD, Quality.HELD, Quality.BAD, Quality.CODE, Quality.RANGE])
    signal = Signal(values=np.arange(5.0), quality=codes, tag="T")
    np.testing.assert_array_equal(signal.values, [0.0, 1.0, np.nan, np.nan, np.nan])
    assert [True, False, False, False, False] == signal.usable.tolist()


def test_good_marks_nan_as_missing():
    """``Signal.good`` believes every finite sample and calls the others missing."""
    signal = Signal.good(np.array([1.0, np.nan, np.inf]), "T")
    assert [Quality.GOOD, Quality.MISSING, Quality.MISSING] == signal.quality.tolist()
    np.testing.assert_array_equal(signal.values, [1.0, np.nan, np.nan])


def test_samples_cannot_be_changed():
    """A signal's arrays are read-only, and independent of the caller's."""
    values = np.arange(3.0)
    signal = Signal.good(values, "T")
    values[0] = 9.0
    assert 0.0 == signal.values[0]
    with pytest.raises(ValueError, match="read-only"):
        signal.values[0] = 1.0


def test_unequal_arrays_are_refused():
    """Values and quality of different lengths are refused with the tag and both shapes."""
    with pytest.raises(ValueError, match=r"T: .*equally long; received shapes \(3,\) and \(2,\)"):
        Signal(values=np.zeros(3), quality=np.zeros(2, dtype=np.uint8), tag="T")


def test_a_recording_needs_op():
    """Without OP there is no recording."""
    mv = Signal.good(np.zeros(3), "V.ZT")
    with pytest.raises(ValueError, match=r"FV-1: .*controller output \(OP\)"):
        Recording(valve="FV-1", signals={Role.MV: mv}, interval_s=1.0)


def test_signals_of_one_length():
    """Signals of different lengths are refused, naming each length."""
    with pytest.raises(ValueError, match=r"one length expected.*'op': 100.*'mv': 3"):
        recorded(mv=Signal.good(np.zeros(3), "V.ZT"))


@pytest.mark.parametrize("interval_s", [0.0, -1.0, np.nan, np.inf])
def test_interval_must_be_positive(interval_s):
    """An interval that is no positive number is refused."""
    with pytest.raises(ValueError, match="interval_s must be positive"):
        recorded(interval_s=interval_s)


def test_start_must_know_its_zone():
    """A naive start is refused, an aware one becomes UTC."""
    with pytest.raises(ValueError, match="timezone aware"):
        recorded(start=datetime(2026, 3, 1))
    berlin = timezone(timedelta(hours=1))
    assert START == recorded(start=START.astimezone(berlin)).start
    assert UTC == recorded(start=START.astimezone(berlin)).start.tzinfo


def test_times_and_end():
    """Sample times follow the interval, and the end lies one interval after the last sample."""
    recording = recorded(n=10, interval_s=0.5)
    assert 5.0 == recording.duration_s
    assert 4.5 == recording.time_s[-1]
    assert START + timedelta(seconds=5) == recording.end
    assert recorded(start=None).end is None


def test_usable_needs_both():
    """A pair is usable where OP and MV both are; without MV, where OP is."""
    mv = np.ones(100)
    mv[7] = np.nan
    assert 99 == recorded(mv=Signal.good(mv, "V.ZT")).usable.sum()
    assert 100 == recorded().usable.sum()


def test_usable_flags_are_computed_once_and_read_only():
    """Readers get the same read-only flags; a recording with other samples gets its own."""
    mv = np.ones(100)
    mv[7] = np.nan
    recording = recorded(mv=Signal.good(mv, "V.ZT"))
    assert recording.usable is recording.usable
    with pytest.raises(ValueError, match="read-only"):
        recording.usable[7] = True
    assert 9 == recording.part(0, 10).usable.sum()


def test_cached_properties_are_not_pickled():
    """A signal that was asked what is usable is pickled as one that was not."""
    requested, unasked = (Signal.good(np.arange(100.0), "T") for _ in range(2))
    assert requested.usable.all()
    assert len(pickle.dumps(requested)) == len(pickle.dumps(unasked))
    assert pickle.loads(pickle.dumps(requested)).usable.all()


def test_part_shifts_the_start():
    """A part holds its samples and starts when its first sample did."""
    mv = Signal.good(np.arange(100.0) * 2.0, "V.ZT")
    part = recorded(mv=mv).part(10, 30)
    assert 20 == len(part)
    assert 10.0 == part.op.values[0]
    assert 20.0 == part.signals[Role.MV].values[0]
    assert START + timedelta(seconds=20) == part.start
    assert recorded(start=None).part(10, 30).start is None


def test_survives_a_trip_to_another_process():
    """A pickled recording comes back with the same samples and facts, still read-only."""
    recording = recorded(mv=Signal.good(np.arange(100.0), "V.ZT"))
    back = pickle.loads(pickle.dumps(recording))
    assert (back.valve, back.start, back.interval_s) == ("V", START, 2.0)
    assert set(recording.signals) == set(back.signals)
    np.testing.assert_array_equal(back.op.values, recording.op.values)
    assert not back.op.values.flags.writeable or back.op.values is not recording.op.values
    with pytest.raises(TypeError):
        back.signals[Role.PV] = recording.op


def test_what_is_kept_of_a_recording_belongs_to_it_alone():
    """It is computed once; a part, and a copy that has travelled, compute their own."""
    asked = []

    @kept
    def last_value(recording):
        asked.append(len(recording))
        return float(recording.op.values[-1])

    whole = recorded()
    assert [99.0, 99.0] == [last_value(whole), last_value(whole)]
    assert last_value(whole.part(0, 10)) == 9.0
    assert last_value(pickle.loads(pickle.dumps(whole))) == 99.0
    assert asked == [100, 10, 100]
