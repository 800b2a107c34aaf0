"""OP, PV and SP as a convolutional network sees them: stretches of three lengths."""

from __future__ import annotations

import numpy as np

from stemwatch.models.recording import Floats

LENGTH = 256
# samples a period: twenty cycles, eight, and two and a half in detail
PER_PERIOD = (12, 32, 100)
STRETCHES = 3  # of each length, spread over the record
SIGNALS = 3
_FINEST = 0.5  # of a sample
_FARTHEST = 5.0  # standard deviations of PV, at which SP is clipped


def windows(op: Floats, pv: Floats, sp: Floats | None, period: float) -> Floats:
    """(lengths, STRETCHES, SIGNALS, LENGTH) stretches of OP, PV and SP, spread over the record.

    ``period`` is in samples. OP and PV have mean 0 and size 1 in each; SP lies where it lies beside
    PV, because what OP does depends on the error, and is zeros where it is not known. A record that
    is too short for a stretch is stretched in time. PV is given the sign with which it falls as OP
    rises.
    """
    if float(np.diff(op) @ np.diff(pv)) > 0.0:
        pv, sp = -pv, None if sp is None else -sp
    signals = np.stack([op, pv, pv if sp is None else sp])
    cut = np.stack([_cut(signals, period / places) for places in PER_PERIOD])
    if sp is None:
        cut[:, :, 2] = 0.0
    return cut


def _cut(signals: Floats, step: float) -> Floats:
    n = signals.shape[1]
    step = min(max(step, _FINEST), n / LENGTH)
    count = int(n / step + 1e-9)
    thin = np.stack([_resampled(signal, step, count) for signal in signals])
    starts = np.linspace(0, count - LENGTH, STRETCHES).astype(np.int64)
    cut = np.stack([thin[:, start : start + LENGTH] for start in starts])
    middle, size = cut.mean(axis=2, keepdims=True), cut.std(axis=2, keepdims=True) + 1e-9
    middle[:, 2], size[:, 2] = middle[:, 1], size[:, 1]
    cut = (cut - middle) / size
    cut[:, 2] = np.clip(cut[:, 2], -_FARTHEST, _FARTHEST)
    return np.asarray(cut)


def _resampled(values: Floats, step: float, count: int) -> Floats:
    """(count,) means over ``step`` samples each, parts of samples by straight lines."""
    middle = float(np.mean(values))
    sums = np.interp(
        np.arange(count + 1) * step,
        np.arange(values.size + 1),
        np.concatenate([[0.0], np.cumsum(values - middle)]),
    )
    return np.asarray(np.diff(sums) / step + middle)
