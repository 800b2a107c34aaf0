"""The stretch of a long recording with the most movement, and its use in a screening."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stemwatch.models.limits import Limits
from stemwatch.models.preparation.fit_window import (
    choose_fit_window,
    on_whole_clock,
    window_sentence,
)
from stemwatch.models.recording import Recording, Role, Signal
from stemwatch.models.screening.screen import Case, Options, screen
from stemwatch.models.studies.simulator import draw_sticky, simulate_loop

START = datetime(2026, 3, 2, tzinfo=UTC)
SAMPLES = 1200


def recording_of(op: np.ndarray, mv: np.ndarray | None = None) -> Recording:
    """OP and MV at 1 s; MV is OP where none is given."""
    signals = {
        Role.OP: Signal.good(op, "FV.op"),
        Role.MV: Signal.good(op if mv is None else mv, "FV.mv"),
    }
    return Recording(valve="FV", signals=signals, interval_s=1.0, start=START)


def waves(first: int, last: int, samples: int = 12_000) -> np.ndarray:
    """OP that rests at 50 % but for a wave of 100 s between two samples."""
    time = np.arange(samples)
    return 50.0 + np.where((time >= first) & (time < last), 5.0 * np.sin(time / 16.0), 0.0)


@settings(deadline=None)
@given(first=st.integers(0, 10_000))
def test_it_lies_where_op_moves(first: int) -> None:
    """Of a record that moves in one place only, the stretch covers most of that place."""
    window = choose_fit_window(recording_of(waves(first, first + SAMPLES)), SAMPLES)
    assert window is not None
    assert window.length == SAMPLES
    inside = min(window.last, first + SAMPLES) - max(window.first, first)
    assert inside >= 0.7 * SAMPLES
    assert window.turns >= 10


@pytest.mark.parametrize("samples", [SAMPLES, 2 * SAMPLES])
def test_a_record_of_up_to_twice_its_length_is_fitted_whole(samples: int) -> None:
    """A choice is made only where there is more than twice as much to choose from."""
    assert choose_fit_window(recording_of(waves(0, samples, samples)), SAMPLES) is None
    assert choose_fit_window(recording_of(waves(0, samples, 2 * samples + 1)), samples) is not None


def test_the_choice_does_not_depend_on_the_position() -> None:
    """The stretch does not depend on MV, because a choice by the result would be biased."""
    op = waves(3000, 9000)
    noise = np.random.default_rng(1).standard_normal(op.size)
    assert choose_fit_window(recording_of(op), SAMPLES) == choose_fit_window(
        recording_of(op, op + 5.0 * noise), SAMPLES
    )


def test_a_stretch_without_position_is_worth_nothing() -> None:
    """Where MV has a hole, the wave elsewhere is taken."""
    op = waves(1000, 3000) + waves(8000, 10_000) - 50.0
    mv = op.copy()
    mv[:5000] = np.nan
    window = choose_fit_window(recording_of(op, mv), SAMPLES)
    assert window is not None
    assert window.first >= 7000


def test_the_sentence_gives_times_share_and_rule() -> None:
    """The sentence has the times, the share and the rule."""
    record = recording_of(waves(3600, 4800))
    window = choose_fit_window(record, SAMPLES)
    assert window is not None
    text = window_sentence(window, record)
    assert "10% of the record" in text
    assert "2026-03-02 0" in text
    assert f"turning round {window.turns} times" in text
    undated = window_sentence(window, replace(record, start=None))
    assert f"samples {window.first + 1} to {window.last}" in undated


def test_a_trace_is_put_back_on_the_whole_clock() -> None:
    """On the whole clock a trace stands where it was, and nothing stands elsewhere."""
    complete = on_whole_clock(np.arange(3.0), 4, 9)
    assert complete[4:7].tolist() == [0.0, 1.0, 2.0]
    assert np.isnan(np.delete(complete, [4, 5, 6])).all()


@pytest.mark.long
def test_a_long_record_is_judged_by_its_stretch() -> None:
    """S is found within its interval, the traces stand on the whole clock, the indicators speak of
    the whole record, and the result says what was fitted."""
    loop = replace(draw_sticky(2, 5)[1], duration_s=4000.0)
    simulated = simulate_loop(loop, 3)
    limits = Limits(fitted_samples=1500.0)
    (result,) = screen([Case(recording=simulated.recording)], Options(limits=limits))
    assert result.S.low <= simulated.truth.S * 1.15
    assert result.S.high >= simulated.truth.S * 0.85
    assert "where OP works the valve most" in result.provenance.decisions[-1]
    for trace in (result.traces.stiction, result.traces.narx, result.mismatch.runs.naive):
        assert trace.size == len(simulated.recording)
        assert 0 < np.isfinite(trace).sum() <= 1500
    first = int(np.flatnonzero(np.isfinite(result.traces.stiction))[0])
    assert first < result.traces.heldout_from < first + 1500
    (complete,) = screen(
        [Case(recording=simulated.recording)],
        Options(narx=False, mismatch=False, limits=Limits(fitted_samples=1e9)),
    )
    name = "op_reversals"
    assert result.indicators[name] == complete.indicators[name]
    slips = "slip_count"
    assert result.indicators[slips].value == pytest.approx(
        complete.indicators[slips].value, rel=0.2
    )
    assert result.window == complete.window


def test_where_no_stretch_carries_a_verdict_the_whole_does() -> None:
    """A record whose few reversals lie far apart is fitted whole."""
    time = np.arange(9000)
    op = 50.0 + 8.0 * np.sign(np.sin(time / 9000 * 2 * np.pi * 3.3))
    mv = op + 0.02 * np.random.default_rng(2).standard_normal(op.size)
    limits = Limits(fitted_samples=300.0)
    (result,) = screen(
        [Case(recording=recording_of(op, mv))], Options(narx=False, mismatch=False, limits=limits)
    )
    assert np.isfinite(result.traces.stiction).sum() > 4 * 300


def test_too_short_a_stretch_is_refused() -> None:
    """What is fitted must hold at least what a verdict needs."""
    with pytest.raises(ValueError, match="expected fitted_samples of at least min_samples"):
        Limits(fitted_samples=100.0)
