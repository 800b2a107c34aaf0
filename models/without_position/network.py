"""Two small networks that weigh the evidence of a loop, run without torch, which only trains them.

The first reads the numbers of ``features``; the second, convolutional, reads the curves themselves
(``windows``). Their logits are added with trained weights. The first also estimates S.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from stemwatch.models.recording import Floats

KERNELS = ((9, 2), (7, 2), (5, 2))  # width and stride of each convolution


@dataclass(frozen=True, kw_only=True)
class LoopScore:
    """``score`` 0 to 1: the probability of a sticking valve where half of all loops have one.

    ``log_S`` and ``spread``: mean and standard deviation of ln(S/amplitude), should it stick.
    """

    score: float
    log_S: float
    spread: float


class LoopNetwork:
    """The networks by their ``arrays``, as ``models.studies.loops.training`` makes them."""

    def __init__(self, arrays: Mapping[str, Floats]) -> None:
        self.arrays = {name: np.asarray(array, dtype=np.float64) for name, array in arrays.items()}

    def answer(self, values: Floats, windows: Floats) -> LoopScore:
        """``values`` (n_features,) and ``windows`` (w, 2, LENGTH) of one loop."""
        heads = self.dense(values)
        logit = heads[0] * self.arrays["weigh"][0] + self.arrays["weigh"][2]
        logit += float(self.convolved(windows).mean()) * self.arrays["weigh"][1]
        return LoopScore(
            score=float(1.0 / (1.0 + np.exp(-logit))),
            log_S=float(heads[1]),
            spread=float(np.exp(heads[2]) * self.arrays["spread"][0]),
        )

    def dense(self, values: Floats) -> Floats:
        """(3,) logit, mean and log spread of ln(S/amplitude): the mean over the ensemble."""
        a = self.arrays
        scaled = np.clip((values - a["mean"]) / a["scale"], -4.0, 4.0)
        first = np.tanh(np.einsum("ehi,i->eh", a["dense1"], scaled) + a["bias1"])
        second = np.tanh(np.einsum("ehi,ei->eh", a["dense2"], first) + a["bias2"])
        out = np.einsum("ehi,ei->eh", a["dense3"], second) + a["bias3"]
        return np.asarray(out.mean(axis=0))

    def convolved(self, windows: Floats) -> Floats:
        """(w,) logits of the windows."""
        signal = windows
        for place, (_, stride) in enumerate(KERNELS, start=1):
            weights, bias = self.arrays[f"conv{place}"], self.arrays[f"conv_bias{place}"]
            parts = np.lib.stride_tricks.sliding_window_view(signal, weights.shape[2], axis=2)
            signal = np.einsum("wctk,ock->wot", parts[:, :, ::stride], weights, optimize=True)
            signal = np.maximum(signal + bias[:, None], 0.0)
        pooled = np.concatenate([signal.mean(axis=2), signal.max(axis=2)], axis=1)
        return np.asarray(pooled @ self.arrays["conv_out"] + self.arrays["conv_out_bias"])
