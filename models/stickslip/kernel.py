"""Compiled kernels of the valve: dead time, actuator, rate limit, stick-slip, position reading.

The stick-slip element is the *canonical* reading of Choudhury, Thornhill and Shah (2005): two
friction levels ``fs = (S + J)/2`` (breakaway) and ``fd = (S - J)/2`` (sliding), the force on the
stem is ``F = p - x``; a stuck stem breaks away when ``|F| > fs`` and then follows ``p - d fd``
until the force turns. It is the same element as Kano's (2004), and it has no memory of where it
stopped, so that noise on the command does not reset the accumulated force.

In front of it stands the actuator: a dead time, a first-order lag and a speed limit, which may
differ by direction. At their neutral values (0, 0, inf) the chain *is* the canonical element.
``RESTICK`` (%/s) is the speed of the actuator below which a moving stem sticks again: 0 is the
canonical element (it sticks when the command holds or turns), infinity is He's model (2007: it
sticks at every sample), and anything negative lets only a command that turns stop the stem, for
coarsely recorded commands that seem to hold where the true one does not::

    OP --dead time--> uc --lag, rate limit--> p --stick-slip--> x --gain, zero--> MV

Compiled kernels and all that they call stay in this file: numba's disk cache does not notice a
change elsewhere.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from stemwatch.models.recording import Floats

# Order of the parameter vector (n_parameters,) of every kernel here.
S, J, DEAD_TIME_S, LAG_UP_S, LAG_DOWN_S, RATE_UP, RATE_DOWN, ZERO, GAIN, RESTICK = range(10)
N_PARAMETERS = 10

# What is taken from the measurement at a sample.
START, RESYNC = 1, 2
Marks = NDArray[np.uint8]


@njit(cache=True)
def _constants(q: Floats, dt: float) -> tuple[float, float, float, float, float, float, int, float]:
    """What a run needs per sample: levels, smoothing factors, steps, delay whole and fraction."""
    fs = 0.5 * (q[0] + q[1])
    fd = 0.5 * (q[0] - q[1])
    a_up = 1.0 - np.exp(-dt / q[3]) if q[3] > 1e-3 else 1.0
    a_dn = 1.0 - np.exp(-dt / q[4]) if q[4] > 1e-3 else 1.0
    whole = int(q[2] / dt)
    return fs, fd, a_up, a_dn, q[5] * dt, q[6] * dt, whole, q[2] / dt - whole


@njit(cache=True)
def _advance(
    p: float,
    x: float,
    d: float,
    moving: bool,
    uc: float,
    fs: float,
    fd: float,
    a_up: float,
    a_dn: float,
    most_up: float,
    most_dn: float,
    restick: float,
) -> tuple[float, float, float, bool]:
    """One sample: the actuator ``p`` follows ``uc``, the stem ``x`` sticks or slides after it."""
    error = uc - p
    step = min(max(error * (a_up if error > 0.0 else a_dn), -most_dn), most_up)
    p += step
    # The step is compared, not the difference of p: without a lag they differ by rounding, and a
    # command that is held must stop the stem.
    if moving and d * step <= restick:
        moving = False
    force = p - x
    if not moving and abs(force) > fs:
        moving = True
        d = 1.0 if force > 0.0 else -1.0
    if moving:
        x = p - d * fd
    return p, x, d, moving


@njit(cache=True)
def _rest(op: float, mv: float, fs: float, zero: float, gain: float) -> float:
    """Stem position by the measurement, but within the stick band around the actuator."""
    return min(max((mv - zero) / gain, op - abs(fs)), op + abs(fs))


@njit(cache=True)
def simulate(op: Floats, mv: Floats, start: Marks, dt: float, q: Floats, out: Floats) -> None:
    """Free run of the chain over ``op`` (n,) into ``out`` (n,), percent.

    ``start`` (n,) marks samples at which something is taken from the measurement ``mv``: START the
    whole state (the first sample, and the first after a gap), RESYNC only the place where a resting
    stem rests. ``q`` (10,) are the parameters in the order above. ``op`` must be finite; holes are
    bridged before.
    """
    fs, fd, a_up, a_dn, most_up, most_dn, whole, late = _constants(q, dt)
    restick = q[9] * dt
    p, x, d, moving, first = op[0], op[0], 1.0, False, 0
    for k in range(op.size):
        if start[k] == START:
            first, p, d, moving = k, op[k], 1.0, False
            x = _rest(op[k], mv[k], fs, q[7], q[8])
        else:
            i = max(k - whole, first)
            uc = op[i] + late * (op[max(i - 1, first)] - op[i])
            if start[k] == RESYNC and not moving:
                x = _rest(p, mv[k - 1], fs, q[7], q[8])
            p, x, d, moving = _advance(
                p, x, d, moving, uc, fs, fd, a_up, a_dn, most_up, most_dn, restick
            )
        out[k] = q[8] * x + q[7]


@njit(cache=True)
def block_losses(  # noqa: C901  # one loop without calls is what makes it fast
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
    ``delta^2 log(1 + (r/delta)^2)`` with ``r = MV - simulated``; ``counts`` (n_blocks,) the number
    of samples scored. No output array is written, so a candidate costs only the recursion.
    """
    counts[:] = 0.0
    losses[:] = 0.0
    for k in range(op.size):
        if block[k] >= 0:
            counts[block[k]] += 1.0
    scale = 1.0 / (delta * delta)
    for m in range(candidates.shape[0]):
        q = candidates[m]
        fs, fd, a_up, a_dn, most_up, most_dn, whole, late = _constants(q, dt)
        zero, gain, restick = q[7], q[8], q[9] * dt
        p, x, d, moving, first = op[0], op[0], 1.0, False, 0
        # One logarithm serves many samples: the logarithm of the product of 1 + (r/delta)^2.
        product, current = 1.0, -1
        for k in range(op.size):
            if start[k] == START:
                first, p, d, moving = k, op[k], 1.0, False
                x = _rest(op[k], mv[k], fs, zero, gain)
            else:
                i = max(k - whole, first)
                uc = op[i] + late * (op[max(i - 1, first)] - op[i])
                if start[k] == RESYNC and not moving:
                    x = _rest(p, mv[k - 1], fs, zero, gain)
                p, x, d, moving = _advance(
                    p, x, d, moving, uc, fs, fd, a_up, a_dn, most_up, most_dn, restick
                )
            b = block[k]
            if b < 0:
                continue
            if b != current or product > 1e200:
                if current >= 0:
                    losses[m, current] += np.log(product) / scale
                product, current = 1.0, b
            r = mv[k] - (gain * x + zero)
            product *= 1.0 + r * r * scale
        if current >= 0:
            losses[m, current] += np.log(product) / scale
