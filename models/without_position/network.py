"""Two small networks that weigh the evidence of a loop. They run without torch, which only trains
them.

The first reads the numbers of ``features``; the second, convolutional, reads the curves themselves
(``windows``): what it sees of each stretch is averaged over the stretches of one length, and two
layers weigh the lengths. Both logits are added with trained weights. The first also estimates S.
"""

from __future__ import annotations

from base64 import b85decode, b85encode
from collections.abc import Mapping
from dataclasses import dataclass
from zlib import compress, decompress

import numpy as np

from stemwatch.models.recording import Floats

KERNELS = ((9, 2), (7, 2), (5, 2), (3, 1))  # width and stride of each convolution
MOST_AWAY = 3.0  # standard deviations at which an input is clipped


@dataclass(frozen=True, kw_only=True)
class LoopScore:
    """``score`` 0 to 1: the probability of a sticking valve where half of all loops have one.

    ``log_S`` and ``spread``: mean and standard deviation of ln(S/amplitude), should it stick.
    """

    score: float
    log_S: float
    spread: float


def packed(arrays: Mapping[str, Floats]) -> tuple[dict[str, tuple[int, ...]], str]:
    """The shapes of ``arrays`` and their numbers in half precision as text.

    The eleven significant bits are more than the training determines, and the text is half as long.
    """
    flat = np.concatenate([np.ravel(array) for array in arrays.values()]).astype("<f2")
    return {name: np.shape(array) for name, array in arrays.items()}, b85encode(
        compress(flat.tobytes(), 9)
    ).decode()


def unpacked(shapes: Mapping[str, tuple[int, ...]], text: str) -> dict[str, Floats]:
    """The arrays that ``packed`` made ``shapes`` and ``text`` of; line breaks do not count."""
    flat = np.frombuffer(decompress(b85decode("".join(text.split()))), dtype="<f2").astype(
        np.float64
    )
    sizes = np.cumsum([int(np.prod(shape)) for shape in shapes.values()])
    parts = np.split(flat, sizes[:-1])
    return {
        name: part.reshape(shape) for (name, shape), part in zip(shapes.items(), parts, strict=True)
    }


class LoopNetwork:
    """The networks by their ``arrays``, as ``models.studies.loops.training`` makes them."""

    def __init__(self, arrays: Mapping[str, Floats]) -> None:
        self.arrays = {name: np.asarray(array, dtype=np.float64) for name, array in arrays.items()}

    def answer(self, values: Floats, windows: Floats) -> LoopScore:
        """``values`` (n_features,) of ``features`` and the ``windows`` of one loop."""
        heads = self.dense(values)
        logit = heads[0] * self.arrays["weigh"][0] + self.arrays["weigh"][2]
        logit += self.by_curves(windows) * self.arrays["weigh"][1]
        return LoopScore(
            score=float(1.0 / (1.0 + np.exp(-logit))),
            log_S=float(heads[1]),
            spread=float(np.exp(heads[2]) * self.arrays["spread"][0]),
        )

    def dense(self, values: Floats) -> Floats:
        """(3,) logit, mean and log spread of ln(S/amplitude): the mean over the ensemble."""
        a = self.arrays
        scaled = np.clip((values - a["mean"]) / a["scale"], -MOST_AWAY, MOST_AWAY)
        first = np.tanh(np.einsum("ehi,i->eh", a["dense1"], scaled) + a["bias1"])
        second = np.tanh(np.einsum("ehi,ei->eh", a["dense2"], first) + a["bias2"])
        out = np.einsum("ehi,ei->eh", a["dense3"], second) + a["bias3"]
        return np.asarray(out.mean(axis=0))

    def by_curves(self, windows: Floats) -> float:
        """The logit by ``windows``; upside down a loop is as sticky, so it is the mean of both."""
        upright = np.asarray(windows, dtype=np.float64)
        return 0.5 * (self.convolved(upright) + self.convolved(-upright))

    def convolved(self, windows: Floats) -> float:
        """The logit by ``windows`` (lengths, stretches, signals, n)."""
        a = self.arrays
        signal = windows.reshape(-1, *windows.shape[2:])
        for layer, (_, stride) in enumerate(KERNELS, start=1):
            weights, bias = a[f"conv{layer}"], a[f"conv{layer}_bias"]
            parts = np.lib.stride_tricks.sliding_window_view(signal, weights.shape[2], axis=2)
            signal = np.einsum("wctk,ock->wot", parts[:, :, ::stride], weights, optimize=True)
            signal = np.maximum(signal + bias[:, None], 0.0)
        pooled = np.concatenate([signal.mean(axis=2), signal.max(axis=2)], axis=1)
        of_lengths = pooled.reshape(*windows.shape[:2], -1).mean(axis=1)
        hidden = np.maximum(a["lengths"] @ of_lengths.ravel() + a["lengths_bias"], 0.0)
        return float(hidden @ a["curves"] + a["curves_bias"][0])
