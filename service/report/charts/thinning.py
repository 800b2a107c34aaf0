"""Thinning for plots without lost edges: each bucket of samples keeps its lowest and highest value.

A stick-slip jump lasts one sample; taking every k-th sample would lose it, averaging would round
it. Here a trace of n samples becomes two points a bucket, in the order in which they occurred, on
an even grid that all traces of one recording share.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.recording import Floats

POINTS = 1500


@dataclass(frozen=True, kw_only=True)
class ThinningGrid:
    """Positions of the points of a thinned trace: ``first`` + k ``step``, in samples."""

    samples: int
    bucket: int  # samples a bucket; 1 means that every sample is kept

    @classmethod
    def of(cls, samples: int, points: int = POINTS) -> ThinningGrid:
        """The finest grid of at most ``points`` points for ``samples`` samples."""
        if samples <= points:
            return cls(samples=samples, bucket=1)
        return cls(samples=samples, bucket=-(-samples // (points // 2)))

    @property
    def first(self) -> float:
        return 0.0 if self.bucket == 1 else (self.bucket - 2) / 4

    @property
    def step(self) -> float:
        return 1.0 if self.bucket == 1 else self.bucket / 2


def lowest_and_highest(values: Floats, grid: ThinningGrid) -> Floats:
    """(m,) of ``values`` (n,) on ``grid``; NaN only where a whole bucket is NaN.

    Raises ``ValueError`` where the trace is not as long as the grid's recording.
    """
    if values.shape != (grid.samples,):
        raise ValueError(f"expected a trace of {grid.samples} samples, received {values.shape}")
    if grid.bucket == 1:
        return values
    buckets = _buckets(values, grid.bucket)
    rows = np.arange(len(buckets))
    ends = np.sort(_extremes(buckets), axis=1)
    return buckets[rows[:, None], ends].ravel()


def extreme_samples(traces: list[Floats], points: int = POINTS) -> NDArray[np.intp]:
    """Sorted indices at which one of ``traces`` is lowest or highest in its bucket.

    For plots of one trace against another, where each point must be one instant. At most
    ``points`` indices.
    """
    samples = traces[0].size
    bucket = bucket_of(samples, len(traces), points)
    if bucket == 1:
        return np.arange(samples)
    kept_samples = []
    for trace in traces:
        buckets = _buckets(trace, bucket)
        offsets = np.arange(len(buckets))[:, None] * bucket
        kept_samples.append((_extremes(buckets) + offsets).ravel())
    all_samples = np.unique(np.concatenate(kept_samples))
    return all_samples[all_samples < samples]


def bucket_of(samples: int, traces: int, points: int = POINTS) -> int:
    """Samples a bucket of ``extreme_samples`` holds; 1 where every sample is kept."""
    if samples <= points:
        return 1
    return -(-samples // max(1, points // (2 * traces)))


def _buckets(values: Floats, bucket: int) -> Floats:
    rows = -(-values.size // bucket)
    padded = np.full(rows * bucket, np.nan)
    padded[: values.size] = values
    return padded.reshape(rows, bucket)


def _extremes(buckets: Floats) -> NDArray[np.intp]:
    # NaN counts as larger or smaller than every number; in a bucket of NaN only, any position will
    # do.
    lowest = np.argmin(np.where(np.isnan(buckets), np.inf, buckets), axis=1)
    highest = np.argmax(np.where(np.isnan(buckets), -np.inf, buckets), axis=1)
    return np.stack([lowest, highest], axis=1)
