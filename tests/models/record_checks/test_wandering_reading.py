"""A reading that wanders is told as one: no sticking, and no loop that is sampled too slowly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import stemwatch
from stemwatch.models.decision.doubts import CHECK_TRANSMITTER
from stemwatch.models.record_checks.wandering_reading import find_wander
from stemwatch.models.recording import Floats, Recording
from stemwatch.models.screening.screen import Case, Options, screen
from stemwatch.models.verdict import NoVerdict, Verdict

QUICK = Options(narx=False, mismatch=False)
SAMPLES, EVERY_S = 2400, 10.0


def command(seed: int = 5) -> Floats:
    """OP every ten seconds, as a load moves it about every few minutes."""
    rng = np.random.default_rng(seed)
    op = np.empty(SAMPLES)
    slow = quick = 0.0
    for k in range(SAMPLES):
        slow += -slow / 60.0 + 0.5 * rng.standard_normal()
        quick += 0.3 * (slow - quick)
        op[k] = quick
    return 50.0 + 2.0 * op


def read(percent: float = 0.0, minutes: float = 45.0, S: float = 0.2) -> Recording:
    """A stem with this ``S`` that jumps nowhere, and a wave of so many ``percent`` of travel from
    lowest to highest, and so many ``minutes``, on its reading."""
    op = command()
    mv, place = np.empty(SAMPLES), op[0]
    for k in range(SAMPLES):
        place = min(max(place, op[k] - 0.5 * S), op[k] + 0.5 * S)
        mv[k] = place
    wave = 0.5 * percent * np.sin(2.0 * np.pi * np.arange(SAMPLES) * EVERY_S / (60.0 * minutes))
    mv += wave + 0.05 * np.random.default_rng(6).standard_normal(SAMPLES)
    return stemwatch.read(op=op, mv=mv, interval_s=EVERY_S, valve="FIC-5")


@pytest.mark.parametrize("minutes", [20.0, 45.0, 100.0])
def test_range_and_period_of_a_wander_are_told(minutes):
    """And its course, beside which the position follows OP."""
    recording = read(3.0, minutes)
    wander = find_wander(recording)
    assert wander.percent == pytest.approx(3.0, abs=0.25)
    assert wander.period_s == pytest.approx(60.0 * minutes, rel=0.25)
    left = recording.mv.values - recording.op.values - wander.course
    assert np.std(left) < 0.25


@pytest.mark.parametrize("S", [0.2, 1.0, 3.0, 6.0])
def test_a_stem_that_follows_or_sticks_reads_true(S):
    """However far its dead band keeps it from OP."""
    assert find_wander(read(S=S)) is None


def test_a_drift_is_left_to_the_search_for_effects():
    """It has a name there."""
    recording = read()
    drift = replace(recording.mv, values=recording.mv.values + np.linspace(0.0, 4.0, SAMPLES))
    role = next(role for role, signal in recording.signals.items() if signal is recording.mv)
    assert find_wander(replace(recording, signals={**recording.signals, role: drift})) is None


def test_a_healthy_valve_whose_reading_wanders_is_neither_sticky_nor_sampled_too_slowly():
    """The reason is the reading, and the advice its transmitter."""
    (found,) = screen([Case(recording=read(3.5))], QUICK)
    assert found.verdict is Verdict.UNDETERMINED
    assert found.no_verdict is NoVerdict.READING_WANDERS
    assert "the position reading wanders by 3." in found.reason
    assert found.advice == CHECK_TRANSMITTER
    assert found.S.value is None


def test_a_small_wander_is_told_beside_the_verdict():
    """A stroke check lets it pass."""
    (found,) = screen([Case(recording=read(0.9))], QUICK)
    assert found.verdict is Verdict.HEALTHY
    assert "reading wanders by 0." in found.reason
    assert CHECK_TRANSMITTER in found.advice


def test_what_was_named_is_not_doubted():
    """A slow wave over the record is named as a drift of the reading, and stands as that."""
    (found,) = screen([Case(recording=read(3.0, 300.0))], Options(narx=False))
    assert {effect.slug for effect in found.mismatch.effects} == {"sensor_drift"}
    assert found.no_verdict is None


def test_a_stem_that_sticks_is_sticky_whatever_its_reading_does():
    """Its rests and jumps are no wander."""
    (found,) = screen([Case(recording=read(1.5, S=4.0))], QUICK)
    assert found.verdict is Verdict.STICKY
