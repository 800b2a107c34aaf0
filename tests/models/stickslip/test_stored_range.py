"""Positions and commands that were stored in another range than percent."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stemwatch.models.recording import Recording, Role, Signal
from stemwatch.models.screening.screen import Case, Options, screen
from stemwatch.models.signals.first_order_lag import first_order_lag
from stemwatch.models.stickslip.stored_range import in_percent, range_of_both, range_of_op
from stemwatch.models.studies.simulator import draw_sticky, simulate_loop
from stemwatch.simulation import sticking_flow_loop

QUICK = Options(narx=False, mismatch=False)


@pytest.fixture(scope="module")
def recording() -> Recording:
    """A sticking valve whose OP and position are in percent."""
    return simulate_loop(draw_sticky(1, 5151)[0], 1).recording


def stored(recording: Recording, role: Role, low: float, high: float, unit: str = "%") -> Recording:
    signal = recording.signals[role]
    values = low + signal.values * (high - low) / 100.0
    signals = {**recording.signals, role: Signal.good(values, signal.tag, unit)}
    return replace(recording, signals=signals)


@pytest.mark.parametrize("role", [Role.MV, Role.OP])
@pytest.mark.parametrize(
    ("low", "high"), [(4, 20), (20, 4), (0, 1), (0, 10), (1, 5), (0, 4095), (0, 27648)]
)
def test_a_range_in_use_is_read_as_such_and_said(recording, role, low, high):
    """Milliamperes, volts, fractions and counts become percent again, with a sentence."""
    read = in_percent(stored(recording, role, low, high))
    assert read.signals[role].values == pytest.approx(recording.signals[role].values, abs=1e-6)
    assert f"low = {low}, high = {high}." in read.provenance.decisions[-1]
    assert recording.signals[role].tag in read.provenance.decisions[-1]


@pytest.mark.parametrize("off", [-8.0, 8.0])
def test_a_position_whose_zero_is_off_does_not_choose_another_range(off):
    """OP in 4 to 20 mA beside a position that reads 8 % too high or too low: it is not taken for
    0 to 20 mA, nor for percent behind a curve."""
    draw = np.random.default_rng(1)
    load = first_order_lag(first_order_lag(draw.standard_normal(3000), 60.0), 20.0)
    op = 50.0 + 5.0 * load / load.std()
    mv = first_order_lag(op, 1.0) + 0.05 * draw.standard_normal(3000)
    signals = {Role.OP: Signal.good(op, "OP"), Role.MV: Signal.good(mv + off, "MV")}
    in_percent_both = Recording(valve="V", signals=signals, interval_s=1.0)
    read = in_percent(stored(in_percent_both, Role.OP, 4, 20))
    assert read.op.values == pytest.approx(op, abs=1e-6)


def test_percent_stays_as_it_is(recording):
    """Nothing is read otherwise where command and position go together as they stand."""
    assert in_percent(recording) is recording


@pytest.mark.parametrize(("low", "high"), [(4, 20), (1, 5)])
def test_both_stored_in_a_range_with_a_live_zero_are_doubted(recording, low, high):
    """They agree as they are, so that nothing is converted; but they may be stored so."""
    both = stored(stored(recording, Role.MV, low, high), Role.OP, low, high)
    assert in_percent(both) is both
    found = range_of_both(both)
    assert found is not None
    assert (found.low, found.high) == (low, high)
    assert found.times == pytest.approx(100.0 / (high - low))
    assert range_of_both(recording) is None
    assert range_of_both(stored(recording, Role.MV, low, high)) is None
    for role in (Role.OP, Role.MV):  # the plant has said that this is percent
        scaled = {**both.signals, role: replace(both.signals[role], scaled=True)}
        assert range_of_both(replace(both, signals=scaled)) is None


@pytest.mark.parametrize("bend", [np.square, np.sqrt])
def test_an_op_in_milliamperes_beside_a_position_that_is_not_linear_is_doubted(bend):
    """Where no range makes the two agree nothing is converted, but the verdict says what OP may be
    stored in; not where the plant has said that it is percent, nor where the position agrees."""
    loop = sticking_flow_loop(
        S=12.0, J=3.0, duration_s=2400.0, interval_s=1.0, seed=7171, tag="FIC-1", noise=0.05
    )
    position = loop.signals[Role.MV]
    values = 100.0 * bend(np.clip(position.values, 0.0, None) / 100.0)
    bent = replace(loop, signals={**loop.signals, Role.MV: replace(position, values=values)})
    raw = stored(bent, Role.OP, 4, 20)
    assert in_percent(raw) is raw
    found = range_of_op(raw)
    assert found is not None
    assert (found.low, found.high) == (4, 20)
    (screening,) = screen([Case(recording=raw)], QUICK)
    assert "OP stays within 4 to 20" in screening.reason
    assert "if it is stored in mA, S is 12." in screening.reason
    assert range_of_op(bent) is None
    assert range_of_op(stored(stored(loop, Role.MV, 4, 20), Role.OP, 4, 20)) is None
    scaled = {**raw.signals, Role.OP: replace(raw.signals[Role.OP], scaled=True)}
    assert range_of_op(replace(raw, signals=scaled)) is None


@pytest.mark.parametrize(("low", "high"), [(50, 100), (0, 50)])
def test_a_split_range_is_a_curve_and_no_other_unit(recording, low, high):
    """An OP half of which strokes the valve is left to the curve from OP to stroke."""
    split = stored(recording, Role.OP, low, high)
    assert in_percent(split) is split


def test_a_unit_that_says_otherwise_is_believed(recording):
    """A signal with the unit of a flow is not read as milliamperes."""
    flow = stored(recording, Role.MV, 4, 20, "m3/h")
    assert in_percent(flow) is flow


def test_noise_of_a_constant_position_is_not_scaled_to_a_range(recording):
    """The noise of a position at its stop is not blown up to a fraction."""
    rng = np.random.default_rng(1)
    noise = Signal.good(0.5 + 0.05 * rng.standard_normal(len(recording)), "ZT")
    dead = replace(recording, signals={**recording.signals, Role.MV: noise})
    assert in_percent(dead) is dead


def test_the_answer_is_that_of_the_recording_in_percent(recording):
    """A position in milliamperes gives the verdict, S and J of the same one in percent."""
    (plain,) = screen([Case(recording=recording)], QUICK)
    (read,) = screen([Case(recording=stored(recording, Role.MV, 4, 20))], QUICK)
    assert read.verdict is plain.verdict
    assert read.S.value == pytest.approx(plain.S.value, abs=0.02)
    assert read.recording is not None
    assert "low = 4, high = 20" in " ".join(read.recording.provenance.decisions)
