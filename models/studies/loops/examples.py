"""Simulated loops as the networks of ``models.without_position`` see them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stemwatch.models.recording import Floats
from stemwatch.models.studies.loops.draws import draw_loop
from stemwatch.models.without_position.features import dominant_period, evidence
from stemwatch.models.without_position.windows import LENGTH, windows


@dataclass(frozen=True, kw_only=True)
class LoopExample:
    """One loop as the networks see it. ``log_S`` is ln(S/amplitude), NaN without sticking."""

    values: Floats
    windows: Floats
    sticky: bool
    log_S: float


@dataclass(frozen=True, kw_only=True)
class WindowsExample:
    """One loop as the convolutional network alone sees it; computed in a tenth of the time."""

    windows: Floats
    sticky: bool


def example(seed: int, index: int) -> LoopExample | None:
    """The example of a drawn loop; ``None`` where it holds nothing that can be compared."""
    loop = draw_loop(seed, index)
    try:
        evidence_seen = evidence(loop.op, loop.pv)
    except ValueError:
        return None
    return LoopExample(
        values=evidence_seen.values,
        windows=windows(loop.op, loop.pv, loop.sp, evidence_seen.period).astype(np.float32),
        sticky=loop.sticky,
        log_S=float(np.log(loop.S / evidence_seen.amplitude)) if loop.sticky else np.nan,
    )


def windows_example(seed: int, index: int) -> WindowsExample | None:
    """The windows of a drawn loop; ``None`` where OP or PV stands still or it is too short."""
    loop = draw_loop(seed, index)
    if loop.op.size < LENGTH // 2 or np.ptp(loop.op) <= 0.0 or np.ptp(loop.pv) <= 0.0:
        return None
    cut = windows(loop.op, loop.pv, loop.sp, dominant_period(loop.op))
    return WindowsExample(windows=cut.astype(np.float32), sticky=loop.sticky)
