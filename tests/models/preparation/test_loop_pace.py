"""A recording that is much faster than its loop is thinned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stemwatch.models.preparation.loop_pace import at_loop_pace
from stemwatch.models.recording import Quality, Recording, Role, Signal
from stemwatch.models.screening.screen import Case, Options, screen
from stemwatch.models.studies.simulator import draw_sticky, simulate_loop

FITTED = 3600


def waves(period: int, samples: int = 36_000, interval_s: float = 0.1) -> Recording:
    """OP that turns every half ``period`` samples, and a stem that follows at once."""
    noise = np.random.default_rng(5).standard_normal(samples)
    op = 50.0 + 5.0 * np.sin(2.0 * np.pi * np.arange(samples) / period)
    signals = {
        Role.OP: Signal.good(op, "V.OP"),
        Role.MV: Signal.good(op + 0.05 * noise, "V.ZT"),
    }
    return Recording(valve="V", signals=signals, interval_s=interval_s)


@pytest.mark.parametrize(
    ("period", "samples", "every"),
    [
        (900, 36_000, 10),  # as many as leave what is fitted
        (900, 24_000, 5),
        (900, 1_800_000, 20),  # sixteen samples from turn to turn
        (900, 17_000, 1),  # not worth it
        (300, 36_000, 1),  # 24 turns in what is fitted are enough
        (900, 3600, 1),
    ],
)
def test_the_stride_follows_the_reversals_of_op(period: int, samples: int, every: int) -> None:
    """Never fewer than are fitted, nor than sixteen from one turn of OP to the next."""
    recording = waves(period, samples)
    read = at_loop_pace(recording, FITTED)
    assert read.interval_s == pytest.approx(0.1 * every)
    assert len(read) == -(-samples // every)
    np.testing.assert_array_equal(recording.op.values[::every], read.op.values)
    assert (read is recording) == (every == 1)


def held(period: int, samples: int = 36_000) -> Recording:
    """OP that its controller holds for so many samples, from the fourth sample on."""
    rng = np.random.default_rng(7)
    scans = 50.0 + np.cumsum(rng.normal(0.0, 0.4, samples // period + 2)) % 20.0
    op = np.repeat(scans, period)[period - 3 : period - 3 + samples]
    signals = {
        Role.OP: Signal.good(op, "V.OP"),
        Role.MV: Signal.good(op + 0.05 * rng.standard_normal(samples), "V.ZT"),
    }
    return Recording(valve="V", signals=signals, interval_s=0.1)


@pytest.mark.parametrize(
    ("period", "samples", "every"),
    [(5, 36_000, 5), (4, 36_000, 1), (20, 36_000, 20), (5, 7000, 1)],
)
def test_an_op_that_is_held_is_read_just_before_it_changes(
    period: int, samples: int, every: int
) -> None:
    """Where the controller scans more slowly than was recorded, and enough scans are left."""
    recording = held(period, samples)
    read = at_loop_pace(recording, FITTED)
    assert read.interval_s == pytest.approx(0.1 * every)
    if every > 1:
        changed = np.flatnonzero(np.diff(recording.op.values))
        assert np.isin(np.arange(2, samples, every)[1:-1], changed).mean() > 0.95
        np.testing.assert_array_equal(recording.op.values[2::every], read.op.values)
        assert "held" in read.provenance.decisions[-1]


@pytest.mark.parametrize(
    ("interval_s", "said"), [(0.001, "every 10 ms"), (0.1, "every 1 s"), (0.4, "every 4 s")]
)
def test_a_fast_clock_is_read_by_its_samples(interval_s: float, said: str) -> None:
    """How far apart they were does not matter, and it is said in true time."""
    read = at_loop_pace(waves(900, interval_s=interval_s), FITTED)
    assert read.interval_s == pytest.approx(10.0 * interval_s)
    assert said in read.provenance.decisions[-1]


@pytest.mark.parametrize("interval_s", [0.5, 1.0, 60.0])
def test_a_clock_of_seconds_stays_as_it_is(interval_s: float) -> None:
    """A lag of four seconds has four samples at 1 s, and is worth a name."""
    recording = waves(900, interval_s=interval_s)
    assert at_loop_pace(recording, FITTED) is recording


def test_the_plants_own_number_of_fitted_samples_is_used() -> None:
    """``fitted_samples`` of its own."""
    assert at_loop_pace(waves(4000), 6000).interval_s == pytest.approx(0.5)
    fitted_whole = waves(4000)
    assert at_loop_pace(fitted_whole, 20_000) is fitted_whole


def test_bad_samples_stay_bad_and_holes_stay_holes() -> None:
    """Quality goes along with its sample."""
    recording = waves(900)
    mv = recording.mv
    assert mv is not None
    quality = mv.quality.copy()
    quality[1000:3000] = Quality.BAD
    bad = replace(recording, signals={**recording.signals, Role.MV: replace(mv, quality=quality)})
    read = at_loop_pace(bad, FITTED)
    assert np.flatnonzero(~read.usable).tolist() == list(range(100, 300))


def test_without_a_position_in_percent_nothing_is_thinned() -> None:
    """A recording that is not fitted is not thinned."""
    recording = waves(900)
    assert recording.mv is not None
    alone = replace(recording, signals={Role.OP: recording.op})
    in_turns = {**recording.signals, Role.MV: replace(recording.mv, unit="rad")}
    for item in (alone, replace(recording, signals=in_turns)):
        assert at_loop_pace(item, FITTED) is item


@pytest.mark.parametrize("interval_s", [0.1, pytest.param(0.02, marks=pytest.mark.long)])
def test_S_and_J_are_as_good_at_ten_hertz_as_at_one(interval_s: float) -> None:
    """The same loop recorded ten and fifty times a second: S was 5.0 % at 10 Hz, and is 3.3."""
    loop = draw_sticky(3, 7171)[2]
    fast = replace(loop, duration_s=3600.0, archive=replace(loop.archive, interval_s=interval_s))
    recording = simulate_loop(fast, 7_171_002).recording
    (result,) = screen([Case(recording=recording)], Options(narx=False))
    for estimate, true in ((result.S, loop.valve.S), (result.J, loop.valve.J)):
        assert estimate.value == pytest.approx(true, abs=0.2)
        assert estimate.low <= true <= estimate.high
    assert result.recording is not None
    assert result.recording.interval_s == pytest.approx(1.0)
    assert result.mismatch is not None
    assert result.mismatch.effects == ()
