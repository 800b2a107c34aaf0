"""S and J recovered, in percent, from a plant that is written as a force balance."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from stemwatch.models.recording import Recording, Role, Signal
from stemwatch.models.stickslip import kernel
from stemwatch.models.stickslip import parameters as coordinate
from stemwatch.models.stickslip.advantage import Advantage, advantage
from stemwatch.models.stickslip.fit import fit_stickslip
from stemwatch.models.stickslip.interval import bootstrap, interval
from stemwatch.models.stickslip.problem import make_problem, scored_samples
from stemwatch.models.studies.simulator import simulate_loop
from stemwatch.models.studies.simulator.draws import draw_sticky
from tests.models.half_an_hour import half_an_hour

SHAPES = {"deadband": (5.0, 0.0), "undershoot": (5.0, 2.0), "no offset": (4.0, 4.0)}
SHAPES["overshoot"] = (3.0, 3.6)
ACTUATORS = [(0.1, 0.0), (0.5, 1.0), (2.0, 0.0), (2.0, 1.0)]  # lag s, dead time s


@cache
def fitted(S: float, J: float, lag_s: float = 0.1, dead_time_s: float = 0.0):
    return fit_stickslip(half_an_hour(S, J, lag_s, dead_time_s).recording)


def recorded(op, mv, interval_s=1.0) -> Recording:
    signals = {Role.OP: Signal.good(op, "V.OP"), Role.MV: Signal.good(mv, "V.ZT")}
    return Recording(valve="V", signals=signals, interval_s=interval_s)


def test_a_hole_in_the_position_leaves_the_command_alone():
    """Where only MV is missing, the free run still sees the true command."""
    op, mv = np.arange(400.0) / 10.0, np.arange(400.0) / 10.0
    mv[200:203] = np.nan
    np.testing.assert_array_equal(make_problem(recorded(op, mv)).op, op)


def test_short_holes_are_bridged_and_long_ones_restart():
    """Up to three missing samples hold the last value; a longer hole starts the run afresh."""
    op = np.arange(400.0)
    for first, length in ((100, 3), (200, 4)):
        op[first : first + length] = np.nan
    problem = make_problem(recorded(op, np.zeros(400)))
    assert [0, 204] == np.flatnonzero(problem.start == kernel.START).tolist()
    np.testing.assert_array_equal(problem.op[99:103], 99.0)
    assert np.isfinite(problem.op).all()


def test_nothing_is_scored_right_after_a_restart_or_in_a_hole():
    """Thirty seconds after each restart the stem's history is unknown, and a hole has no MV."""
    mv = np.zeros(1000)
    mv[500:510] = np.nan
    expected = np.ones(1000, dtype=bool)
    expected[:30] = expected[500:540] = False
    np.testing.assert_array_equal(scored_samples(recorded(np.zeros(1000), mv)), expected)


def test_blocks_cover_the_record_in_order():
    """Blocks of time are contiguous, near 90 s, and each begins where it is resynchronised."""
    rng = np.random.default_rng(0)
    problem = make_problem(recorded(*rng.standard_normal((2, 1003))))
    scored = problem.block[problem.block >= 0]
    assert 11 == problem.n_blocks
    assert (np.diff(scored) >= 0).all()
    begins = np.flatnonzero(problem.resynced_marks == kernel.RESYNC)
    np.testing.assert_array_equal(problem.block[begins], np.arange(1, 11))
    np.testing.assert_array_equal(problem.block[begins - 1], np.arange(10))


@pytest.mark.parametrize("interval_s", [0.05, 1.0, 60.0])
def test_any_interval_makes_a_problem(interval_s):
    """At any sampling there are at least eight blocks and something to score."""
    rng = np.random.default_rng(0)
    problem = make_problem(recorded(*rng.standard_normal((2, 900)), interval_s))
    assert problem.n_blocks >= 8
    assert problem.scored.mean() > 0.8


def test_a_fit_needs_a_position():
    """Without MV the fit says which valve lacks what."""
    op = Signal.good(np.zeros(300), "V.OP")
    recording = Recording(valve="FV-7", signals={Role.OP: op}, interval_s=1.0)
    with pytest.raises(ValueError, match=r"FV-7: a stick-slip fit needs the valve position \(MV\)"):
        fit_stickslip(recording)


def test_a_fit_needs_usable_pairs():
    """Where no pair of OP and MV is usable the fit says so."""
    nothing = np.full(300, np.nan)
    with pytest.raises(ValueError, match="no usable pair of OP and MV"):
        fit_stickslip(recorded(np.zeros(300), nothing))


@pytest.mark.parametrize(("lag_s", "dead_time_s"), ACTUATORS)
@pytest.mark.parametrize("shape", sorted(SHAPES))
def test_recovers_S_and_J(shape, lag_s, dead_time_s):
    """S and J come out within 10 % of S, whatever actuator stands before the stem."""
    S, J = SHAPES[shape]
    fit = fitted(S, J, lag_s, dead_time_s)
    assert abs(fit.S - S) <= 0.1 * S + 0.1
    assert abs(fit.J - J) <= 0.1 * S + 0.1


@pytest.mark.parametrize("shape", sorted(SHAPES))
def test_intervals_hold_the_truth(shape):
    """The intervals of S and J hold the simulated values, and are no wider than S itself."""
    S, J = SHAPES[shape]
    fit = fitted(S, J)
    draws = bootstrap(fit)
    (S_low, S_high), (J_low, J_high) = interval(draws.S, fit.S), interval(draws.J, fit.J)
    assert S_low <= S <= S_high
    assert J_low <= J <= J_high
    assert S_high - S_low < S


@pytest.mark.long
def test_intervals_hold_at_about_their_rate():
    """Of drawn sticking valves without positioner most 95 % intervals hold the simulated values."""
    held = []
    for seed, loop in enumerate(draw_sticky(16, 77)):
        if loop.valve.positioner_gain > 0.0:
            continue
        item = simulate_loop(loop, seed)
        fit = fit_stickslip(item.recording)
        draws = bootstrap(fit)
        for name, value in (("S", fit.S), ("J", fit.J)):
            low, high = interval(getattr(draws, name), value)
            held.append(low <= getattr(item.truth, name) <= high)
    assert len(held) >= 24
    assert np.mean(held) >= 0.85


def test_interval_is_widened_to_its_value():
    """An estimate outside its draws still lies in its interval."""
    assert (1.0, 3.0) == interval(np.full(300, 3.0), 1.0)


def slowed(op, tau_s, delay):
    """The command behind a first-order lag and a delay of whole samples, in plain Python."""
    p, out = op[0], []
    for u in np.concatenate((np.full(delay, op[0]), op[: op.size - delay])):
        p += (1.0 - np.exp(-1.0 / tau_s)) * (u - p)
        out.append(p)
    return np.array(out)


def swept(S, J, tau_s, delay, reach):
    """A command of irregular sweeps up to twice ``reach``, and the stem behind a slow actuator."""
    rng = np.random.default_rng(0)
    turns = np.cumsum(rng.uniform(20.0, 60.0, 80))
    heights = 50.0 + rng.uniform(0.8, 2.0, 80) * reach * np.where(np.arange(80) % 2, 1.0, -1.0)
    op = np.interp(np.arange(1800.0), turns, heights)
    marks = np.zeros(1800, dtype=np.uint8)
    marks[0] = kernel.START
    q = np.zeros(kernel.N_PARAMETERS)
    q[[kernel.S, kernel.J, kernel.GAIN]] = S, J, 1.0
    q[[kernel.RATE_UP, kernel.RATE_DOWN]] = np.inf
    mv = np.empty(1800)
    kernel.simulate(slowed(op, tau_s, delay), np.full(1800, op[0]), marks, 1.0, q, mv)
    return recorded(op, mv + 0.03 * rng.standard_normal(1800))


def test_a_hidden_lag_does_not_change_S_and_J():
    """A lag of 4 s and a delay of 3 s mislead S and J alone, and not the fit that is chosen."""
    fit = fit_stickslip(swept(3.0, 1.5, 4.0, 3, reach=3.0))
    assert "both" == fit.hypothesis
    assert abs(fit.naive[coordinate.S_PERCENT] - 3.0) > 1.0
    assert abs(fit.S - 3.0) < 0.15
    assert abs(fit.J - 1.5) < 0.15
    assert (
        abs(fit.candidate[coordinate.DEAD_TIME_S] + fit.candidate[coordinate.LAG_UP_S] - 7.0) < 1.0
    )


def test_a_slow_healthy_valve_has_a_small_S():
    """A lag of 5 s and a dead time of 2 s read as friction to S and J alone, and only there."""
    fit = fit_stickslip(swept(0.3, 0.0, 5.0, 2, reach=4.0))
    assert fit.naive[coordinate.S_PERCENT] > 2.0 * fit.S
    assert fit.S < 0.5


def test_no_actuator_is_seen_where_there_is_none():
    """Stick-slip alone is not asked to share its record with an actuator."""
    fit = fit_stickslip(swept(4.0, 1.0, 1e-3, 0, reach=4.0))
    assert "sticking" == fit.hypothesis
    assert abs(fit.S - 4.0) < 0.1
    assert abs(fit.J - 1.0) < 0.1


def test_same_recording_same_result():
    """Fit and interval are deterministic to the last bit."""
    recording = half_an_hour(5.0, 2.0).recording
    first, second = fit_stickslip(recording), fit_stickslip(recording)
    np.testing.assert_array_equal(first.candidate, second.candidate)
    np.testing.assert_array_equal(bootstrap(first).S, bootstrap(second).S)
    np.testing.assert_array_equal(bootstrap(first).J, bootstrap(second).J)


@pytest.mark.parametrize("shape", ["undershoot", "no offset"])
def test_halved_signals_halve_S_and_J(shape):
    """OP and MV scaled by a half about 50 % give half of S and of J."""
    recording = half_an_hour(*SHAPES[shape]).recording
    op, mv = (50.0 + 0.5 * (recording.signals[r].values - 50.0) for r in (Role.OP, Role.MV))
    complete, half = fitted(*SHAPES[shape]), fit_stickslip(recorded(op, mv))
    assert abs(half.S - 0.5 * complete.S) < 0.02 * complete.S
    assert abs(half.J - 0.5 * complete.J) < 0.02 * complete.S


def test_zero_error_of_the_position_is_no_friction():
    """A position that reads 2 % high changes the reading's zero, and neither S nor J."""
    recording = half_an_hour(5.0, 2.0).recording
    high = fit_stickslip(recorded(recording.op.values, recording.signals[Role.MV].values + 2.0))
    plain = fitted(5.0, 2.0)
    assert abs(high.S - plain.S) < 0.1
    assert abs(high.J - plain.J) < 0.1
    assert abs(high.candidate[coordinate.ZERO] - plain.candidate[coordinate.ZERO] - 2.0) < 0.1


def test_holes_and_gaps_leave_S_and_J():
    """A tenth of the samples missing, singly and in gaps, moves S and J by little."""
    recording = half_an_hour(5.0, 2.0).recording
    op, mv = recording.op.values.copy(), recording.signals[Role.MV].values.copy()
    rng = np.random.default_rng(4)
    op[rng.random(op.size) < 0.03] = np.nan
    mv[rng.random(mv.size) < 0.05] = np.nan
    op[600:640] = mv[1400:1450] = np.nan
    fit = fit_stickslip(recorded(op, mv))
    assert abs(fit.S - 5.0) < 0.4
    assert abs(fit.J - 2.0) < 0.5


@pytest.mark.parametrize("step", [0.25, 1.0])
def test_coarse_command_keeps_S(step):
    """OP recorded coarsely leaves S within one of its steps."""
    recording = half_an_hour(5.0, 2.0).recording
    op = np.round(recording.op.values / step) * step
    assert abs(fit_stickslip(recorded(op, recording.signals[Role.MV].values)).S - 5.0) < step


def test_heldout_part_was_not_fitted():
    """What comes after the first held-out sample does not change the model that judges it."""
    recording = half_an_hour(5.0, 2.0).recording
    fit = fitted(5.0, 2.0)
    mv = recording.signals[Role.MV].values.copy()
    mv[fit.first_heldout :] = mv[fit.first_heldout :][::-1]
    other = fit_stickslip(recorded(recording.op.values, mv))
    assert fit.first_heldout == other.first_heldout
    assert 0.55 < fit.first_heldout / len(recording) < 0.65
    if other.hypothesis == fit.hypothesis:
        np.testing.assert_allclose(other.trained, fit.trained, atol=0.25)


def test_advantage_by_hand():
    """Blocks that all halve the loss give log 2 and a t without spread; few blocks give nothing."""
    simple, counts = np.full(5, 4.0), np.full(5, 10.0)
    seen = advantage(simple, 0.5 * simple, counts, 1e-6)
    assert abs(seen.mean - np.log(2.0)) < 1e-6
    assert abs(seen.t - np.log(2.0) / 0.01) < 1e-3
    assert Advantage(0.0, 0.0) == advantage(simple[:2], simple[:2], counts[:2], 1.0)


def test_one_missed_slip_cannot_dominate_an_advantage():
    """A block that is a thousand times worse counts as log ratio 2 at most."""
    simple, counts = np.array([4000.0, 4.0, 4.0]), np.full(3, 10.0)
    assert advantage(simple, np.full(3, 4.0), counts, 1e-6).mean <= 2.0 / 3.0 + 1e-9


def test_empty_blocks_are_left_out_of_an_advantage():
    """Blocks without a scored sample are left out of an advantage."""
    simple, counts = np.array([4.0, 4.0, 4.0, 0.0]), np.array([10.0, 10.0, 10.0, 0.0])
    assert Advantage(0.0, 0.0) == advantage(simple, simple, counts, 1.0)
    assert Advantage(0.0, 0.0) == advantage(simple[1:], 0.5 * simple[1:], counts[1:], 1.0)
