"""Peaks that an archive did not keep: S and J corrected, or a reason where they cannot be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.measurement.between_samples import (
    Archive,
    ArchiveKind,
    as_sampled,
    find_archive,
)
from stemwatch.models.preparation.own_clock import on_own_clock
from stemwatch.models.recording import PERCENT, Floats, Recording, Role, Signal
from stemwatch.models.screening.screen import Case, Options, screen
from stemwatch.models.screening_result import Screening
from stemwatch.models.stickslip import parameters as coordinate
from stemwatch.models.stickslip.advantage import Advantage
from stemwatch.models.stickslip.fit import fit_stickslip
from stemwatch.models.stickslip.slip_levels import SlipLevels
from stemwatch.models.studies.simulator import draw_sticky, simulate_loop
from stemwatch.models.studies.simulator.historian import swinging_door
from stemwatch.models.verdict import Verdict

S, J = 6.0, 3.0


def recorded(op: Floats, mv: Floats, interval_s: float) -> Recording:
    signals = {Role.OP: Signal.good(op, "V.OP"), Role.MV: Signal.good(mv, "V.MV")}
    return Recording(valve="V", signals=signals, interval_s=interval_s)


def cycling(period: int, *, hours: float = 2.0, width: float = S, seed: int = 1) -> Recording:
    """A loop that cycles on a sticking stem about every ``period`` s, kept every second: OP runs up
    and down at a speed that changes from leg to leg, and turns as the stem slips."""
    rng = np.random.default_rng(seed)
    n = round(3600 * hours)
    op, mv = np.empty(n), np.empty(n)
    x, here, way = 50.0, 50.0, 1.0
    jump = J * width / S
    # Peaks lie between two samples of any clock: ten steps a second.
    speed = (width + jump) / (period / 2) / 10
    pace = speed
    for k in range(10 * n):
        if k % 10 == 0:
            op[k // 10], mv[k // 10] = here, x
        here += way * pace
        if way * (here - x) > (width + jump) / 2:
            x, way = here - way * (width - jump) / 2, -way
            pace = speed * rng.uniform(0.7, 1.4)
    return recorded(op, mv + 0.03 * rng.standard_normal(n), 1.0)


def kept(recording: Recording, every: int, *, mean: bool = False) -> Recording:
    def less(values: Floats) -> Floats:
        complete = values[: values.size // every * every].reshape(-1, every)
        return np.asarray(complete.mean(axis=1) if mean else complete[:, 0])

    mv = recording.mv
    assert mv is not None
    return recorded(less(recording.op.values), less(mv.values), every * recording.interval_s)


def reported(values: Floats, deviation: float) -> Floats:
    held, last = values.copy(), values[0]
    for index, value in enumerate(values):
        last = value if abs(value - last) > deviation else last
        held[index] = last
    return held


def screened(recording: Recording) -> Screening:
    (result,) = screen([Case(recording=recording)], Options(narx=False, mismatch=False))
    return result


@pytest.mark.parametrize(
    ("every", "mean"),
    [
        (5, False),
        (10, True),
        pytest.param(5, True, marks=pytest.mark.long),
        pytest.param(10, False, marks=pytest.mark.long),
    ],
)
def test_peaks_between_samples_are_restored(every: int, mean: bool) -> None:
    """Snapshots and averages of a cycling loop: S is read from the slips, within 5 %, with its
    truth inside; where the slips could not tell it, the free run's is within 12 %."""
    slow = kept(cycling(16 * every), every, mean=mean)
    own = on_own_clock(slow)
    plain, archive = as_sampled(fit_stickslip(own), own)
    assert archive is not None
    assert archive.kind is (ArchiveKind.AVERAGES if mean else ArchiveKind.SNAPSHOTS)
    assert archive.levels is not None
    result = screened(slow)
    assert result.S.value == pytest.approx(archive.levels.S)
    assert result.J.value == pytest.approx(archive.levels.J)
    assert abs(result.S.value - S) < 0.05 * S
    without = replace(archive, levels=None)
    missed = without.missed_by(plain.evaluator.problem, plain.evaluator.simulate(plain.candidate))
    fitted = [Estimate(value=v, low=v, high=v, unit=PERCENT) for v in (plain.S, plain.J)]
    restored = without.restored(fitted[0], fitted[1], missed)
    assert restored[0].value == pytest.approx(plain.S + missed)
    assert restored[1].value == pytest.approx(plain.J + missed)
    assert abs(plain.S + missed - S) < 0.12 * S
    assert result.S.low is not None
    assert result.S.high is not None
    assert result.S.low <= S <= result.S.high
    assert any("are read from" in decision for decision in result.provenance.decisions)
    assert "are restored by" in without.sentence(missed)


@pytest.mark.long
def test_a_recording_that_keeps_the_peaks_is_not_corrected() -> None:
    """A sample every second of a loop that takes 50 s: the fit's own numbers, to the bit."""
    plain = cycling(50)
    assert find_archive(plain) is None
    fit, result = fit_stickslip(plain), screened(plain)
    assert result.S.value == fit.S
    assert result.J.value == fit.J


def test_too_slow_sampling_gives_a_bound_and_a_sufficient_interval() -> None:
    """OP turns at every sample: S is at least its low end, J is unknown, and 5 s is advised."""
    archive = Archive(ArchiveKind.SNAPSHOTS, per_turn=1.0, deviation=0.0, interval_s=30.0)
    assert archive.too_slow
    assert archive.sufficient_interval_s == 5.0
    numbers = [Estimate(value=v, low=v - 0.5, high=v + 0.5, unit=PERCENT) for v in (4.0, 1.0)]
    width, jump = archive.restored(numbers[0], numbers[1], 2.0)
    assert width.value is None
    assert width.at_least == 3.5
    assert "a sample every 5 s would do" in str(width)
    assert str(width).startswith("at least 3.50 %: ")
    assert jump.value is None
    assert jump.at_least is None
    assert "too slow" in archive.sentence(2.0)


def test_a_small_S_is_not_believed_where_the_stem_is_seen_far_from_its_command() -> None:
    """A loop that hunts between its samples may leave a fit no friction to speak of: then S is a
    bound. Where the stem stays near its command there is nothing to doubt."""
    quick = on_own_clock(kept(cycling(22, hours=4.0), 60))
    fitted = fit_stickslip(quick)
    almost_none = fitted.naive.copy()
    almost_none[[coordinate.S_PERCENT, coordinate.RATIO]] = 0.5, 0.1
    blind = replace(
        fitted,
        hypothesis="sticking",
        candidate=almost_none,
        of_sticking=Advantage(0.1, 1.0),
        breakaways=None,
    )
    _, archive = as_sampled(blind, quick)
    assert archive is not None
    assert archive.too_slow
    S_bound, _ = archive.restored(
        Estimate(value=0.5, low=0.3, high=0.7, unit=PERCENT),
        Estimate(value=0.05, low=0.0, high=0.2, unit=PERCENT),
        archive.missed_by(blind.evaluator.problem, blind.evaluator.simulate(almost_none)),
    )
    assert S_bound.value is None
    assert S_bound.low == pytest.approx(0.3)
    follows = replace(quick, signals={**quick.signals, Role.MV: near(quick.op.values)})
    assert as_sampled(blind, follows)[1] is None


def near(op: Floats) -> Signal:
    """A position that follows ``op`` within its noise."""
    return Signal.good(op + 0.05 * np.random.default_rng(2).standard_normal(op.size), "V.MV")


def test_averages_are_known_by_slips_that_the_command_did_not_drag() -> None:
    """A dead band without a jump has values on its way too; then it may be either kind, and what
    averages would lack is half added and wholly open."""
    own = on_own_clock(kept(cycling(160), 10, mean=True))
    sure = find_archive(own)
    assert sure is not None
    assert sure.kind is ArchiveKind.AVERAGES
    assert not sure.kind_open
    open_kind = replace(sure, kind_open=True, levels=None, per_turn=2.0)
    fitted = Estimate(value=4.0, low=3.7, high=4.3, unit=PERCENT)
    (wide, _), (narrow, _) = (
        archive.restored(fitted, fitted, 1.0)
        for archive in (open_kind, replace(open_kind, kind_open=False))
    )
    assert wide.low < narrow.low
    assert wide.high > narrow.high


def test_reports_by_exception_hide_what_is_smaller() -> None:
    """A stem that follows seems to stick by the deviation, and the sentence says so."""
    rng = np.random.default_rng(3)
    op = 50.0 + np.cumsum(np.convolve(rng.normal(0.0, 0.3, 3600), np.ones(20) / 20, "same"))
    op = op - np.linspace(0.0, op[-1] - op[0], op.size)
    mv = op + 0.02 * rng.standard_normal(op.size)
    assert screened(recorded(op, mv, 1.0)).verdict is Verdict.HEALTHY
    result = screened(recorded(reported(op, 1.0), reported(mv, 1.0), 1.0))
    assert result.verdict is Verdict.UNDETERMINED
    assert "reports by exception to 1 %" in result.reason


def test_reports_by_exception_widen_the_intervals() -> None:
    """Reports of 0.5 %: both intervals hold the truth."""
    plain = cycling(40)
    assert plain.mv is not None
    held = recorded(reported(plain.op.values, 0.5), reported(plain.mv.values, 0.5), 1.0)
    archive = find_archive(held)
    assert archive is not None
    assert archive.kind is ArchiveKind.REPORTS
    assert archive.deviation == pytest.approx(0.5, abs=0.05)
    result = screened(held)
    for estimate, truth in ((result.S, S), (result.J, J)):
        assert estimate.low is not None
        assert estimate.high is not None
        assert estimate.low <= truth <= estimate.high


@pytest.mark.parametrize(("S", "holds_none_missed"), [(2.1, True), (2.9, True), (3.1, False)])
def test_an_S_of_some_deviations_may_be_that_of_the_reports(
    S: float, holds_none_missed: bool
) -> None:
    """Up to three deviations the low end is that of S as fitted: a valve that follows its reports
    may show two, and must not be called sticky because of the correction.
    """
    archive = Archive(ArchiveKind.REPORTS, per_turn=np.inf, deviation=1.0, interval_s=1.0)
    fitted = Estimate(value=S, low=S - 0.2, high=S + 0.2, unit=PERCENT)
    restored, _ = archive.restored(fitted, fitted, 0.0)
    assert restored.value == pytest.approx(S + 0.75)
    assert restored.low is not None
    assert restored.high is not None
    error = float(np.hypot(0.2, 0.98))
    assert restored.high == pytest.approx(S + 0.75 + error)
    assert restored.low == pytest.approx(S - error + (0.0 if holds_none_missed else 0.75))


@pytest.mark.parametrize(
    ("S", "door", "verdict"),
    [(6.0, 0.3, Verdict.STICKY), (0.0, 0.3, Verdict.HEALTHY), (6.0, 5.0, Verdict.UNDETERMINED)],
)
def test_lines_leave_S_open_by_their_deviation(S: float, door: float, verdict: Verdict) -> None:
    """A stem that plainly sticks more than the door hides, or less than matters, gets its verdict;
    else the reason says what the archive keeps. No interval misses the truth."""
    plain = cycling(40, width=S or 6.0)
    assert plain.mv is not None
    if not S:
        noise = 0.05 * np.random.default_rng(1).standard_normal(len(plain))
        plain = recorded(plain.op.values, plain.op.values + noise, 1.0)
    lines = {
        role: replace(signal, values=drawn(signal.values, min(door, 1.0)), deviation=door)
        for role, signal in plain.signals.items()
    }
    recording = replace(plain, signals=lines)
    archive = find_archive(recording)
    assert archive is not None
    assert (archive.kind, archive.deviation) == (ArchiveKind.LINES, door)
    result = screened(recording)
    assert result.verdict is verdict
    if verdict is Verdict.UNDETERMINED:
        assert f"to {door:.2g} %; exported with a deviation of 0.05 %" in result.reason
    else:
        assert result.S.low is not None
        assert result.S.high is not None
        assert result.S.low <= S <= result.S.high


def drawn(values: Floats, deviation: float) -> Floats:
    """Lines between the samples that a swinging door keeps."""
    stored = np.flatnonzero(swinging_door(values, deviation))
    return np.asarray(np.interp(np.arange(values.size), stored, values[stored]))


widths = st.floats(0.0, 20.0)


@settings(max_examples=60, deadline=None)
@given(widths, widths, widths, st.floats(1.0, 8.0), st.sampled_from([0.0, 0.5]))
@example(0.0, 0.0, 0.0, 1.0, 0.0)
def test_restored_numbers_stay_in_their_intervals(
    width: float, jump: float, missed: float, per_turn: float, deviation: float
) -> None:
    """The correction never lowers a number, and never puts one outside of its interval."""
    archive = Archive(
        ArchiveKind.REPORTS if deviation else ArchiveKind.SNAPSHOTS, per_turn, deviation, 10.0
    )
    numbers = [
        Estimate(value=v, low=max(v - 0.3, 0.0), high=v + 0.3, unit=PERCENT) for v in (width, jump)
    ]
    for before, after in zip(
        numbers, archive.restored(numbers[0], numbers[1], missed), strict=True
    ):
        if after.value is None:
            assert archive.too_slow
            continue
        assert before.value is not None
        assert after.low is not None
        assert after.high is not None
        assert before.value <= after.value
        assert 0.0 <= after.low <= after.value <= after.high


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 5), st.floats(0.001, 60.0))
def test_the_archive_found_does_not_depend_on_the_time_unit(seed: int, factor: float) -> None:
    """The same samples on another clock: the same kind of archive, as many samples to a turn."""
    slow = kept(cycling(50, hours=0.5, seed=seed), 5)
    assert slow.mv is not None
    other = recorded(slow.op.values, slow.mv.values, factor * slow.interval_s)
    result, repeated = find_archive(slow), find_archive(other)
    assert result is not None
    assert repeated is not None
    assert (result.kind, result.per_turn) == (repeated.kind, repeated.per_turn)


def levels_of_slips(bounds: float) -> SlipLevels:
    """An S of 4.8 and a J of 1.2 %, where OP goes ``bounds`` in the sample of a slip."""
    return SlipLevels(
        12,
        level=3.0,
        level_error=0.1,
        kinetic=1.8,
        kinetic_error=0.1,
        common=0.1,
        apart=0.1,
        bounds=bounds,
        per_sample=bounds,
    )


def test_a_jump_smaller_than_op_goes_in_a_sample_may_be_none() -> None:
    """A stem that slides on with its command is seen at the same places. Its S is then twice the
    sliding level of 1.8 %, and not the sum of both levels, 4.8 %."""
    fitted = Estimate(value=4.0, low=3.7, high=4.3, unit=PERCENT)
    for bounds, may_be_none in ((0.5, False), (1.3, True)):
        archive = Archive(ArchiveKind.SNAPSHOTS, 5.0, 0.0, 5.0, levels=levels_of_slips(bounds))
        S, J = archive.restored(fitted, fitted, 0.0)
        assert (J.low == 0.0) == may_be_none
        assert (S.low < 3.6) == may_be_none
        assert S.value == pytest.approx(4.8)


def test_an_interval_that_ended_at_zero_is_no_surer_below_when_it_is_moved() -> None:
    """What ended it was that J is not negative, and not what the record says."""
    archive = Archive(ArchiveKind.SNAPSHOTS, 3.0, 0.0, 5.0)
    S = Estimate(value=4.0, low=3.8, high=4.2, unit=PERCENT)
    J = Estimate(value=0.1, low=0.0, high=0.7, unit=PERCENT)
    _, moved = archive.restored(S, J, 1.0)
    assert moved.low is not None
    assert moved.high is not None
    assert moved.value == pytest.approx(1.1)
    assert moved.value - moved.low == pytest.approx(moved.high - moved.value)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_jump_of_averages_is_read_from_the_slips(seed: int) -> None:
    """A loop that keeps its peaks, at ten averages from turn to turn: a free run has no sample
    between the old and the new place of a slip, and only the slips tell J. Where the fit takes the
    smear for a lag (the third), the interval holds both."""
    result = screened(kept(cycling(300, hours=4.0, width=2.0, seed=seed), 10, mean=True))
    said = " ".join(result.provenance.decisions)
    assert ("the intervals hold both" if seed == 3 else "are read from") in said
    assert result.J.value == pytest.approx(1.0, rel=0.15)
    assert result.J.low is not None
    assert result.J.high is not None
    assert result.J.low <= 1.0 <= result.J.high


def test_where_slips_contradict_the_fit_of_a_slower_loop_the_intervals_hold_both() -> None:
    """The value stays the fit's, as a stem that answers a sample late looks the same."""
    levels = levels_of_slips(bounds=0.5)
    archive = Archive(ArchiveKind.SNAPSHOTS, 15.0, 0.0, 5.0, levels=levels, doubted=True)
    fitted = Estimate(value=4.0, low=3.7, high=4.3, unit=PERCENT)
    S, J = archive.restored(fitted, replace(fitted, value=1.5, low=1.4, high=1.6), 0.0)
    assert (S.value, S.low, J.value) == (4.0, 3.7, 1.5)
    assert S.high is not None
    assert S.high > levels.S
    assert J.low is not None
    assert J.low < levels.J < 1.4
    assert "12 slips" in archive.sentence(0.0)
    assert "the intervals hold both" in archive.sentence(0.0)


@pytest.mark.long
@pytest.mark.parametrize("place", [1, 10, 18])
def test_a_valve_kept_every_second_keeps_the_numbers_of_its_fit(place: int) -> None:
    """Its slips are seen a sample late, which would make S larger by a tenth or more."""
    simulated = simulate_loop(draw_sticky(24, 5)[place], 5 + place)
    (result,) = screen([Case(recording=simulated.recording)], Options(narx=False, mismatch=False))
    assert not any("slips" in sentence for sentence in result.provenance.decisions)
    assert result.S.low is not None
    assert result.S.high is not None
    assert result.S.low <= simulated.truth.S <= result.S.high
