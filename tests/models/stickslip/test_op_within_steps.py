"""OP in coarse steps, reconstructed within them from PV and set point."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from stemwatch.models.mismatch.explain import explain
from stemwatch.models.preparation.own_clock import on_own_clock
from stemwatch.models.recording import Quality, Role, Signal
from stemwatch.models.screening.screen import Case, Options, screen
from stemwatch.models.stickslip.op_within_steps import WITHIN_STEPS, op_within_steps
from stemwatch.models.studies.simulator import simulate_loop
from stemwatch.service.studies.robustness import draw_valves

STEP = 0.5


@cache
def recorded(place: int):
    """A valve, sticking below 2 and healthy above, and what was recorded of it."""
    valve = valves()[place]
    return valve, simulate_loop(valve.case.loop, valve.case.seed).recording


@cache
def valves():
    """Two sticking and two healthy ones; drawing them takes seconds."""
    return draw_valves(2, 8484)


def with_signal(recording, role: Role, values):
    """The recording with other values of one signal."""
    signal = Signal.good(values, recording.signals[role].tag)
    return replace(recording, signals={**recording.signals, role: signal})


def in_steps(recording):
    """The recording with OP rounded to steps of half a percent."""
    return with_signal(recording, Role.OP, STEP * np.round(recording.op.values / STEP))


@pytest.mark.parametrize("place", range(4))
def test_op_is_where_it_was_within_its_steps(place):
    """OP is found to half of the rounding, whether the valve sticks or not, and with about the
    stated error.
    """
    _, recording = recorded(place)
    stored = on_own_clock(in_steps(recording))
    told = op_within_steps(stored)
    assert told is not None
    assert told.step == pytest.approx(STEP)
    off = told.recording.op.values - recording.op.values
    assert np.std(off) < 0.6 * STEP / np.sqrt(12.0)
    assert np.std(off) < 3.0 * told.open
    assert np.max(np.abs(told.recording.op.values - stored.op.values)) <= 0.5 * STEP + 1e-9


def test_a_fine_op_is_left_as_it_is():
    """Nothing is looked for where OP has no coarse steps."""
    _, recording = recorded(0)
    assert op_within_steps(on_own_clock(recording)) is None


def test_steps_of_the_controller_itself_are_kept():
    """The same PV, set point and OP, but the stem follows the steps that were stored."""
    _, recording = recorded(2)
    stored = in_steps(recording)
    op, mv = stored.op.values, np.empty(len(stored))
    place = op[0]
    for k in range(op.size):  # a dead band of 0.3 %, nothing else
        place = min(max(place, op[k] - 0.15), op[k] + 0.15)
        mv[k] = place
    mv += 0.03 * np.random.default_rng(7).standard_normal(op.size)
    assert op_within_steps(on_own_clock(with_signal(stored, Role.MV, mv))) is None


def test_without_pv_op_is_not_reconstructed():
    """The controller answers PV, so without it there is no law."""
    _, recording = recorded(0)
    stored = on_own_clock(in_steps(recording))
    signals = {role: one for role, one in stored.signals.items() if role is not Role.PV}
    assert op_within_steps(replace(stored, signals=signals)) is None


def test_holes_of_op_stay_holes_and_those_of_pv_harm_nothing():
    """No value is made up for a hole, and OP about one of PV is within its steps."""
    _, recording = recorded(1)
    stored = on_own_clock(in_steps(recording))
    op, pv = stored.op.values.copy(), stored.signals[Role.PV].values.copy()
    op[1000:1040], pv[2000:2060] = np.nan, np.nan
    broken = with_signal(with_signal(stored, Role.OP, op), Role.PV, pv)
    told = op_within_steps(broken)
    assert told is not None
    assert np.array_equal(np.isfinite(told.recording.op.values), np.isfinite(op))
    assert np.all(told.recording.op.quality[1000:1040] == Quality.MISSING)
    off = (told.recording.op.values - recording.op.values)[np.isfinite(op)]
    assert np.std(off) < 0.6 * STEP / np.sqrt(12.0)


@pytest.mark.long
def test_screening_says_so_and_reads_s_as_from_the_fine_op():
    """S is that of the fine OP, and provenance and record effects have the sentence."""
    valve, recording = recorded(0)
    fine, coarse = screen(
        [Case(recording=recording), Case(recording=in_steps(recording))], Options(narx=False)
    )
    assert coarse.S.value == pytest.approx(fine.S.value, abs=0.1)
    assert coarse.S.low <= valve.S <= coarse.S.high
    assert WITHIN_STEPS in coarse.provenance.decisions
    assert WITHIN_STEPS not in fine.provenance.decisions
    assert any(WITHIN_STEPS in effect.sentence for effect in coarse.mismatch.record_effects)
    assert not coarse.mismatch.effects


@pytest.mark.long
def test_explain_alone_says_so():
    """Without a screening before it, the step is among the record effects with the sentence."""
    _, recording = recorded(1)
    told = explain(in_steps(recording)).record_effects
    (steps,) = (effect for effect in told if effect.slug == "quantisation")
    assert WITHIN_STEPS in steps.sentence
    assert steps.parameters["op_step_percent"] == pytest.approx(STEP)
