"""Simulated loops as the networks of ``models.without_position`` see them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stemwatch.models.recording import Floats
from stemwatch.models.studies.loops.draws import draw_loop
from stemwatch.models.without_position.features import evidence
from stemwatch.models.without_position.windows import windows


@dataclass(frozen=True, kw_only=True)
class LoopExample:
    """One loop as the networks see it. ``log_S`` is ln(S/amplitude), NaN without sticking."""

    values: Floats
    windows: Floats
    sticky: bool
    log_S: float


def example(seed: int, index: int) -> LoopExample | None:
    """The example of a drawn loop; ``None`` where it holds nothing that can be compared."""
    loop = draw_loop(seed, index)
    try:
        shown = evidence(loop.op, loop.pv, loop.sp)
    except ValueError:
        return None
    return LoopExample(
        values=shown.values,
        windows=windows(loop.op, loop.pv, shown.period).astype(np.float32),
        sticky=loop.sticky,
        log_S=float(np.log(loop.S / shown.amplitude)) if loop.sticky else np.nan,
    )
