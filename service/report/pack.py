"""Traces as short whole numbers: what keeps a page with a hundred valves small."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.recording import Floats

# Four digits of what a trace spans: 1/10 pixel of the tallest plot, and half the file size.
DIGITS_OF_RANGE = 4


def packed(values: Floats) -> dict[str, Any]:
    """Rounded to what can be seen, as whole steps from sample to sample: half the file's size.

    A value is the sum of ``steps`` up to it, divided by ``per``; null is a gap and adds nothing.
    """
    known = np.isfinite(values)
    places = _places(values[known])
    whole = np.round(values[known] * 10.0**places).astype(np.int64)
    steps: list[int | None] = [None] * values.size
    for place, step in zip(np.flatnonzero(known).tolist(), _steps(whole), strict=True):
        steps[place] = step
    return {"per": 10**places, "steps": steps}


def packed_indices(indices: NDArray[np.intp]) -> dict[str, Any]:
    """Sample numbers, exact, in the form of ``packed``."""
    return {"per": 1, "steps": _steps(indices.astype(np.int64))}


def _steps(whole: NDArray[np.int64]) -> list[int]:
    steps: list[int] = np.diff(whole, prepend=0).tolist()
    return steps


def _places(known: Floats) -> int:
    """Decimals that keep ``DIGITS_OF_RANGE`` digits of the range of ``known``."""
    if not known.size:
        return 0
    size = float(np.ptp(known)) or abs(float(known[0])) or 1.0
    return min(12, max(0, DIGITS_OF_RANGE - 1 - math.floor(math.log10(size))))
