"""Whether a signal is in percent of span or travel, and which of its values cannot be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stemwatch.models.recording import PERCENT, Quality, Recording, Role, Signal

# No position or command lies outside this range, percent; one such value would dominate a fit.
POSSIBLE_PERCENT = (-100.0, 200.0)


def not_percent(signal: Signal) -> str | None:
    """Why the signal is not in percent, by its unit or its values, as the end of a sentence;
    ``None`` where it is.
    """
    if signal.unit != PERCENT:
        return f"is in {signal.unit or 'an unknown unit'}"
    values = signal.values[np.isfinite(signal.values)]
    if values.size and np.mean((values < -10.0) | (values > 110.0)) > 0.5:
        return f"runs from {values.min():.4g} to {values.max():.4g}"
    return None


def without_impossible_values(recording: Recording) -> Recording:
    """``recording`` with samples of OP and MV outside ``POSSIBLE_PERCENT`` marked ``RANGE``."""
    signals = dict(recording.signals)
    for role in (Role.OP, Role.MV):
        signal = signals.get(role)
        if signal is None or not_percent(signal) is not None:
            continue
        low, high = POSSIBLE_PERCENT
        outside = (signal.values < low) | (signal.values > high)
        if outside.any():
            quality = np.where(outside, Quality.RANGE, signal.quality).astype(np.uint8)
            signals[role] = replace(signal, quality=quality)
    return replace(recording, signals=signals)
