"""Does this position belong to this command? A wrong tag gives confident nonsense."""

from __future__ import annotations

import numpy as np

from stemwatch.models.cross_correlation import lagged_products
from stemwatch.models.excitation import swing
from stemwatch.models.forensics import quantum
from stemwatch.models.recording import Floats, Recording

LONGEST_DELAY_S = 120.0
COPIED_SHARE = 0.99  # of the samples
DELAYS = (0, 1, 2)  # samples by which a copy of OP may have been recorded late


def _pairs(recording: Recording) -> tuple[Floats, Floats]:
    """OP and MV where both are usable; empty where one of them does not move."""
    assert recording.mv is not None
    usable = recording.usable
    op, mv = recording.op.values[usable], recording.mv.values[usable]
    if op.size < 10 or swing(op) == 0.0 or swing(mv) == 0.0:
        return op[:0], mv[:0]
    return op, mv


def is_copy(recording: Recording) -> bool:
    """True where the "position" is OP under another name: equal, rounded, or a scan or two late."""
    op, mv = _pairs(recording)
    if not op.size:
        return False
    # A rounded copy is within half its step of OP; a real stem is not, sample for sample.
    tolerance = max(0.51 * quantum(mv), 1e-6 * max(swing(op), 1.0))
    return any(
        float(np.mean(np.abs(mv[late:] - op[: op.size - late]) <= tolerance)) > COPIED_SHARE
        for late in DELAYS
    )


def correlation(recording: Recording) -> float:
    """Of OP and position at the same instants, -1 to 1; 0 where one of them does not move."""
    op, mv = _pairs(recording)
    return float(np.corrcoef(op, mv)[0, 1]) if op.size else 0.0


def delayed_correlation(recording: Recording) -> float:
    """The highest correlation of the position with OP up to two minutes before it; holes are 0."""
    op, mv = _pairs(recording)
    if not op.size:
        return 0.0
    assert recording.mv is not None
    usable = recording.usable
    a = np.where(usable, recording.op.values - op.mean(), 0.0)
    b = np.where(usable, recording.mv.values - mv.mean(), 0.0)
    longest = max(2, min(round(LONGEST_DELAY_S / recording.interval_s), a.size // 4))
    return float(lagged_products(a, b, longest).max() / np.sqrt((a @ a) * (b @ b)))
