"""Friction on a slow archive, and the slow actuator that it looks like."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import stemwatch
from stemwatch.models.decision.shaken_loose import (
    S_averaged,
    S_unseen,
    dead_bands_of,
    is_sure,
    may_be_shaken,
    without_slow_actuator,
)
from stemwatch.models.recording import Floats, Recording, Role
from stemwatch.models.screening.screen import Case, Options, screen
from stemwatch.models.signals.dead_band import DeadBand
from stemwatch.models.stickslip import parameters as coordinate
from stemwatch.models.stickslip.fit import StickSlipFit, fit_stickslip
from stemwatch.models.verdict import NoVerdict, Verdict

EVERY = 10  # seconds that the archive keeps a sample of
SURE = DeadBand(percent=2.0, gain=0.6, inside=0.1, t=5.0)


def noisy_command() -> Floats:
    """Percent each second for six hours: a slow wander with a controller's noise of 0.6 % on it."""
    rng = np.random.default_rng(4090)
    slow = np.empty(6 * 3600)
    level = 0.0
    for k in range(slow.size):
        level += -level / 200.0 + 0.25 * rng.standard_normal()
        slow[k] = level
    return 50.0 + 1.5 * slow + 0.6 * rng.standard_normal(slow.size)


@pytest.fixture(scope="module")
def shaken() -> Recording:
    """A stem with an S of 4 % that jumps nowhere; noise of OP moves it each few seconds."""
    op = noisy_command()
    stem, mv = op[0], np.empty_like(op)
    for k, now in enumerate(op):
        stem = min(max(stem, now - 2.0), now + 2.0)
        mv[k] = stem
    mv += 0.05 * np.random.default_rng(7).standard_normal(op.size)
    return stemwatch.read(op=op[::EVERY], mv=mv[::EVERY], interval_s=float(EVERY), valve="FIC-1")


@pytest.fixture(scope="module")
def fit(shaken: Recording) -> StickSlipFit:
    return fit_stickslip(shaken)


def with_lag(fit: StickSlipFit, seconds: float) -> StickSlipFit:
    """``fit`` with friction behind a lag of so many true seconds."""
    candidate = fit.candidate.copy()
    lag = seconds / fit.evaluator.problem.unit_s
    candidate[[coordinate.LAG_UP_S, coordinate.LAG_DOWN_S]] = lag
    return replace(fit, hypothesis="both", candidate=candidate)


def test_a_sticking_stem_that_is_shaken_loose_is_no_slow_actuator(shaken):
    """It was *watch* with an S of 1.0 % behind a lag of many seconds."""
    (found,) = screen([Case(recording=shaken)], Options(narx=False))
    assert found.no_verdict is NoVerdict.SLOW_ACTUATOR
    assert found.S.value is None
    assert found.mismatch is not None
    assert found.mismatch.effects == ()


@pytest.mark.parametrize(
    ("band", "sure"),
    [
        (SURE, True),
        (replace(SURE, t=2.4), False),
        (replace(SURE, inside=0.25), False),
        (replace(SURE, inside=-0.25), False),
    ],
)
def test_a_band_is_sure_where_the_stem_follows_outside_alone(band, sure):
    """It must be likely, and the stem must follow beyond it far closer than within."""
    assert is_sure((band,)) is sure
    assert not is_sure(())


def test_only_what_is_slower_than_built_gives_way_to_a_dead_band(fit):
    """Beside a sure band a lag of 12 s goes and one of 5 s stays; without a band both stay."""
    slow, usual = with_lag(fit, 12.0), with_lag(fit, 5.0)
    alone = without_slow_actuator(slow, (SURE,))
    assert alone.hypothesis == "sticking"
    np.testing.assert_array_equal(alone.candidate, fit.naive)
    assert without_slow_actuator(usual, (SURE,)) is usual
    assert without_slow_actuator(slow, ()) is slow


def test_noise_must_be_able_to_shake_the_stem_loose(fit):
    """Six standard deviations of OP's scatter of 0.6 % reach half of an S of 5 %, and not of 20 %;
    a band that is likely leaves the doubt all the same."""
    slow = with_lag(fit, 12.0)
    assert may_be_shaken(slow, None, (), 5.0)
    assert not may_be_shaken(slow, None, (), 20.0)
    assert may_be_shaken(slow, None, (SURE,), 20.0)
    assert not may_be_shaken(with_lag(fit, 5.0), None, (SURE,), 5.0)


def test_a_quick_archive_is_left_to_the_fits(fit):
    """With a sample every second nothing is asked and nothing doubted."""
    problem = replace(fit.evaluator.problem, unit_s=1.0, interval_s=1.0)
    quick = replace(with_lag(fit, 60.0), evaluator=replace(fit.evaluator, problem=problem))
    assert dead_bands_of(fit)
    assert dead_bands_of(quick) == ()
    assert not may_be_shaken(quick, None, (SURE,), 5.0)


def kept(
    S: float, noise: float, every: int, *, averaged: bool = False, set_points: bool = False
) -> Recording:
    """A stem with this ``S`` that jumps nowhere, a second late, behind a controller's ``noise`` of
    OP, percent, of which the archive keeps a sample ``every`` so many seconds for eight hours, or
    the average over them; ``set_points`` beside them, which show which of the two it keeps."""
    rng = np.random.default_rng(4091)
    scans = 8 * 3600
    moves = np.repeat(rng.uniform(-6.0, 6.0, scans // 600), 600)
    slow = np.convolve(moves, np.ones(300) / 300.0, "same")
    op = 50.0 + slow + noise * rng.standard_normal(scans)
    stem, mv = op[0], np.empty_like(op)
    for k in range(1, scans):
        mv[k - 1] = stem
        stem = min(max(stem, op[k - 1] - 0.5 * S), op[k - 1] + 0.5 * S)
    mv[-1] = stem
    mv += 0.05 * rng.standard_normal(scans)
    signals = {"op": op, "mv": mv}
    if set_points:
        signals["sp"] = np.roll(50.0 + moves, 7)
    rows = {name: values.reshape(-1, every) for name, values in signals.items()}
    values = {name: row.mean(axis=1) if averaged else row[:, 0] for name, row in rows.items()}
    return stemwatch.read(**values, interval_s=float(every), valve="FIC-2")


@pytest.mark.parametrize(
    ("S", "noise", "verdict"),
    [
        (2.0, 0.6, Verdict.UNDETERMINED),  # was healthy at a confidence of 0.99
        (0.1, 0.05, Verdict.HEALTHY),
        (2.0, 0.05, Verdict.STICKY),
    ],
)
def test_a_band_that_noise_of_OP_hides_is_not_called_healthy(S, noise, verdict):
    """A sample every 30 s, noise at each scan."""
    (found,) = screen([Case(recording=kept(S, noise, 30))], Options(narx=False))
    assert found.verdict is verdict
    if verdict is Verdict.UNDETERMINED:
        assert found.no_verdict is NoVerdict.SLOW_SAMPLING
        assert found.S.value is None
        assert "to manual" in found.advice


def test_what_may_be_hidden_grows_with_the_noise_that_the_stem_does_not_follow():
    """White noise of s spans 4.1 s in the thirty scans of a sample (Blom): so much is added to S.
    The position is kept before it answers the last scan, so that s is that of OP."""
    for noise in (0.0, 0.3, 0.6):
        fit = fit_stickslip(kept(0.1, noise, 30))
        assert S_unseen(fit, 0.5) - 0.5 == pytest.approx(4.1 * noise, rel=0.15, abs=0.15)


@pytest.mark.parametrize("every", [30, 60])
def test_a_band_within_averages_is_not_called_healthy_with_confidence(every):
    """An S of 1.75 % read as 0.0 %, at a confidence of 0.99."""
    (found,) = screen([Case(recording=kept(1.75, 0.58, every, averaged=True))], Options(narx=False))
    assert found.verdict in (Verdict.HEALTHY, Verdict.UNDETERMINED)
    if found.verdict is Verdict.HEALTHY:
        assert found.confidence <= 0.5
        assert f"averages over {every} s" in found.reason or "averages over 1 min" in found.reason
        assert "step OP by 1 % in manual" in found.advice


@pytest.mark.parametrize("every", [10, 30])
def test_a_band_within_averages_that_set_points_show_gives_no_verdict(every):
    """The same, known to be averages: S of 1.6 % was *healthy* at 0.99 behind averages of 10 s."""
    recording = kept(1.6, 0.55, every, averaged=True, set_points=True)
    (found,) = screen([Case(recording=recording)], Options(narx=False))
    assert (found.verdict, found.no_verdict) == (Verdict.UNDETERMINED, NoVerdict.SLOW_SAMPLING)


def test_samples_that_set_points_show_are_not_taken_for_averages():
    """A healthy stem that answers late, every 30 s: its confidence was 0.5 at most."""
    late = kept(0.1, 0.15, 30, set_points=True)
    (found,) = screen([Case(recording=late)], Options(narx=False))
    assert (found.verdict, found.confidence) == (Verdict.HEALTHY, 0.99)
    without = replace(late, signals={r: s for r, s in late.signals.items() if r is not Role.SP})
    (doubted,) = screen([Case(recording=without)], Options(narx=False))
    assert doubted.confidence == 0.5


def test_the_interval_of_S_reaches_to_what_noise_may_hide():
    """S of 0.9 % read as next to nothing every 30 s, with an interval that ended at 0.4 %."""
    (found,) = screen([Case(recording=kept(0.9, 0.15, 30))], Options(narx=False))
    assert found.verdict is Verdict.HEALTHY
    assert found.S.low <= 0.9 <= found.S.high


def test_averages_of_a_stem_that_follows_hide_little():
    """What is left of its position is a transmitter's noise, a fifth of it after 30 s."""
    (found,) = screen([Case(recording=kept(0.1, 0.3, 30, averaged=True))], Options(narx=False))
    assert (found.verdict, found.confidence) == (Verdict.HEALTHY, 0.99)
    assert "averages" not in found.reason


def test_what_averages_may_hide_is_the_band_that_was_there():
    """Read as nothing, and told as what it is, within the factor that the noise leaves open."""
    for every in (30, 60):
        fit = fit_stickslip(kept(1.75, 0.58, every, averaged=True))
        assert fit.S < 0.5
        assert 1.5 < S_averaged(fit, fit.S) < 3.0
    quick = fit_stickslip(kept(0.1, 0.3, 5, averaged=True))
    assert S_averaged(quick, 0.2) == 0.2


def test_noise_that_the_stem_follows_hides_nothing():
    """OP that moves as much, but slowly enough for the stem, takes a dead band along."""
    rng = np.random.default_rng(4092)
    op = 50.0 + np.cumsum(rng.standard_normal(1000)) * 0.6
    mv = op + 0.05 * rng.standard_normal(op.size)
    fit = fit_stickslip(stemwatch.read(op=op, mv=mv, interval_s=30.0, valve="FIC-3"))
    assert S_unseen(fit, 0.2) < 0.5


def test_a_quick_archive_hides_no_band(fit):
    """With a sample every second the fits see each scan."""
    problem = replace(fit.evaluator.problem, unit_s=1.0, interval_s=1.0)
    quick = replace(fit, evaluator=replace(fit.evaluator, problem=problem))
    assert S_unseen(fit, 0.2) > 1.5
    assert S_unseen(quick, 0.2) == 0.2
