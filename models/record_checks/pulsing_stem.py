"""A stem that goes out and comes back by itself, while its command rests or moves slowly.

A positioner that hunts slowly or irregularly, a pilot that leaks and is filled again, a feedback
arm that slips on its shaft: the position leaves its place and returns, and OP did nothing. A
healthy stem never does that, and one that hardly sticks does not either. A fit of friction finds a
small S all the same, and nothing else is wrong. So with the residual ``r = MV - free run``

    a move of r from one turn to the next is the stem's own where OP, from shortly before it to its
    end, stays within twice its size, and within half of it over any time in which a stem answers

and two such moves after each other are a pulse: one out, one back. A move is larger than
``LEAST_PERCENT``, twice the fitted S, and five standard deviations of the reading's noise, as it is
(less readings of a single sample) or averaged over ``AVERAGED`` samples. OP may have moved unseen
by what its recorder leaves open. What is quicker than some samples is noise by this measure; its
line in the spectrum is looked for in ``own_swing``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.recording import Floats
from stemwatch.models.signals.excitation import ranges, reversals
from stemwatch.models.signals.forensics import medians_of_three, repeat_share
from stemwatch.models.stickslip import parameters as coordinate
from stemwatch.models.stickslip.fit import StickSlipFit

LEAST_PERCENT, NOISE = 0.4, 5.0  # of travel, and standard deviations of the reading
AVERAGED = 9  # samples
OF_S = 2.0  # times the fitted S, by which a model that rests where the stem moves is off
# Of a move of the position, within which OP stays: throughout, and while the stem answers.
THROUGHOUT, AT_ONCE = 2.0, 0.5
LAGS, SAMPLES_BEFORE = 4.0, 10  # before a move, in which OP may be its cause
# An OP that repeats itself moves unseen, by up to its least change either way; of a wider least
# change it is a person who sets OP.
REPEATS, WIDEST_STEP_PERCENT = 0.3, 2.0
# No record of 24 healthy valves (`draw_healthy`, seeds 6161 and 7171, even places) and of three
# (`draw_valves`, 8383) in 19 ways of `stemwatch robustness` has a single pulse. Slips that a model
# of friction misses count as well, so this is asked of a stem that hardly sticks.
FEWEST = 5


@dataclass(frozen=True)
class Pulses:
    """How often the stem went out and back by itself, and how far, percent of travel (median)."""

    count: int
    percent: float


def find_pulses(fit: StickSlipFit) -> Pulses | None:
    """The pulses of the stem that its command does not have; ``None`` where they are too few."""
    problem = fit.evaluator.problem
    off = problem.mv - fit.evaluator.simulate(fit.candidate)
    kernel = np.full(AVERAGED, 1.0 / AVERAGED)
    averaged = np.convolve(np.pad(off, AVERAGED // 2, mode="edge"), kernel, mode="valid")
    seen = [
        _pulses(fit, _without_single_samples(off), problem.sigma),
        _pulses(fit, averaged, problem.sigma / np.sqrt(AVERAGED)),
    ]
    most = max(seen, key=lambda pulses: pulses.count)
    return most if most.count >= FEWEST else None


def _pulses(fit: StickSlipFit, off: Floats, sigma: float) -> Pulses:
    """The pulses in how far the stem is ``off`` (n,) the model, percent, read with noise
    ``sigma``."""
    problem, before = fit.evaluator.problem, _before(fit)
    turns = reversals(off, max(NOISE * sigma, LEAST_PERCENT, OF_S * fit.S))
    if turns.size < FEWEST:
        return Pulses(0, 0.0)
    sizes = np.abs(np.diff(off[turns]))
    around = np.stack((np.maximum(turns[:-1] - before, 0), turns[1:] + 1), axis=1)
    hidden = 0.0 if fit.in_steps else _hidden_by_recorder(problem.op)
    own = ranges(problem.op, around) + hidden < THROUGHOUT * sizes
    own &= _highest(_moved_within(problem.op, before), around) + hidden < AT_ONCE * sizes
    known = np.concatenate(([0], np.cumsum(problem.scored)))
    own &= known[around[:, 1]] - known[around[:, 0]] == np.diff(around, axis=1)[:, 0]
    count = int(np.count_nonzero(own[1:] & own[:-1]))
    return Pulses(count, float(np.median(sizes[own])) if count else 0.0)


def _moved_within(op: Floats, samples: int) -> Floats:
    """(n,) the range of OP over the last so many ``samples``."""
    padded = np.pad(op, (min(samples, op.size), 0), mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, padded.size - op.size + 1)
    return np.asarray(np.ptp(windows, axis=1))


def _highest(values: Floats, runs: NDArray[np.int64]) -> Floats:
    """(m,) the highest of ``values`` (n,) in each of ``runs`` (m, 2), first sample and last + 1."""
    return np.asarray(np.maximum.reduceat(np.append(values, 0.0), runs.ravel())[::2])


def _before(fit: StickSlipFit) -> int:
    """Samples before a move of the stem in which OP may be its cause."""
    late, lag_up, lag_down = fit.candidate[
        [coordinate.DEAD_TIME_S, coordinate.LAG_UP_S, coordinate.LAG_DOWN_S]
    ]
    answer_s = late + LAGS * max(lag_up, lag_down)
    return int(np.ceil(answer_s / fit.evaluator.problem.interval_s)) + SAMPLES_BEFORE


def _hidden_by_recorder(op: Floats) -> float:
    """The percent by which a stored OP (n,) may have moved while it shows the same value."""
    steps = np.abs(np.diff(op))
    steps = steps[steps > 0.0]
    if repeat_share(op) < REPEATS or not steps.size:
        return 0.0
    return 2.0 * min(float(np.percentile(steps, 1.0)), WIDEST_STEP_PERCENT)


def _without_single_samples(values: Floats) -> Floats:
    """``values`` (n,) with each the median of itself and its neighbours."""
    middle = np.array(values)
    middle[1:-1] = medians_of_three(values)
    return middle
