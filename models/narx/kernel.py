"""One network sample by sample, in numba: its free run, and what its weights do to that run.

Signals are scaled: ``level`` is OP and ``position`` is MV, both in units of ``se``; ``move`` is
``(v(t) - v(t-1)) / sd``. ``limits`` = lowest and highest error, increment and position, and
``ratio`` = se / sd. ``edge`` is the network's, in units of sd. Weights (P,) are value, gate,
hidden, flattened.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from stemwatch.models.narx.plan import Indices, Plan
from stemwatch.models.recording import Floats

_Limits = tuple[float, float, float, float, float, float]
_TOGETHER = 4  # rows of the Jacobian that are squared at once


@njit(cache=True)
def _tanh(x: float) -> float:
    """Right to 3e-16 and twice as quick as the library's; beyond 355 the exponential is inf."""
    return 1.0 - 2.0 / (math.exp(2.0 * x) + 1.0)


@njit(cache=True)
def _outputs(weights: Floats, hidden: int, units: Floats) -> tuple[float, float]:
    """The value and the gate's share, 0 to 1; ``units`` (H + 5,) = ``[h, x, 1]`` gets its ``h``."""
    gate = hidden + 5
    rows = gate + hidden + 1
    opening = weights[rows - 1]
    for unit in range(hidden):
        row = rows + 5 * unit
        total = weights[row + 4]
        for at in range(4):
            total += weights[row + at] * units[hidden + at]
        units[unit] = _tanh(total)
        opening += weights[gate + unit] * units[unit]
    value = 0.0
    for at in range(gate):
        value += weights[at] * units[at]
    return value, 0.5 * (1.0 + _tanh(0.5 * opening))


@njit(cache=True)
def free_run(
    weights: Floats,
    hidden: int,
    level: Floats,
    move: Floats,
    position: Floats,
    plan: Plan,
    codes: tuple[int, int, int],
    limits: _Limits,
    ratio: float,
    edge: float,
    out: Floats,
) -> None:
    """Fill ``out`` (m, n) with each member's run; ``weights`` (m, P).

    ``plan`` (n,) says of each sample to ``skip`` it, ``seed`` the run from the measurement, ``run``
    on, or ``restart`` from the two measurements before it; ``codes`` are the numbers standing for
    seed, run and restart. What is skipped is left as it is.
    """
    seed, run, restart = codes
    error_low, error_high, slowest, fastest, low, high = limits
    units = np.ones(hidden + 5)
    for member in range(weights.shape[0]):
        before, last = 0.0, 0.0
        for t in range(level.shape[0]):
            if plan[t] == seed:
                new = position[t]
            elif plan[t] == run or plan[t] == restart:
                if plan[t] == restart:
                    before, last = position[t - 2], position[t - 1]
                drift = ratio * (last - before)
                units[hidden] = min(max(level[t] - last, error_low), error_high)
                units[hidden + 1] = move[t]
                units[hidden + 2] = drift
                # Which way command and stem go, however slowly: 1 where both go up.
                units[hidden + 3] = 0.5 * (_tanh(move[t] / edge) + _tanh(drift / edge))
                value, share = _outputs(weights[member], hidden, units)
                new = last + min(max(share * value, slowest), fastest)
                new = min(max(new, low), high)
            else:
                continue
            out[member, t] = new
            before, last = last, new


@njit(cache=True)
def normal_matrix(
    weights: Floats,
    hidden: int,
    level: Floats,
    move: Floats,
    position: Floats,
    runs: tuple[Indices, Indices],
    limits: _Limits,
    ratio: float,
    edge: float,
    steepest: float,
    most: float,
    out: Floats,
) -> bool:
    """Fill ``out`` (P + 1, P + 1): ``J'J``, with ``J'r`` in the last column and row, and ``r'r``.

    The same as ``sensitivities.normal_matrix``, of one network and with no Jacobian kept.
    ``weights`` (P,). ``runs``: the first samples and the lengths of free runs, each from the two
    measurements before it. Derivatives are held within ``steepest``. Returns False, and leaves
    ``out`` unfinished, as soon as ``r'r`` is above ``most`` or no number.
    """
    size = weights.shape[0]
    starts, lengths = runs
    units, rows = np.ones(hidden + 5), np.zeros((_TOGETHER, size + 1))
    out[:, :] = 0.0
    squares, at = 0.0, 0
    for run in range(starts.size):
        first = starts[run]
        before, last = position[first - 2], position[first - 1]
        for t in range(first, first + lengths[run]):
            units[hidden + 1] = move[t]
            row = rows[at]
            new, d1, d2 = _derivatives(
                weights, hidden, level[t], before, last, limits, ratio, edge, units, row
            )
            if t > first:  # two samples back there is no run yet at the second one
                d2 = d2 if t > first + 1 else 0.0
                _carry(row, d1, rows[at - 1], d2, rows[at - 2], steepest)
            residual = new - position[t]
            row[size] = residual
            squares += residual * residual
            if not squares <= most:
                return False
            at += 1
            if at == _TOGETHER:
                _add_squares(rows, out)
                at = 0
            before, last = last, new
    rows[at:] = 0.0
    _add_squares(rows, out)
    return True


@njit(cache=True)
def _derivatives(
    weights: Floats,
    hidden: int,
    level: float,
    before: float,
    last: float,
    limits: _Limits,
    ratio: float,
    edge: float,
    units: Floats,
    row: Floats,
) -> tuple[float, float, float]:
    """One step: the new position, and its derivative by the last two; those by the weights go to
    ``row`` (P + 1,). ``units`` (H + 5,) holds the move and 1, the rest of it is filled here."""
    error_low, error_high, slowest, fastest, low, high = limits
    error = level - last
    units[hidden] = min(max(error, error_low), error_high)
    units[hidden + 2] = ratio * (last - before)
    drifting = _tanh(units[hidden + 2] / edge)
    units[hidden + 3] = 0.5 * (_tanh(units[hidden + 1] / edge) + drifting)
    value, share = _outputs(weights, hidden, units)
    step = share * value
    raw = last + min(max(step, slowest), fastest)
    live = 1.0 if low <= raw <= high else 0.0
    by_value = share * live if slowest <= step <= fastest else 0.0
    by_error, by_drift, by_consensus = _backwards(
        weights, hidden, units, by_value, by_value * value * (1.0 - share), row
    )
    by_drift += by_consensus * (1.0 - drifting * drifting) * 0.5 / edge
    d2 = -by_drift * ratio
    held = by_error if error_low <= error <= error_high else 0.0
    return min(max(raw, low), high), live - held - d2, d2


@njit(cache=True)
def _backwards(
    weights: Floats, hidden: int, units: Floats, by_value: float, by_gate: float, row: Floats
) -> tuple[float, float, float]:
    """From what value and gate do to the step to what the weights do, in ``row``, and what error,
    drift and consensus do."""
    gate = hidden + 5
    rows = gate + hidden + 1
    for at in range(gate):
        row[at] = by_value * units[at]
    row[rows - 1] = by_gate
    by_error = by_value * weights[hidden]
    by_drift = by_value * weights[hidden + 2]
    by_consensus = by_value * weights[hidden + 3]
    for unit in range(hidden):
        row[gate + unit] = by_gate * units[unit]
        inwards = rows + 5 * unit
        through = by_value * weights[unit] + by_gate * weights[gate + unit]
        through *= 1.0 - units[unit] * units[unit]
        by_error += through * weights[inwards]
        by_drift += through * weights[inwards + 2]
        by_consensus += through * weights[inwards + 3]
        for at in range(5):
            row[inwards + at] = through * units[hidden + at]
    return by_error, by_drift, by_consensus


@njit(cache=True)
def _carry(row: Floats, d1: float, held: Floats, d2: float, older: Floats, steepest: float) -> None:
    """``s(t) = g(t) + d1 s(t-1) + d2 s(t-2)``, in place of ``g(t)`` in ``row``."""
    for at in range(row.shape[0]):
        carried = row[at] + d1 * held[at] + d2 * older[at]
        carried = -steepest if carried < -steepest else carried
        row[at] = steepest if carried > steepest else carried


@njit(cache=True)
def _add_squares(rows: Floats, out: Floats) -> None:
    """Add ``rows' rows`` to ``out``; four at once need a quarter of the loads and stores."""
    a, b, c, d = rows[0], rows[1], rows[2], rows[3]
    for i in range(out.shape[0]):
        by_a, by_b, by_c, by_d = a[i], b[i], c[i], d[i]
        line = out[i]
        for j in range(line.shape[0]):
            line[j] += by_a * a[j] + by_b * b[j] + by_c * c[j] + by_d * d[j]
