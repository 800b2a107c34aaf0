"""Compiled kernels of a control loop: the process behind the valve, and the loop closed around
it."""

from __future__ import annotations

import math

from stemwatch.models.compiled import compiled
from stemwatch.models.recording import Floats

# Order of the numbers of a loop (N_NUMBERS,) for ``run_loop``. Times in samples.
(
    GAIN_PV,  # OP per unit of PV, of the controller
    GAIN_SP,
    PER_SAMPLE,  # OP per unit of SP - PV and sample: the controller's integral action
    GAIN_CHANGE,  # OP per unit of PV's change since the last sample
    OP_LOW,
    OP_HIGH,
    S,
    J,
    VALVE_DELAY,
    VALVE_LAG_UP,
    VALVE_LAG_DOWN,
    VALVE_SPEED_UP,  # percent a sample
    VALVE_SPEED_DOWN,
    PROCESS_GAIN,
    PROCESS_LAG,
    SECOND_LAG,
    PROCESS_DELAY,
    INTEGRATES,  # 1 for an integrating process
    KNOCK,  # height of a knocker's pulses, percent of OP
    KNOCK_EVERY,
    KNOCK_FOR,
) = range(21)
N_NUMBERS = 21


@compiled()
def _share(lag: float) -> float:
    """What a first-order lag of so many samples moves in one."""
    return 1.0 if lag <= 1e-6 else 1.0 - math.exp(-1.0 / lag)


@compiled()
def _late(values: Floats, k: int, delay: float) -> float:
    """``values`` at ``delay`` samples before ``k``, interpolated linearly between two samples."""
    whole = int(delay)
    later: float = values[max(k - whole, 0)]
    earlier: float = values[max(k - whole - 1, 0)]
    return later + (delay - whole) * (earlier - later)


@compiled()
def process_answer(
    x: Floats, lag: float, second_lag: float, delay: float, integrates: bool, out: Floats
) -> None:
    """PV's answer of gain 1 to the valve ``x`` (n,), from rest at its first value, into ``out``
    (n,): a delay, a lag or an integral, a second lag. A sample's valve acts from the next on."""
    share, second = _share(lag), _share(second_lag)
    first, behind = 0.0, 0.0
    for k in range(x.size):
        out[k] = behind
        driven = _late(x, k, delay) - x[0]
        first += driven if integrates else share * (driven - first)
        behind += second * (first - behind)


@compiled()
def whitened(values: Floats, weights: Floats, out: Floats) -> None:
    """``values`` (n,) minus their prediction by ``weights`` (p,) of the samples before, into
    ``out``.
    """
    for k in range(values.size):
        left = values[k]
        for i in range(weights.size):
            left -= weights[i] * values[max(k - 1 - i, 0)]
        out[k] = left


@compiled()
def later_costs(answer: Floats, pv: Floats, delays: Floats, out: Floats) -> None:
    """What a process leaves of ``pv`` where its answer comes later by whole samples, into ``out``
    (d,): the sum of squares, with the gain that makes it least.

    ``answer`` (n,) is the whitened answer without a delay, which is 0 before its first sample;
    ``pv`` (m,) the last samples of the whitened PV, less their mean; ``delays`` (d,) in samples.
    """
    first, whole = answer.size - pv.size, 0.0
    for k in range(pv.size):
        whole += pv[k] * pv[k]
    for place in range(delays.size):
        late = int(delays[place])
        total, squares, with_pv = 0.0, 0.0, 0.0
        for k in range(max(late - first, 0), pv.size):
            moved = answer[first + k - late]
            total += moved
            squares += moved * moved
            with_pv += moved * pv[k]
        # PV has a mean of 0, so that of the answer is of no account in their product.
        spread = squares - total * total / pv.size
        out[place] = whole - with_pv * with_pv / max(spread, 1e-30)


@compiled()
def run_loop(
    set_point: Floats,
    disturbance: Floats,
    rest: Floats,
    numbers: Floats,
    begin: Floats,
    levels: Floats,
    op: Floats,
    x: Floats,
    pv: Floats,
) -> None:
    """Simulate the closed loop into ``op``, ``x`` and ``pv`` (n,).

    ``disturbance`` (n,) is the part of PV that the valve does not cause, ``rest`` (n,) the part of
    OP outside of the controller's law, ``begin`` OP and position at the first sample. The valve is
    the canonical stick-slip element behind its actuator (``stickslip.kernel``); its breakaway
    levels are ``levels`` (m,) in turn, times (S + J)/2.
    """
    q = numbers
    breaks, slides = 0.5 * (q[S] + q[J]), 0.5 * (q[S] - q[J])
    up, down = _share(q[VALVE_LAG_UP]), _share(q[VALVE_LAG_DOWN])
    share, second = _share(q[PROCESS_LAG]), _share(q[SECOND_LAG])
    first, behind, integral = 0.0, 0.0, 0.0
    actuator = begin[0]
    stem = min(max(begin[1], begin[0] - breaks), begin[0] + breaks)
    way, moving, turned, breakaway = 1.0, False, 1.0, 0
    for k in range(set_point.size):
        pv[k] = q[PROCESS_GAIN] * behind + disturbance[k]
        error = set_point[k] - pv[k]
        wanted = rest[k] + q[GAIN_SP] * set_point[k] - q[GAIN_PV] * pv[k]
        wanted += q[PER_SAMPLE] * (integral + error) + q[GAIN_CHANGE] * (pv[k] - pv[max(k - 1, 0)])
        within = q[OP_LOW] <= wanted <= q[OP_HIGH]
        integral += error if within else 0.0  # no wind-up
        op[k] = min(max(wanted, q[OP_LOW]), q[OP_HIGH])
        if k > 0 and op[k] != op[k - 1]:
            turned = 1.0 if op[k] > op[k - 1] else -1.0
        command = _late(op, k, q[VALVE_DELAY])
        if q[KNOCK] > 0.0 and k % max(int(q[KNOCK_EVERY]), 1) < int(q[KNOCK_FOR]):
            command += turned * q[KNOCK]
        off = command - actuator
        step = off * (up if off > 0.0 else down)
        step = min(max(step, -q[VALVE_SPEED_DOWN]), q[VALVE_SPEED_UP])
        actuator += step
        if not (moving and way * step > 0.0):
            moving = abs(actuator - stem) > breaks * levels[breakaway % levels.size]
            way = (1.0 if actuator > stem else -1.0) if moving else way
            breakaway += 1 if moving else 0
        if moving:
            stem = actuator - way * slides
        x[k] = stem
        driven = _late(x, k, q[PROCESS_DELAY]) - x[0]
        first += driven if q[INTEGRATES] > 0.0 else share * (driven - first)
        behind += second * (first - behind)
