"""A packing that lets go the sooner the quicker it is loaded: what looks like dwell, and is none.

Bristles give before they let go. Loaded by a command of the speed ``r``, they do so ``d r^(2/3)``
below their level, but never below the kinetic one (``breakaway_levels`` has the reason). A slow
command means a long rest, so that such a packing seems to hold the longer the longer it has rested.
It is no fault and gets no name. Only the likelihood knows it (``breakaway_filter``).
"""

from __future__ import annotations

from typing import cast

import numpy as np

from stemwatch.models.mismatch.stem_model import stem as stem_number
from stemwatch.models.mismatch.term import Coordinate, RecordingSummary, Term
from stemwatch.models.mismatch.terms._common import OneNumberTerm
from stemwatch.models.recording import Floats


class QuickLoading(OneNumberTerm):
    """One coordinate, ``d`` in percent at 1 %/s."""

    slug = "quick_loading"
    order = 21
    fills = stem_number.SOONER

    def coordinates(self, summary: RecordingSummary) -> tuple[Coordinate, ...]:
        """By how much sooner the stem lets go at 1 %/s."""
        return (Coordinate(name="d_percent", low=0.0, high=6.0),)

    def starts(self, summary: RecordingSummary) -> Floats:
        """Small to large."""
        return np.array([[0.2], [0.6], [1.5]])


QUICK_LOADING = cast("Term", QuickLoading())  # without the words of what is named
