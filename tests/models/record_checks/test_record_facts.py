"""Facts about a recording without a verdict."""

from __future__ import annotations

import numpy as np
import pytest

from stemwatch.models.record_checks.record_facts import facts_without_verdict
from stemwatch.models.recording import Quality, Recording, Role, Signal

T = np.arange(1200.0)
NOISE = np.random.default_rng(6).standard_normal(T.size)
WAVE = 50.0 + 5.0 * np.sin(T / 10.0)


def said(op=WAVE, *, op_unit="%", **more) -> str:
    signals = {Role.OP: Signal.good(np.asarray(op, dtype=float), "V.OP", op_unit)}
    for role, values in more.items():
        signal = values if isinstance(values, Signal) else Signal.good(values, f"V.{role}", "bar")
        signals[Role(role)] = signal
    sentences = facts_without_verdict(Recording(valve="V", signals=signals, interval_s=1.0))
    assert all(sentence.endswith(".") for sentence in sentences)
    assert not any(word in " ".join(sentences) for word in ("None", "nan"))
    return " ".join(sentences)


def test_movement_and_oscillation():
    """The swing of OP and the period of each regular signal are said, and what they leave open."""
    text = said(WAVE + 0.1 * NOISE, pv=3.0 + np.sin(T / 10.0) + 0.05 * NOISE)
    assert "OP moved over a range of 10" in text
    assert "in 20 minutes" in text
    assert "OP oscillates regularly, every 62.8 s" in text
    assert "PV oscillates regularly" in text
    assert "tight tuning and a disturbance can all do this" in text


def test_a_long_period_is_no_power_of_ten():
    """Samples 30 s apart: about every 1885 s."""
    signals = {Role.OP: Signal.good(WAVE + 0.1 * NOISE, "V.OP", "%")}
    wave = Recording(valve="V", signals=signals, interval_s=30.0)
    (cycle,) = (line for line in facts_without_verdict(wave) if "oscillates regularly" in line)
    assert ", every 18" in cycle
    assert "e+" not in cycle


def test_a_week_is_said_in_hours():
    """And not in ten thousand minutes."""
    signals = {Role.OP: Signal.good(WAVE + 0.1 * NOISE, "V.OP", "%")}
    week = Recording(valve="V", signals=signals, interval_s=7 * 86_400.0 / T.size)
    assert "in 168 hours." in facts_without_verdict(week)[0]


def test_no_oscillation():
    """Noise is said not to oscillate."""
    assert "No regular oscillation was found." in said(50.0 + NOISE)


def test_constant_signal():
    """A constant PV is named with its value and unit."""
    assert "PV is constant at 3.5 bar." in said(pv=np.full(T.size, 3.5))


def test_state_codes():
    """State codes in a value slot are counted, and what is left is hardly usable."""
    codes = np.full(T.size, Quality.CODE, dtype=np.uint8)
    text = said(pv=Signal(values=np.zeros(T.size), quality=codes, tag="PV"))
    assert "PV holds state codes instead of values in 100 % of the samples." in text
    assert "PV has hardly any usable sample." in text


def test_coarse_and_held():
    """Steps and repeats are said with their size."""
    text = said(pv=np.round(np.cumsum(NOISE) * 0.02 / 0.5) * 0.5)
    assert "PV repeats its last value in" in text
    assert "PV is recorded in steps of 0.5 bar." in text


def test_limits_of_op():
    """OP at a limit, OP outside percent, and OP in another unit are each said."""
    assert "OP is at its lower limit for" in said(np.maximum(5.0 * NOISE, 0.0))
    assert "OP is at its upper limit for" in said(np.minimum(100.0 + 5.0 * NOISE, 100.0))
    assert "it is not in percent" in said(WAVE + 340.0)
    assert "OP is in mA, not in percent." in said(op_unit="mA")


def test_set_point():
    """A set point that moves is said to, one that rests is not."""
    assert "The set point moved" in said(sp=np.where(T > 600, 4.0, 3.0))
    assert "The set point moved" not in said(sp=np.full(T.size, 3.0))


@pytest.mark.parametrize("op", [[], [50.0], [np.nan] * 100])
def test_next_to_nothing(op):
    """No sample, one sample or no number at all still give sentences."""
    assert "OP has hardly any usable sample." in said(op)


def test_a_loop_that_does_not_hold_its_set_point():
    """PV far from SP all the time is said; an offset within its own movement is not."""
    pv, far, near = 60.0 + np.sin(T / 10.0), np.full(T.size, 15.0), np.full(T.size, 58.5)
    assert "PV stays 44 bar and more from its set point" in said(pv=pv, sp=far)
    assert "from its set point" not in said(pv=pv, sp=near)
    elsewhere = Signal.good(far, "V.sp", "%")
    assert "from its set point" not in said(pv=pv, sp=elsewhere)
