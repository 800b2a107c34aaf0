"""Free runs of networks in numba, and the derivatives of those runs by the weights.

Signals are scaled: ``level`` is OP and ``position`` is MV, both in units of ``se``; ``move`` is
``(v(t) - v(t-1)) / sd``. ``limits`` = lowest and highest error, increment and position, and
``ratio`` = se / sd. ``edge`` is the network's, in units of sd. Weights (P,) are value, gate,
hidden, flattened.

Each sample of a run needs the one before, so that one run alone leaves most of a processor idle.
Runs therefore advance side by side, one in each *lane*: the members of an ensemble over one signal,
or one network over many pieces of it. The state of all lanes is one array ``s``, row by row
(``s[_LAST + i]`` is the last position in lane ``i``), with the weights of each lane in its last
rows. Loops over the lanes choose values instead of branching, so that the compiler vectorises them.
It does so only for unsigned indices, for a single array, where everything is read before anything
is written, and where a division cannot raise (``error_model``).
"""

from __future__ import annotations

from typing import cast

import numpy as np

from stemwatch.models.compiled import compiled
from stemwatch.models.narx.run_plan import Indices, Plan
from stemwatch.models.recording import Floats

_Limits = tuple[float, float, float, float, float, float]
_Frame = tuple[_Limits, float, float]  # limits, ratio, edge
_U = np.uint64
# numba types a plain 0 as the literal 0, so all that is called with it would be compiled twice.
_I = cast("type[int]", np.int64)
_LANES = 16  # runs side by side at most
_VECTOR = 4  # lanes of one vector instruction; a remainder of lanes would run without vectors
# Rows of the lanes' array. First inputs and results of one step, ...
(_LEVEL, _MOVE, _BEFORE, _LAST, _ERROR, _DRIFT, _WAYS) = [_U(i * _LANES) for i in range(7)]
# ... without the clamps (_GAP the error, _FREE the position), and the tanh of the drift, ...
(_GAP, _DRIFTING, _VALUE, _SHARE, _FREE, _RESIDUAL) = [_U(i * _LANES) for i in range(7, 13)]
# ... then its derivatives: by value, gate, ways, and the last position and the one before.
(_BY_VALUE, _BY_GATE, _BY_WAYS, _BY_LAST, _BY_BEFORE) = [_U(i * _LANES) for i in range(13, 18)]
# After these: H rows of hidden units, H of the step's derivatives by their sums, P of weights.
_UNITS = 18
_ROW = _U(_LANES)
# Many rows of the Jacobian are squared at once by BLAS, which from this many multiplications on
# would use more than one thread.
_ON_ONE_THREAD = 2**18

# Cephes' exponential (S. L. Moshier): exp(r) = (even + odd) / (even - odd), |r| <= ln(2) / 2.
_ODD = (1.26177193074810590878e-4, 3.02994407707441961300e-2, 9.99999999999999999910e-1)
_EVEN = (3.00198505138664455042e-6, 2.52448340349684104192e-3, 2.27265548208155028766e-1, 2.0)
_PER_LN2 = 1.4426950408889634
_LN2_HIGH, _LN2_LOW = 6.93145751953125e-1, 1.42860682030941723212e-6
_TO_WHOLE = 1.5 * 2.0**52  # added to a number, leaves its nearest integer in the lowest bits
_ONE_FROM = 20.0  # tanh is 1 there, to the last digit
_BIAS, _FRACTION_BITS = 1023, 52


@compiled(error_model="numpy")
def _tanh(x: float) -> float:
    """``(exp(2x) - 1) / (exp(2x) + 1)``, right to 4e-16, with one division and no branch or call.

    ``2x = k ln(2) + r``; ``exp(r)`` stays a fraction, which saves a division.
    """
    x = -_ONE_FROM if x < -_ONE_FROM else x
    x = _ONE_FROM if x > _ONE_FROM else x
    shifted = _PER_LN2 * (2.0 * x) + _TO_WHOLE
    k = shifted - _TO_WHOLE
    r = 2.0 * x - k * _LN2_HIGH - k * _LN2_LOW
    rr = r * r
    odd_part = r * ((_ODD[0] * rr + _ODD[1]) * rr + _ODD[2])
    even = ((_EVEN[0] * rr + _EVEN[1]) * rr + _EVEN[2]) * rr + _EVEN[3]
    exponent = (np.float64(shifted).view(np.int64) + _BIAS) << _FRACTION_BITS
    numerator = np.int64(exponent).view(np.float64) * (even + odd_part)
    denominator = even - odd_part
    return (numerator - denominator) / (numerator + denominator)


@compiled(error_model="numpy")
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

    ``plan`` (n,) gives for each sample whether to ``skip`` it, ``seed`` the run from the
    measurement, ``run`` on, or ``restart`` from the two measurements before it; ``codes`` are the
    numbers of seed, run and restart. Skipped samples of ``out`` are not written.
    """
    seed, run, restart = codes
    frame = (limits, ratio, edge)
    for first in range(0, weights.shape[0], _LANES):
        members = min(_LANES, weights.shape[0] - first)
        s = _laid_out(weights[first : first + members], hidden)
        lanes = _whole_vectors(members)
        for t in range(level.shape[0]):
            if plan[t] == seed:
                for i in range(lanes):
                    s[_BEFORE + i] = s[_LAST + i]
                    s[_LAST + i] = position[t]
            elif plan[t] == run or plan[t] == restart:
                for i in range(lanes):
                    if plan[t] == restart:
                        s[_BEFORE + i], s[_LAST + i] = position[t - 2], position[t - 1]
                    s[_LEVEL + i], s[_MOVE + i] = level[t], move[t]
                _step(s, hidden, lanes, frame)
            else:
                continue
            for i in range(_U(members)):
                out[first + i, t] = s[_LAST + i]


@compiled(error_model="numpy")
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
    largest_squares: float,
    out: Floats,
) -> bool:
    """Fill ``out`` (P + 1, P + 1): ``J'J``, with ``J'r`` in the last column and row, and ``r'r``.

    The same as ``torch_batch.normal_matrix``, of one network and with no Jacobian kept.
    ``weights`` (P,). ``runs``: the first samples and the lengths of free runs, each from the two
    measurements before it; neighbours go side by side, so it is quick where they are of a length.
    Derivatives are held within ``steepest``. Returns False, and leaves ``out`` unfinished, as soon
    as ``r'r`` is above ``largest_squares`` or no number: no derivative is taken before all have
    run.
    """
    size, lengths, frame = weights.size, runs[1], (limits, ratio, edge)
    s = _laid_out(weights.reshape((1, size)), hidden)
    steps = 0
    for first in range(0, lengths.size, _LANES):
        steps += _longest(lengths[first : first + _LANES])
    states = np.empty((steps, (_UNITS + hidden) * _LANES))
    if not _run_all(s, hidden, (level, move, position), runs, frame, largest_squares, states):
        return False
    out[:, :] = 0.0
    lanes_together = max(_LANES, _ON_ONE_THREAD // (size + 1) ** 2)
    rows, carried = np.empty(lanes_together * (size + 1)), np.zeros(2 * _LANES * size)
    step, filled = _I(0), _I(0)
    for first in range(0, lengths.size, _LANES):
        lane_lengths = lengths[first : first + _LANES]
        for age in range(_longest(lane_lengths)):
            if filled + lane_lengths.size > lanes_together:
                _add_squares(rows, filled, out)
                filled = _I(0)
            for index in range(states.shape[1]):
                s[index] = states[step, index]
            _slopes(s, hidden, _whole_vectors(lane_lengths.size), frame)
            filled = _add_rows(s, hidden, lane_lengths, age, steepest, carried, rows, filled)
            step += 1
    _add_squares(rows, filled, out)
    return True


@compiled(error_model="numpy")
def _laid_out(weights: Floats, hidden: int) -> Floats:
    """The lanes' array, with the weights (m, P) of m lanes; the others get the first lane's."""
    members, size = weights.shape
    s = np.zeros((_UNITS + 2 * hidden + size) * _LANES)
    rows = s.reshape((-1, _LANES))[_UNITS + 2 * hidden :]
    for index in range(size):
        for lane in range(_LANES):
            rows[index, lane] = weights[lane if lane < members else 0, index]
    return s


@compiled()
def _longest(lengths: Indices) -> int:
    """The largest of ``lengths``, none negative; NumPy's own would take longer to compile."""
    longest = 0
    for length in lengths:
        longest = max(longest, length)
    return longest


@compiled()
def _whole_vectors(lanes: int) -> np.uint64:
    return _U((lanes + _VECTOR - 1) // _VECTOR * _VECTOR)


@compiled()
def _weight_rows(hidden: int) -> tuple[np.uint64, np.uint64, np.uint64, np.uint64]:
    """Where in the lanes' array value, the inputs' part of it, gate and hidden begin."""
    value = _ROW * _U(_UNITS + 2 * hidden)
    inputs = value + _ROW * _U(hidden)
    gate = inputs + _ROW * _U(5)
    return value, inputs, gate, gate + _ROW * _U(hidden + 1)


@compiled(error_model="numpy")
def _step(s: Floats, hidden: int, lanes: np.uint64, frame: _Frame) -> None:
    """Advance every lane by one sample, from level, move and the last two positions."""
    (error_low, error_high, slowest, fastest, low, high), ratio, edge = frame
    for i in range(lanes):
        gap = s[_LEVEL + i] - s[_LAST + i]
        drift = ratio * (s[_LAST + i] - s[_BEFORE + i])
        drifting = _tanh(drift / edge)
        moving = _tanh(s[_MOVE + i] / edge)
        error = error_low if gap < error_low else gap
        s[_GAP + i] = gap
        s[_ERROR + i] = error_high if error > error_high else error
        s[_DRIFT + i] = drift
        s[_DRIFTING + i] = drifting
        # Direction of command and stem, at any speed: 1 where both go up.
        s[_WAYS + i] = 0.5 * (moving + drifting)
    _outputs(s, hidden, lanes)
    for i in range(lanes):
        last = s[_LAST + i]
        step = s[_SHARE + i] * s[_VALUE + i]
        step = slowest if step < slowest else step
        step = fastest if step > fastest else step
        free = last + step
        new = low if free < low else free
        s[_BEFORE + i] = last
        s[_FREE + i] = free
        s[_LAST + i] = high if new > high else new


@compiled(error_model="numpy")
def _outputs(s: Floats, hidden: int, lanes: np.uint64) -> None:
    """The hidden units, the value and the gate's share, 0 to 1."""
    value, inputs, gate, row = _weight_rows(hidden)
    bias = gate + _ROW * _U(hidden)
    for i in range(lanes):
        s[_SHARE + i] = s[bias + i]
        s[_VALUE + i] = 0.0
    unit = _ROW * _U(_UNITS)
    for _ in range(hidden):
        by_move, by_drift, by_ways, bias = _next_four(row)
        for i in range(lanes):
            total = s[bias + i] + s[row + i] * s[_ERROR + i] + s[by_move + i] * s[_MOVE + i]
            total = total + s[by_drift + i] * s[_DRIFT + i] + s[by_ways + i] * s[_WAYS + i]
            h = _tanh(total)
            opening = s[_SHARE + i] + s[gate + i] * h
            sums = s[_VALUE + i] + s[value + i] * h
            s[unit + i] = h
            s[_SHARE + i] = opening
            s[_VALUE + i] = sums
        unit, value, gate, row = unit + _ROW, value + _ROW, gate + _ROW, bias + _ROW
    by_move, by_drift, by_ways, bias = _next_four(inputs)
    for i in range(lanes):
        total = s[_VALUE + i] + s[inputs + i] * s[_ERROR + i] + s[by_move + i] * s[_MOVE + i]
        total = total + s[by_drift + i] * s[_DRIFT + i] + s[by_ways + i] * s[_WAYS + i]
        share = 0.5 * (1.0 + _tanh(0.5 * s[_SHARE + i]))
        s[_VALUE + i] = total + s[bias + i]
        s[_SHARE + i] = share


@compiled()
def _next_four(row: np.uint64) -> tuple[np.uint64, np.uint64, np.uint64, np.uint64]:
    return row + _ROW, row + _ROW * _U(2), row + _ROW * _U(3), row + _ROW * _U(4)


@compiled(error_model="numpy")
def _run_all(
    s: Floats,
    hidden: int,
    signals: tuple[Floats, Floats, Floats],
    runs: tuple[Indices, Indices],
    frame: _Frame,
    largest_squares: float,
    states: Floats,
) -> bool:
    """Run every piece, and keep the state of the lanes at each step; returns False as
    ``normal_matrix``.
    """
    level, move, position = signals
    squares, step = 0.0, 0
    for first in range(0, runs[0].size, _LANES):
        starts, lane_lengths = runs[0][first : first + _LANES], runs[1][first : first + _LANES]
        lane_count, lanes = _U(lane_lengths.size), _whole_vectors(lane_lengths.size)
        for i in range(lane_count):
            s[_BEFORE + i], s[_LAST + i] = position[starts[i] - 2], position[starts[i] - 1]
        for age in range(_longest(lane_lengths)):
            for i in range(lane_count):
                if age < lane_lengths[i]:
                    s[_LEVEL + i], s[_MOVE + i] = level[starts[i] + age], move[starts[i] + age]
            _step(s, hidden, lanes, frame)
            for i in range(lane_count):
                if age < lane_lengths[i]:
                    residual = s[_LAST + i] - position[starts[i] + age]
                    s[_RESIDUAL + i] = residual
                    squares += residual * residual
            if not squares <= largest_squares:
                return False
            for index in range(states.shape[1]):
                states[step, index] = s[index]
            step += 1
    return True


@compiled(error_model="numpy")
def _slopes(s: Floats, hidden: int, lanes: np.uint64, frame: _Frame) -> None:
    """After a step: derivatives of the new position by value, gate, hidden sums and the last two
    positions.
    """
    (error_low, error_high, slowest, fastest, low, high), ratio, edge = frame
    value, inputs, gate, row = _weight_rows(hidden)
    by_drift, by_ways = inputs + _ROW * _U(2), inputs + _ROW * _U(3)
    for i in range(lanes):
        total, share, free = s[_VALUE + i], s[_SHARE + i], s[_FREE + i]
        step = share * total
        stopped = (step < slowest) | (step > fastest) | (free < low) | (free > high)
        by_value = 0.0 if stopped else share
        last, before, by_ways_before = s[inputs + i], s[by_drift + i], s[by_ways + i]
        s[_BY_VALUE + i] = by_value
        s[_BY_GATE + i] = by_value * total * (1.0 - share)
        s[_BY_LAST + i] = by_value * last
        s[_BY_BEFORE + i] = by_value * before
        s[_BY_WAYS + i] = by_value * by_ways_before
    unit = _ROW * _U(_UNITS)
    through = unit + _ROW * _U(hidden)
    for _ in range(hidden):
        _, by_drift, by_ways, bias = _next_four(row)
        for i in range(lanes):
            h = s[unit + i]
            by_sum = s[_BY_VALUE + i] * s[value + i] + s[_BY_GATE + i] * s[gate + i]
            by_sum = by_sum * (1.0 - h * h)
            last = s[_BY_LAST + i] + by_sum * s[row + i]
            before = s[_BY_BEFORE + i] + by_sum * s[by_drift + i]
            by_ways_before = s[_BY_WAYS + i] + by_sum * s[by_ways + i]
            s[through + i] = by_sum
            s[_BY_LAST + i] = last
            s[_BY_BEFORE + i] = before
            s[_BY_WAYS + i] = by_ways_before
        unit, through, value, gate = unit + _ROW, through + _ROW, value + _ROW, gate + _ROW
        row = bias + _ROW
    for i in range(lanes):
        drifting, gap, free = s[_DRIFTING + i], s[_GAP + i], s[_FREE + i]
        by_ways, by_error = s[_BY_WAYS + i], s[_BY_LAST + i]
        by_drift = s[_BY_BEFORE + i] + by_ways * (1.0 - drifting * drifting) * 0.5 / edge
        by_error = 0.0 if (gap < error_low) | (gap > error_high) else by_error
        live = 0.0 if (free < low) | (free > high) else 1.0
        before = -by_drift * ratio
        s[_BY_LAST + i] = live - by_error - before
        s[_BY_BEFORE + i] = before


@compiled()
def _add_rows(
    s: Floats,
    hidden: int,
    lengths: Indices,
    age: int,
    steepest: float,
    carried: Floats,
    rows: Floats,
    filled: int,
) -> int:
    """Append a row of the Jacobian for each lane still running to the ``filled`` ones; returns the
    new count.

    ``s(t) = g(t) + d1 s(t-1) + d2 s(t-2)``; ``carried`` has the last two ``s`` of every lane.
    """
    size = _U(carried.size // (2 * _LANES))
    width, lane_count = size + _U(1), _U(lengths.size)
    begin = _U(filled) * width
    column = begin
    for i in range(lane_count):
        if age < lengths[i]:
            _gradient(s, hidden, i, rows, column)
            rows[column + size] = s[_RESIDUAL + i]
            column += width
            filled += 1
    older = _U(age % 2) * _ROW * size
    last = _ROW * size - older
    # The first samples of a run have no earlier sensitivities.
    has_last, known_before = 1.0 if age > 0 else 0.0, 1.0 if age > 1 else 0.0
    bound = steepest if age > 0 else np.inf
    column = begin
    for i in range(lane_count):
        if age < lengths[i]:
            d1, d2 = has_last * s[_BY_LAST + i], known_before * s[_BY_BEFORE + i]
            _carry(rows, column, d1, carried, last + i * size, d2, older + i * size, size, bound)
            column += width
    return filled


@compiled()
def _gradient(s: Floats, hidden: int, i: int, rows: Floats, column: np.uint64) -> None:
    """Derivatives of one step of lane ``i`` by the weights, into ``rows`` from ``column`` on."""
    by_value, by_gate = s[_BY_VALUE + i], s[_BY_GATE + i]
    error, move, drift, way_slope = s[_ERROR + i], s[_MOVE + i], s[_DRIFT + i], s[_WAYS + i]
    units = _U(hidden)
    gate = column + units + _U(5)
    unit = _ROW * _U(_UNITS) + i
    for k in range(units):
        rows[column + k] = by_value * s[unit]
        rows[gate + k] = by_gate * s[unit]
        unit += _ROW
    rows[gate + units] = by_gate
    _by_inputs(rows, column + units, by_value, error, move, drift, way_slope)
    for k in range(units):
        _by_inputs(rows, gate + units + _U(1) + k * _U(5), s[unit], error, move, drift, way_slope)
        unit += _ROW


@compiled()
def _by_inputs(
    rows: Floats,
    column: np.uint64,
    slope: float,
    error: float,
    move: float,
    drift: float,
    way_slope: float,
) -> None:
    rows[column] = slope * error
    rows[column + _U(1)] = slope * move
    rows[column + _U(2)] = slope * drift
    rows[column + _U(3)] = slope * way_slope
    rows[column + _U(4)] = slope


@compiled()
def _carry(
    rows: Floats,
    row: np.uint64,
    d1: float,
    carried: Floats,
    last: np.uint64,
    d2: float,
    older: np.uint64,
    size: np.uint64,
    bound: float,
) -> None:
    """Carry one row of sensitivities on; it replaces the ``older`` of the two rows it
    depends on.
    """
    for k in range(size):
        value = rows[row + k] + d1 * carried[last + k] + d2 * carried[older + k]
        value = -bound if value < -bound else value
        value = bound if value > bound else value
        rows[row + k] = value
        carried[older + k] = value


@compiled()
def _add_squares(rows: Floats, filled: int, out: Floats) -> None:
    """Add ``rows' rows`` of the filled rows to ``out``."""
    width = out.shape[0]
    part = rows[: filled * width].reshape((filled, width))
    squares = np.dot(part.T, part)
    for i in range(width):  # by hand: adding arrays would compile numba's error about shapes too
        for j in range(width):
            out[i, j] += squares[i, j]
