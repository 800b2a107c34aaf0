"""The gated-increment NARX network of one valve: its arrays, its scaling, its lags."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FORMAT_VERSION = 1


@dataclass(frozen=True, kw_only=True)
class NarxNetwork:
    """A trained network as plain arrays: it can be stored, loaded and run without torch."""

    weights: Mapping[str, NDArray[np.float64]]
    scaling: Mapping[str, float]
    lags: Mapping[str, int]
    interval_s: float
    format_version: int = FORMAT_VERSION
