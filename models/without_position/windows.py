"""OP, PV and SP as a convolutional network sees them: stretches of two lengths."""

from __future__ import annotations

import numpy as np

from stemwatch.models.recording import Floats

LENGTH = 256
PER_PERIOD = (32, 80)  # samples a period: eight cycles, and three cycles in more detail
MOST = 4  # stretches of each length
_FINEST = 0.5  # of a sample


def windows(op: Floats, pv: Floats, sp: Floats | None, period: float) -> Floats:
    """(w, 3, LENGTH) stretches of OP, PV and SP, spread over the record.

    ``period`` is in samples. OP and PV have mean 0 and size 1 in each, SP its own moves in sizes of
    PV, or zeros. A record that is too short for a stretch is stretched in time. PV is given the
    sign with which it falls as OP rises.
    """
    if float(np.diff(op) @ np.diff(pv)) > 0.0:
        pv, sp = -pv, None if sp is None else -sp
    led = np.zeros(op.size) if sp is None else sp
    return np.concatenate([_cut((op, pv, led), period / places) for places in PER_PERIOD])


def _cut(signals: tuple[Floats, Floats, Floats], step: float) -> Floats:
    n = signals[0].size
    step = min(max(step, _FINEST), n / LENGTH)
    count = int(n / step + 1e-9)
    thin = np.stack([_resampled(signal, step, count) for signal in signals])
    number = min(MOST, max(1, 2 * count // LENGTH - 1))
    starts = np.linspace(0, count - LENGTH, number).astype(np.int64)
    cut = np.stack([thin[:, start : start + LENGTH] for start in starts])
    cut = cut - cut.mean(axis=2, keepdims=True)
    size = cut.std(axis=2, keepdims=True) + 1e-9
    cut[:, :2] /= size[:, :2]
    cut[:, 2] = np.clip(cut[:, 2] / size[:, 1], -5.0, 5.0)
    return np.asarray(cut)


def _resampled(values: Floats, step: float, count: int) -> Floats:
    """(count,) means over ``step`` samples each, parts of samples by straight lines."""
    sums = np.interp(
        np.arange(count + 1) * step,
        np.arange(values.size + 1),
        np.concatenate([[0.0], np.cumsum(values - values[0])]),
    )
    return np.asarray(np.diff(sums) / step)
