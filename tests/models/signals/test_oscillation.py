"""Whether a loop oscillates, and how regularly."""

from __future__ import annotations

import numpy as np
import pytest

from stemwatch.models.recording import Recording, Role, Signal
from stemwatch.models.signals.oscillation import loop_oscillation, oscillation

N = 2000


def noise(seed, n=N):
    return np.random.default_rng(seed).standard_normal(n)


@pytest.mark.parametrize(
    ("period_s", "interval_s"), [(20.0, 0.5), (60.0, 0.5), (20.0, 2.0), (60.0, 2.0), (250.0, 2.0)]
)
def test_period_of_a_noisy_sine(period_s, interval_s):
    """A noisy sine is regular, and its period is right within 3 %."""
    t = np.arange(N) * interval_s
    seen = oscillation(50.0 + np.sin(2 * np.pi * t / period_s) + 0.3 * noise(1), interval_s)
    assert seen.regular
    assert abs(seen.period_s / period_s - 1.0) < 0.03


def test_drift_does_not_hide_an_oscillation():
    """A slow drift ten times the size of the oscillation leaves its period."""
    t = np.arange(float(N))
    seen = oscillation(np.sin(2 * np.pi * t / 60.0) + t / 100.0 + 0.2 * noise(2), 1.0)
    assert seen.regular
    assert abs(seen.period_s / 60.0 - 1.0) < 0.05


def test_scale_and_zero_do_not_matter():
    """Period and regularity are the same in any unit, however large its numbers."""
    wave = np.sin(np.arange(float(N)) / 7.0) + 0.3 * noise(3)
    plain, scaled = oscillation(wave, 1.0), oscillation(1e200 * (wave + 5.0), 1.0)
    assert abs(plain.period_s - scaled.period_s) < 1e-6 * plain.period_s
    assert abs(plain.regularity - scaled.regularity) < 1e-6 * plain.regularity


def false_alarms(make):
    matching = [oscillation(make(seed), 1.0) for seed in range(60)]
    return np.mean([seen is not None and seen.regular for seen in matching])


def test_white_noise_does_not_oscillate():
    """At most one white-noise record in twenty is called regular."""
    assert false_alarms(noise) <= 0.05


def test_coloured_noise_and_random_walks_do_not_oscillate():
    """Drifting noise without a period is seldom called regular."""
    assert false_alarms(lambda seed: np.cumsum(noise(seed))) <= 0.2


@pytest.mark.parametrize(
    "values",
    [np.full(200, 50.0), np.zeros(200), noise(1, 63), np.array([]), 50.0 + 1e-12 * noise(1, 200)],
    ids=["constant", "zero", "short", "empty", "rounding"],
)
def test_nothing_to_measure(values):
    """A constant, a short record and rounding noise have no oscillation."""
    assert oscillation(values, 1.0) is None


def test_slow_sine_only_is_no_oscillation():
    """A single slow swing over the whole record is drift."""
    seen = oscillation(np.sin(2 * np.pi * np.arange(400) / 400.0), 1.0)
    assert seen is None or not seen.regular


def test_every_signal_of_the_loop_is_measured():
    """OP, PV and MV are measured across their holes, and only signals that are there."""
    wave = 50.0 + np.sin(np.arange(600.0) / 5.0)
    holed = np.where(np.random.default_rng(0).random(600) < 0.1, np.nan, wave)
    signals = {Role.OP: Signal.good(wave, "OP"), Role.PV: Signal.good(holed, "PV")}
    result = loop_oscillation(Recording(valve="V", signals=signals, interval_s=1.0))
    assert {Role.OP, Role.PV} == set(result)
    assert abs(result[Role.PV].period_s - 10.0 * np.pi) < 0.5


def test_a_signal_of_holes_is_left_out():
    """A signal with hardly a finite sample has no oscillation, and stops no other."""
    wave = np.sin(np.arange(600.0) / 5.0)
    signals = {Role.OP: Signal.good(wave, "OP"), Role.PV: Signal.good(wave * np.nan, "PV")}
    assert {Role.OP} == set(loop_oscillation(Recording(valve="V", signals=signals, interval_s=1.0)))
