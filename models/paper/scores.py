"""The two figures of the paper: root mean square error, and correct directional change."""

from __future__ import annotations

import numpy as np

from stemwatch.models.recording import Floats


def rmse(simulated: Floats, truth: Floats) -> Floats:
    """``sqrt(mean((yhat - y)^2))`` over the last axis."""
    return np.asarray(np.sqrt(np.mean((simulated - truth) ** 2, axis=-1)))


def cdc_percent(simulated: Floats, truth: Floats) -> Floats:
    """``100 mean(D)`` over the last axis: how often both go the same way.

    ``D(t) = 1`` where ``(y(t) - y(t-1)) (yhat(t) - yhat(t-1)) > 0``, 0 where not, also where either
    stands still.

    The paper defines CDC only by a reference. With "> 0" even a perfect model scores no more than
    the share of samples at which the stem moves, about 60 % in these cases, which is what the
    paper reports; with ">= 0" it would have to report nearly 100 %.
    """
    together = np.diff(simulated, axis=-1) * np.diff(truth, axis=-1)
    return np.asarray(100.0 * np.mean(together > 0.0, axis=-1))
