"""The compiled kernel of a plant of loops: controllers, valves, processes, and the links between
them.

All in percent, one step for each scan. Each loop's process is a lag of the first order behind a
dead time (or an integrator), driven by its own stem, by loads, and by the PVs and stems of other
loops through lags of their own. It shares no code with the search for groups.
"""

from __future__ import annotations

import math

import numpy as np

from stemwatch.models.compiled import compiled
from stemwatch.models.recording import Floats

# Columns of a loop's numbers.
GAIN, RESET, LOW, HIGH, PROCESS, LAG, DELAY, INTEGRATING, STICK, JUMP, STEP = range(11)
# Columns of a link's numbers: from, to, strength, lag, whether it carries the stem (1) or PV (0).
FROM, TO, STRENGTH, LINK_LAG, OF_STEM = range(5)


@compiled()
def _moved(stem: float, demanded: float, band: float, jump: float) -> float:
    """A stem that rests until OP is half the band ahead, then jumps and follows behind OP."""
    if band <= 0.0:
        return demanded
    ahead = demanded - stem
    if abs(ahead) <= 0.5 * band:
        return stem
    side = 1.0 if ahead > 0.0 else -1.0
    return demanded - side * max(0.5 * band - jump, 0.0)


@compiled()
def run_plant(
    loops: Floats,
    links: Floats,
    set_points: Floats,
    loads: Floats,
    noise: Floats,
    sticking: Floats,
    scans_per_sample: int,
) -> tuple[Floats, Floats]:
    """(m, n) PV and OP as read each ``scans_per_sample`` scans.

    ``loops`` (m, 11), ``links`` (k, 5); ``set_points``, ``loads`` (on the process input) and
    ``noise`` (on PV) are (m, scans), deviations around 50 %; ``sticking`` (m, scans) multiplies S
    and J, so that a valve may stick for part of the time.
    """
    m, n = set_points.shape
    size = n // scans_per_sample
    out_pv, out_op = np.empty((m, size)), np.empty((m, size))
    longest = int(loops[:, DELAY].max()) + 1
    waiting = np.zeros((m, longest))
    integral, stem, state, op = np.zeros(m), np.zeros(m), np.zeros(m), np.zeros(m)
    pv = np.zeros(m)
    carried = np.zeros(links.shape[0])
    load = np.zeros(m)
    for k in range(n):
        for i in range(m):
            load[i] = loads[i, k]
        for j in range(links.shape[0]):
            source = int(links[j, FROM])
            value = stem[source] if links[j, OF_STEM] > 0.5 else state[source]
            carried[j] += (value - carried[j]) / max(links[j, LINK_LAG], 1.0)
            load[int(links[j, TO])] += links[j, STRENGTH] * carried[j]
        for i in range(m):
            measured = state[i] + noise[i, k]
            step = loops[i, STEP]
            pv[i] = math.floor(measured / step + 0.5) * step if step > 0.0 else measured
            error = set_points[i, k] - pv[i]
            integral[i] += loops[i, GAIN] * error / loops[i, RESET]
            raw = integral[i] + loops[i, GAIN] * error
            demanded = min(max(raw, loops[i, LOW]), loops[i, HIGH])
            integral[i] += demanded - raw
            op[i] = demanded
            band, jump = loops[i, STICK] * sticking[i, k], loops[i, JUMP] * sticking[i, k]
            stem[i] = _moved(stem[i], demanded, band, jump)
            slot = k % longest
            waiting[i, slot] = stem[i] + load[i]
            late = waiting[i, (k + longest - int(loops[i, DELAY])) % longest]
            if loops[i, INTEGRATING] > 0.5:
                state[i] += loops[i, PROCESS] * late / loops[i, LAG]
            else:
                state[i] += (loops[i, PROCESS] * late - state[i]) / loops[i, LAG]
        if (k + 1) % scans_per_sample == 0:
            sample = (k + 1) // scans_per_sample - 1
            if sample < size:
                for i in range(m):
                    out_pv[i, sample], out_op[i, sample] = 50.0 + pv[i], 50.0 + op[i]
    return out_pv, out_op
