"""The free run of an ensemble, sample by sample, in numba.

Signals are scaled: ``level`` is OP and ``position`` is MV, both in units of ``se``; ``move`` is
``(v(t) - v(t-1)) / sd``.
"""

from __future__ import annotations

import math

from numba import njit

from stemwatch.models.narx.plan import Plan
from stemwatch.models.recording import Floats


@njit(cache=True)
def increment(
    weights: Floats, hidden: int, error: float, move: float, drift: float, consensus: float
) -> float:
    """How far the stem moves in one sample; ``weights`` (p,) = value, gate, hidden, flattened."""
    gate = hidden + 5
    rows = gate + hidden + 1
    value = weights[hidden] * error + weights[hidden + 1] * move + weights[hidden + 2] * drift
    value += weights[hidden + 3] * consensus + weights[hidden + 4]
    opening = weights[rows - 1]
    for unit in range(hidden):
        row = rows + 5 * unit
        h = math.tanh(
            weights[row] * error
            + weights[row + 1] * move
            + weights[row + 2] * drift
            + weights[row + 3] * consensus
            + weights[row + 4]
        )
        value += weights[unit] * h
        opening += weights[gate + unit] * h
    # tanh cannot overflow, where exp(-opening) could.
    moved: float = 0.5 * (1.0 + math.tanh(0.5 * opening)) * value
    return moved


@njit(cache=True)
def free_run(
    weights: Floats,
    hidden: int,
    level: Floats,
    move: Floats,
    position: Floats,
    plan: Plan,
    codes: tuple[int, int, int],
    limits: tuple[float, float, float, float, float, float],
    ratio: float,
    edge: float,
    out: Floats,
) -> None:
    """Fill ``out`` (m, n) with each member's run; ``weights`` (m, p).

    ``plan`` (n,) says of each sample to ``skip`` it, ``seed`` the run from the measurement, ``run``
    on, or ``restart`` from the two measurements before it; ``codes`` are the numbers standing for
    seed, run and restart. ``limits`` = lowest and highest error, increment and position.
    ``ratio`` = se / sd; ``edge`` is the network's, in units of sd. What is skipped is left as
    it is.
    """
    seed, run, restart = codes
    error_low, error_high, slowest, fastest, low, high = limits
    for member in range(weights.shape[0]):
        before, last = 0.0, 0.0
        for t in range(level.shape[0]):
            if plan[t] == seed:
                new = position[t]
            elif plan[t] == run or plan[t] == restart:
                if plan[t] == restart:
                    before, last = position[t - 2], position[t - 1]
                error = min(max(level[t] - last, error_low), error_high)
                drift = ratio * (last - before)
                # Which way command and stem go, however slowly: 1 where both go up.
                consensus = 0.5 * (math.tanh(move[t] / edge) + math.tanh(drift / edge))
                step = increment(weights[member], hidden, error, move[t], drift, consensus)
                new = last + min(max(step, slowest), fastest)
                new = min(max(new, low), high)
            else:
                continue
            out[member, t] = new
            before, last = last, new
