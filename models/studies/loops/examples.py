"""Simulated loops as the networks of ``models.without_position`` see them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stemwatch.models.recording import Floats
from stemwatch.models.studies.loops.draws import DrawnLoop, draw_loop
from stemwatch.models.without_position.features import (
    amplitude_of,
    dominant_period,
    evidence,
)
from stemwatch.models.without_position.windows import LENGTH, windows

_HELD_BACK = 5  # one loop of five is not trained on
# S over the amplitude of OP: a stem that sticks by less, or a sound one that has more, teaches
# nothing
_LEAST_STICKING, _MOST_SOUND = 0.1, 0.15


@dataclass(frozen=True, kw_only=True)
class LoopExample:
    """One loop as the networks see it. ``log_S`` is ln(S/amplitude), NaN without sticking; what is
    ``held_back`` weighs what the others trained."""

    values: Floats
    windows: Floats
    sticky: bool
    log_S: float
    held_back: bool


@dataclass(frozen=True, kw_only=True)
class WindowsExample:
    """One loop as the convolutional network alone sees it; computed in a tenth of the time."""

    windows: Floats
    sticky: bool


def example(seed: int, index: int) -> LoopExample | None:
    """The example of a drawn loop; ``None`` where it holds nothing that can be compared, or where
    ``teaches`` says no."""
    loop = draw_loop(seed, index)
    try:
        seen = evidence(loop.op, loop.pv)
    except ValueError:
        return None
    if not teaches(loop, seen.amplitude):
        return None
    return LoopExample(
        values=seen.values,
        windows=windows(loop.op, loop.pv, loop.sp, seen.period).astype(np.float16),
        sticky=loop.sticky,
        log_S=float(np.log(loop.S / seen.amplitude)) if loop.sticky else np.nan,
        held_back=index % _HELD_BACK == 0,
    )


def windows_example(seed: int, index: int) -> WindowsExample | None:
    """The windows of a drawn loop; ``None`` where OP or PV stands still, where it is too short, and
    where ``teaches`` says no."""
    loop = draw_loop(seed, index)
    if loop.op.size < LENGTH // 2 or np.ptp(loop.op) <= 0.0 or np.ptp(loop.pv) <= 0.0:
        return None
    period = dominant_period(loop.op)
    if not teaches(loop, amplitude_of(loop.op, period)):
        return None
    cut = windows(loop.op, loop.pv, loop.sp, period)
    return WindowsExample(windows=cut.astype(np.float16), sticky=loop.sticky)


def teaches(loop: DrawnLoop, amplitude: float) -> bool:
    """Whether what is seen can have to do with the label.

    The networks see no scale. Where OP hardly moves, the 0.4 % of a sound stem look like any
    sticking; where it swings wide, a sticking stem looks sound. Trained on such loops, a network
    learns to guess the scale from noise and steps.
    """
    ratio = loop.stem_S / amplitude
    return ratio >= _LEAST_STICKING if loop.sticky else ratio <= _MOST_SOUND
