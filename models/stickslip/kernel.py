"""Compiled kernels of the valve: dead time, actuator, rate limit, stick-slip, position reading.

The stick-slip element is the *canonical* reading of Choudhury, Thornhill and Shah (2005,
doi:10.1016/j.conengprac.2004.05.005): two friction levels ``fs = (S + J)/2`` (breakaway) and
``fd = (S - J)/2`` (sliding), the force on the stem is ``F = p - x``; a stuck stem breaks away when
``|F| > fs`` and then follows ``p - d fd`` until the force turns. It is the same element as Kano's
(2004), and it has no memory of where it stopped, so that noise on the command does not reset the
accumulated force.

In front of it stands the actuator: a dead time, a first-order lag and a speed limit, which may
differ by direction. At their neutral values (0, 0, inf) the chain *is* the canonical element.
``RESTICK`` (%/s) is the speed of the actuator below which a moving stem sticks again: 0 is the
canonical element (it sticks when the command holds or turns), infinity is He's model (2007: it
sticks at every sample), and anything negative lets only a command that turns stop the stem, for
coarsely recorded commands that seem to hold where the true one does not::

    OP --dead time--> uc --lag, rate limit--> p --stick-slip--> x --gain, zero--> MV

A search runs many candidates over one recording, side by side, one lane each, sample by sample: one
recursion alone waits for its own last result, while ``LANES`` of them use the processor's vector
units. The loops over lanes therefore have no branches.
"""

from __future__ import annotations

from typing import cast

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.compiled import compiled
from stemwatch.models.recording import Floats

# Order of the parameter vector (n_parameters,) of every kernel here.
S, J, DEAD_TIME_S, LAG_UP_S, LAG_DOWN_S, RATE_UP, RATE_DOWN, ZERO, GAIN, RESTICK = range(10)
N_PARAMETERS = 10

# What is taken from the measurement at a sample.
START, RESYNC = 1, 2
Marks = NDArray[np.uint8]

LANES = 16
_VECTOR = 4  # numbers in a vector; lanes are filled up to a multiple of it
# Rows of the lanes' state. Unsigned, as are all indices of lanes: the compiler then sees that rows
# do not overlap, and vectorises.
(
    _P,
    _X,
    _D,
    _MOVING,
    _FS,
    _FD,
    _A_UP,
    _A_DN,
    _MOST_UP,
    _MOST_DN,
    _RESTICK,
    _ZERO,
    _GAIN,
    _PRODUCT,
) = [np.uint64(row * LANES) for row in range(14)]
_STATE = 14 * LANES
# Samples between two checks of the lanes' products, and the limits that keep these finite until
# then.
_TOGETHER, _LARGE, _LARGEST = 16, 1e100, 1e12
# numba types a plain 0 as the literal 0, so all that is called with it would be compiled twice.
_I = cast("type[int]", np.int64)


@compiled()
def _constants(q: Floats, dt: float) -> tuple[float, float, float, float, float, float, int, float]:
    """Constants of a run: levels, smoothing factors, largest steps, delay whole and fraction."""
    fs = 0.5 * (q[0] + q[1])
    fd = 0.5 * (q[0] - q[1])
    a_up = 1.0 - np.exp(-dt / q[3]) if q[3] > 1e-3 else 1.0
    a_dn = 1.0 - np.exp(-dt / q[4]) if q[4] > 1e-3 else 1.0
    whole_samples = int(q[2] / dt)
    return fs, fd, a_up, a_dn, q[5] * dt, q[6] * dt, whole_samples, q[2] / dt - whole_samples


@compiled()
def _advance(
    p: float,
    x: float,
    d: float,
    moving: float,
    uc: float,
    fs: float,
    fd: float,
    a_up: float,
    a_dn: float,
    most_up: float,
    most_dn: float,
    restick: float,
) -> tuple[float, float, float, float]:
    """One sample: the actuator ``p`` follows ``uc``, the stem ``x`` sticks or slides after it.

    ``moving`` is 1 or 0.
    """
    error = uc - p
    step = error * (a_up if error > 0.0 else a_dn)
    step = -most_dn if step < -most_dn else step
    step = most_up if step > most_up else step
    p += step
    # The step is compared, not the difference of p: without a lag the two differ by rounding, and a
    # held command must stop the stem.
    slides = moving if d * step > restick else 0.0
    force = p - x
    breaks = 1.0 if abs(force) > fs else 0.0
    side = 1.0 if force > 0.0 else -1.0
    side = side if breaks > 0.0 else d
    d = d if slides > 0.0 else side
    moving = 1.0 if slides + breaks > 0.0 else 0.0
    dragged = p - d * fd
    x = dragged if moving > 0.0 else x
    return p, x, d, moving


@compiled()
def _resting_stem(op: float, mv: float, fs: float, zero: float, gain: float) -> float:
    """Stem position by the measurement, moved into the stick band around the actuator."""
    return min(max((mv - zero) / gain, op - abs(fs)), op + abs(fs))


@compiled()
def simulate(op: Floats, mv: Floats, start: Marks, dt: float, q: Floats, out: Floats) -> None:
    """Free run of the chain over ``op`` (n,) into ``out`` (n,), percent.

    ``start`` (n,) marks samples at which something is taken from the measurement ``mv``: START the
    whole state (the first sample, and the first after a gap), RESYNC only the place where a resting
    stem rests. ``q`` (10,) are the parameters in the order above. ``op`` must be finite; holes are
    bridged before.
    """
    fs, fd, a_up, a_dn, most_up, most_dn, whole_samples, late = _constants(q, dt)
    restick = q[9] * dt
    p, x, d, moving, first = op[0], op[0], 1.0, 0.0, 0
    for k in range(op.size):
        if start[k] == START:
            first, p, d, moving = k, op[k], 1.0, 0.0
            x = _resting_stem(op[k], mv[k], fs, q[7], q[8])
        else:
            i = max(k - whole_samples, first)
            uc = op[i] + late * (op[max(i - 1, first)] - op[i])
            if start[k] == RESYNC and moving == 0.0:
                x = _resting_stem(p, mv[k - 1], fs, q[7], q[8])
            p, x, d, moving = _advance(
                p, x, d, moving, uc, fs, fd, a_up, a_dn, most_up, most_dn, restick
            )
        out[k] = q[8] * x + q[7]


@compiled()
def block_losses(
    op: Floats,
    mv: Floats,
    start: Marks,
    block: NDArray[np.int64],
    dt: float,
    delta: float,
    candidates: Floats,
    losses: Floats,
    counts: Floats,
) -> None:
    """Robust loss of each candidate in each block of time, and nothing else.

    ``candidates`` (m, 10); ``block`` (n,) int64 is the block number of a sample, negative where it
    is not scored; ``losses`` (m, n_blocks) receives the sums of the Cauchy loss
    ``delta^2 log(1 + (r/delta)^2)`` with ``r = MV - simulated`` (``(r/delta)^2`` no larger than
    1e12); ``counts`` (n_blocks,) the number of samples scored. No output array is written, and
    nothing is run beyond the last sample scored, so a candidate costs only the recursion.
    """
    counts[:] = 0.0
    losses[:] = 0.0
    until = 0
    for k in range(op.size):
        if block[k] >= 0:
            counts[block[k]] += 1.0
            until = k + 1
    state, commands = np.empty(_STATE), np.zeros((_TOGETHER, LANES))
    for first in range(0, candidates.shape[0], LANES):
        last = min(first + LANES, candidates.shape[0])
        chosen, rows = candidates[first:last], losses[first:last]
        _lay_out(op[0], chosen, dt, state)
        _score(op, mv, start, block[:until], dt, delta, chosen, state, commands, rows)


@compiled()
def _lay_out(begin: float, candidates: Floats, dt: float, state: Floats) -> None:
    """Copy candidates (at most LANES, 10) into their lanes; spare lanes repeat the last one."""
    for lane in range(LANES):
        q = candidates[min(lane, candidates.shape[0] - 1)]
        fs, fd, a_up, a_dn, most_up, most_dn, _, _ = _constants(q, dt)
        numbers = (begin, begin, 1.0, 0.0, fs, fd, a_up, a_dn, most_up, most_dn, q[9] * dt)
        for row in range(len(numbers)):
            state[row * LANES + lane] = numbers[row]
        state[_ZERO + np.uint64(lane)], state[_GAIN + np.uint64(lane)] = q[7], q[8]
        state[_PRODUCT + np.uint64(lane)] = 1.0


@compiled()
def _score(
    op: Floats,
    mv: Floats,
    start: Marks,
    block: NDArray[np.int64],
    dt: float,
    delta: float,
    candidates: Floats,
    state: Floats,
    commands: Floats,
    losses: Floats,
) -> None:
    """Run one group of lanes over the samples of ``block``, a few at a time."""
    scale, until = 1.0 / (delta * delta), block.size
    lanes = -(-candidates.shape[0] // _VECTOR) * _VECTOR
    late = _any_above(candidates[:, DEAD_TIME_S], 0.0)
    k, first, current = _I(0), _I(0), _I(-1)
    while k < until:
        if block[k] != current or _any_above(state[-LANES:], _LARGE):
            _settle(state, losses, current, scale)
            current = block[k]
        weight = scale if current >= 0 else 0.0
        if start[k] == START:
            first = k
            _restart(op[k], mv[k], weight, lanes, state)
            k += 1
            continue
        if start[k] == RESYNC:
            _resync(mv[k - 1], lanes, state)
        end = k + 1
        while end < min(k + _TOGETHER, until) and start[end] == 0 and block[end] == current:
            end += 1
        if late:
            _delay(op, first, k, end, dt, candidates, commands)
        else:
            for index in range(end - k):
                commands[index, :] = op[k + index]
        _advance_lanes(mv[k:end], commands, weight, lanes, state)
        k = end
    _settle(state, losses, current, scale)


@compiled()
def _any_above(values: Floats, limit: float) -> bool:
    """Whether one of ``values`` is above ``limit``; NumPy's own would take longer to compile."""
    any_above = False
    for value in values:
        any_above |= value > limit
    return any_above


@compiled()
def _settle(state: Floats, losses: Floats, block: int, scale: float) -> None:
    """Add the logarithm of each lane's product of ``1 + (r/delta)^2`` to its loss in ``block``, if
    that is one; one logarithm serves many samples."""
    products = state[-LANES:]
    if block >= 0:
        for lane in range(losses.shape[0]):
            losses[lane, block] += np.log(products[lane]) / scale
    products[:] = 1.0


@compiled()
def _restart(op: float, mv: float, weight: float, lanes: int, s: Floats) -> None:
    """At a START: set the whole state from the measurement."""
    for i in range(np.uint64(lanes)):
        zero, gain = s[_ZERO + i], s[_GAIN + i]
        x = _resting_stem(op, mv, s[_FS + i], zero, gain)
        s[_P + i], s[_X + i], s[_D + i], s[_MOVING + i] = op, x, 1.0, 0.0
        s[_PRODUCT + i] *= _charge(mv - (gain * x + zero), weight)


@compiled()
def _resync(mv: float, lanes: int, s: Floats) -> None:
    """At a RESYNC: set the place of a resting stem from the measurement before."""
    for i in range(np.uint64(lanes)):
        if s[_MOVING + i] == 0.0:
            s[_X + i] = _resting_stem(s[_P + i], mv, s[_FS + i], s[_ZERO + i], s[_GAIN + i])


@compiled()
def _delay(
    op: Floats, first: int, begin: int, end: int, dt: float, candidates: Floats, commands: Floats
) -> None:
    """Each candidate's command, late by its dead time, for samples ``begin`` to ``end``."""
    for lane in range(candidates.shape[0]):
        late = candidates[lane, DEAD_TIME_S] / dt
        whole_samples = int(late)
        late -= whole_samples
        if begin - whole_samples > first:
            earlier, later = op[begin - whole_samples - 1 :], op[begin - whole_samples :]
            for index in range(end - begin):
                commands[index, lane] = later[index] + late * (earlier[index] - later[index])
            continue
        for k in range(begin, end):
            i = max(k - whole_samples, first)
            commands[k - begin, lane] = op[i] + late * (op[max(i - 1, first)] - op[i])


@compiled()
def _charge(residual: float, weight: float) -> float:
    """The factor ``1 + (r/delta)^2`` of one ``residual``; ``weight`` = 1/delta^2."""
    share = residual * residual * weight
    return 1.0 + (share if share < _LARGEST else _LARGEST)


@compiled()
def _advance_lanes(mv: Floats, commands: Floats, weight: float, lanes: int, s: Floats) -> None:
    """Advance all lanes through some samples without a mark."""
    for k in range(mv.size):
        measured, command = mv[k], commands[k]
        for i in range(np.uint64(lanes)):
            zero, gain = s[_ZERO + i], s[_GAIN + i]
            p, x, d, moving = _advance(
                s[_P + i],
                s[_X + i],
                s[_D + i],
                s[_MOVING + i],
                command[i],
                s[_FS + i],
                s[_FD + i],
                s[_A_UP + i],
                s[_A_DN + i],
                s[_MOST_UP + i],
                s[_MOST_DN + i],
                s[_RESTICK + i],
            )
            s[_P + i], s[_X + i], s[_D + i], s[_MOVING + i] = p, x, d, moving
            s[_PRODUCT + i] *= _charge(measured - (gain * x + zero), weight)
