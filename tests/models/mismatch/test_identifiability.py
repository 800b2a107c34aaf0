"""An effect that a recording never exercised is refused with a reason; one that it shows is not."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from stemwatch.models.mismatch.identifiability import NO_POSITION, PHYSICS, untestable_effects
from stemwatch.models.stickslip import kernel
from stemwatch.models.stickslip.problem import make_problem
from stemwatch.models.studies.simulator.hidden import draw_effect, simulate_hidden

N = 3600


def run(op, S=3.0, J=1.0, interval_s=1.0):
    """MV of a stem of S and J under a command."""
    q = np.zeros(kernel.N_PARAMETERS)
    q[[kernel.S, kernel.J, kernel.GAIN]] = S, J, 1.0
    q[[kernel.RATE_UP, kernel.RATE_DOWN]] = np.inf
    start = np.zeros(op.size, dtype=np.uint8)
    start[0] = kernel.START
    out = np.empty(op.size)
    kernel.simulate(op, op, start, interval_s, q, out)
    return out


def refused_in(op, mv=None, interval_s=1.0, S=3.0, J=1.0):
    """What is refused for a command, and for the position of a stem of S and J unless given."""
    simulated = run(op, S, J, interval_s)
    noise = 0.05 * np.random.default_rng(1).standard_normal(op.size)
    mv = (simulated if mv is None else mv) + noise
    scored = np.ones(op.size, dtype=bool)
    return untestable_effects(op, mv, simulated, scored, interval_s, 0.05, S, J)


@cache
def busy():
    """An hour of steps, ramps and holds over 20 to 80 %."""
    rng = np.random.default_rng(3)
    knots = np.cumsum(rng.choice([2.0, 8.0, 40.0, 150.0], 90))
    places = np.clip(50.0 + np.cumsum(rng.uniform(-12.0, 12.0, 90)) * 0.6, 20.0, 80.0)
    return np.interp(np.arange(float(N)), knots, places)


def test_a_busy_hour_refuses_only_the_stop():
    """Where OP moved in every way, only a stop that was not reached cannot be tested."""
    refused = refused_in(busy())
    assert set(refused) <= {"travel_stop"}
    assert "a stop further out was not reached" in refused["travel_stop"]


def test_without_a_position_nothing_is_testable():
    """OP and PV alone refuse every effect of the valve, each with the same reason."""
    refused = untestable_effects(busy(), None, None, np.ones(N, dtype=bool), 1.0, 0.05, 0.0, 0.0)
    assert dict.fromkeys(PHYSICS, NO_POSITION) == refused


def test_a_command_that_rests_refuses_all_that_needs_motion():
    """A held command shows neither lag nor speed nor friction."""
    refused = refused_in(np.full(N, 50.0))
    for slug in ("actuator_lag", "dead_time", "rate_limit", "span_error", "asymmetric_slip"):
        assert slug in refused
    assert "the stem moved 0 times" in refused["dead_time"]


@pytest.mark.parametrize(
    ("change", "slug", "words"),
    [
        (lambda op: 50.0 + 0.08 * (op - 50.0), "span_error", "of its travel; 6 % are needed"),
        (lambda op: 50.0 + 0.1 * (op - 50.0), "supply_sag", "the air supply was never drawn on"),
        (lambda op: op[:800], "sensor_drift", "the recording has 13 minutes"),
        (
            lambda op: 50.0 + 15.0 * np.sin(np.arange(N) / 600.0),
            "rate_limit",
            "0 times",
        ),
        (
            lambda op: np.where(np.arange(N) // 300 % 2, 60.0, 40.0),
            "low_speed_restick",
            "crept slower than 0.25 %/s for only 0 s",
        ),
    ],
)
def test_an_effect_not_exercised_is_refused_with_numbers(change, slug, words):
    """Each reason says what the recording has and what would be needed."""
    assert words in refused_in(change(busy().copy()))[slug]


def test_full_reversals_cannot_show_play():
    """A stem that reverses at every move looks like one with a smaller jump."""
    wave = 50.0 + 10.0 * np.sin(np.arange(N) / 20.0)
    assert "staircase test" in refused_in(wave)["lost_motion"]


def test_slow_sampling_refuses_the_quick_effects():
    """At 10 s between samples a lag of seconds is not testable, a wrong span is."""
    refused = refused_in(busy(), interval_s=10.0)
    assert "the samples are 10 s apart" in refused["actuator_lag"]
    assert "span_error" not in refused


@pytest.mark.parametrize(("held", "refused"), [(40, False), (3, True)])
def test_the_corners_of_steps_that_are_held_hide_no_turn(held, refused):
    """A stroke test in steps shows a lag, a delay and ringing; steps that follow one another at
    every third sample may have turned between samples."""
    steps = 50.0 + 10.0 * np.array([0, 1, 2, 1, 0, -1, -2, -1])
    assert ("actuator_lag" in refused_in(np.tile(np.repeat(steps, held), 6))) == refused


def test_a_stop_that_was_reached_is_testable():
    """Where MV stands still at its end while OP goes on, a stop may be named."""
    stopped = np.minimum(run(busy()), float(np.percentile(run(busy()), 80.0)))
    assert "travel_stop" not in refused_in(busy(), stopped)


@pytest.mark.parametrize(
    "slug",
    [
        "dead_time",
        pytest.param("rate_limit", marks=pytest.mark.long),
        pytest.param("supply_sag", marks=pytest.mark.long),
        pytest.param("lost_motion", marks=pytest.mark.long),
        pytest.param("dwell_dependent_breakaway", marks=pytest.mark.long),
    ],
)
def test_an_effect_that_moves_the_reading_is_not_refused(slug):
    """An effect that moved the reading of a force-balance plant in an hour is left to be tested."""
    for case in draw_effect(slug, 2, 41):
        seen, loop = simulate_hidden(case)
        if not seen.shows(slug):
            continue
        p = make_problem(loop.recording)
        simulated = run(p.op, 3.0, 1.0)
        refused = untestable_effects(
            p.op, p.mv, simulated, p.scored, p.interval_s, p.sigma, 3.0, 1.0
        )
        assert slug not in refused
