"""A servo drive of finite gain that lifts a weight on an arm, integrated in small steps.

It shares no code with the fitted model: Euler's method, two hundred steps a sample.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from stemwatch.models.recording import Recording, Role, Signal

STEPS = 200  # of a sample
ENCODER = 0.0244  # percent of a turn: one count of 4096


@njit(cache=True)
def _angle(op, dt, numbers, out):
    """The angle in percent of a turn; ``numbers``: friction, lag, inertia, load, top speed."""
    friction, lag, inertia, load, top = numbers
    h = dt / STEPS
    x, v = op[0], 0.0
    for k in range(op.size):
        for _ in range(STEPS):
            push = min(max(op[k] - x, -top * lag), top * lag)
            net = push - load * np.sin(2.0 * np.pi * (x - 50.0) / 100.0)
            if v == 0.0 and abs(net) <= friction:
                continue
            way = np.sign(v) if v != 0.0 else np.sign(net)
            faster = v + h * (net - friction * way - lag * v) / inertia
            v = 0.0 if v != 0.0 and faster * v < 0.0 else faster
            x += h * v
        out[k] = x


def drive(
    S=1.0,
    *,
    lag_s=0.2,
    run_up_s=0.06,
    load=2.0,
    top_speed=80.0,
    samples=2000,
    interval_s=0.01,
    noise=0.0,
    seed=1,
):
    """A recording under two sines and a chirp; ``S`` and ``load`` in percent of a turn."""
    t = np.arange(samples) * interval_s
    op = 50.0 + 14.0 * np.sin(1.6 * t) + 7.0 * np.sin(3.9 * t + 1.0)
    half = samples // 2
    op[half:] = 50.0 + 21.0 * np.sin((0.6 + 0.13 * (t[half:] - 10.0)) * (t[half:] - 10.0))
    mv = np.empty(samples)
    _angle(op, interval_s, np.array([0.5 * S, lag_s, lag_s * run_up_s, load, top_speed]), mv)
    mv += noise * np.random.default_rng(seed).standard_normal(samples)
    mv = np.round(mv / ENCODER) * ENCODER
    signals = {Role.OP: Signal.good(op, "M.OP"), Role.MV: Signal.good(mv, "M.ZT")}
    return Recording(valve="M", signals=signals, interval_s=interval_s)
