"""Runs of samples in a signal: in which something holds, or in which the value stays the same."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.recording import Bools, Floats

Runs = NDArray[np.int64]  # (m, 2) first and last + 1 of each


def runs_of(flags: Bools) -> Runs:
    """(m, 2) first and last + 1 of each run of True in ``flags`` (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], flags.astype(np.int8), [0]))))
    return edges.reshape(-1, 2).astype(np.int64, copy=False)


def equal_runs(values: Floats) -> Runs:
    """(m, 2) first and last + 1 of each run of equal ``values`` (n,), two and more of them."""
    return np.add(runs_of(np.diff(values) == 0.0), (0, 1))


def long_runs(flags: Bools, least: int) -> Bools:
    """(n,) ``flags`` (n,) in runs of at least ``least`` samples only."""
    runs = runs_of(flags)
    begins, ends = runs[runs[:, 1] - runs[:, 0] >= least].T
    change = np.zeros(flags.size + 1, dtype=np.int8)
    change[begins], change[ends] = 1, -1
    return np.cumsum(change[:-1]) > 0
