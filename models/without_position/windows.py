"""OP and PV as a convolutional network sees them: some cycles, 32 samples to a period."""

from __future__ import annotations

import numpy as np

from stemwatch.models.recording import Floats

LENGTH, PER_PERIOD, MOST = 256, 32, 6


def windows(op: Floats, pv: Floats, period: float) -> Floats:
    """(w, 2, LENGTH) windows of OP and PV, spread over the record, each of mean 0 and size 1.

    ``period`` is in samples. A record of fewer than eight periods is one window, stretched. PV is
    turned so that it falls where OP rises.
    """
    if float(np.diff(op) @ np.diff(pv)) > 0.0:
        pv = -pv
    step = min(period / PER_PERIOD, op.size / LENGTH)
    count = int(op.size / step)
    u, y = _resampled(op, step, count), _resampled(pv, step, count)
    number = min(MOST, max(1, 2 * count // LENGTH - 1))
    starts = np.linspace(0, count - LENGTH, number).astype(np.int64)
    cut = np.stack([np.stack([u[s : s + LENGTH], y[s : s + LENGTH]]) for s in starts])
    cut = cut - cut.mean(axis=2, keepdims=True)
    return np.asarray(cut / (cut.std(axis=2, keepdims=True) + 1e-9))


def _resampled(values: Floats, step: float, count: int) -> Floats:
    """(count,) means over ``step`` samples each, parts of samples by straight lines."""
    sums = np.interp(
        np.arange(count + 1) * step,
        np.arange(values.size + 1),
        np.concatenate([[0.0], np.cumsum(values)]),
    )
    return np.asarray(np.diff(sums) / step)
