"""Which stretch of a long recording is fitted: the one in which OP works the valve most.

The cost of a fit grows with the samples, its precision hardly: S and J show where OP turns round
and goes far enough for the stem to follow. A day is therefore fitted on the hour with most of that;
what needs no fit is still taken from the whole day.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.excitation import reversals, swing
from stemwatch.models.forensics import noise_sigma
from stemwatch.models.recording import Floats, Recording
from stemwatch.models.words import times

# A turn counts where OP goes back by a quarter of its swing, and by more than noise and resolution.
TURN_SHARE = 0.25
NOISES = 6.0
SMALLEST_TURN_PERCENT = 0.3
# A recording of up to twice as many samples is fitted whole.
CHOOSE_BEYOND = 2.0
STARTS_PER_STRETCH = 6
# One half is fitted and the other held out: movement in one of them only is worth little.
WHOLE_SHARE = 0.1


@dataclass(frozen=True)
class FitWindow:
    """Samples ``first`` (inclusive) to ``last`` (exclusive), in which OP makes ``turns`` turns of
    at least ``turn_percent``."""

    first: int
    last: int
    turns: int
    turn_percent: float

    @property
    def length(self) -> int:
        """How many samples it holds."""
        return self.last - self.first


def choose_fit_window(recording: Recording, samples: int) -> FitWindow | None:
    """The stretch of ``samples`` samples with the most useful movement of OP; ``None`` where the
    recording has at most ``CHOOSE_BEYOND`` times as many.

    OP's way is cut into legs between turns of at least ``max(swing/4, 6 sigma, 0.3 %)``; a leg
    counts its length, at most one swing (1st to 99th percentile). With ``a`` and ``b`` the sums
    over either half of a stretch, its worth is ``(min(a, b) + (a + b)/10) u`` with ``u`` the share
    of usable samples. Starts are tried every sixth of a stretch; the first of equals is taken.
    MV takes no part in the choice: a choice by the stem's movement would favour one verdict.
    """
    n = len(recording)
    if samples < 2 or n <= CHOOSE_BEYOND * samples:
        return None
    op, usable = recording.op.values, recording.usable
    known = np.flatnonzero(np.isfinite(op))
    if known.size < 3:
        return None
    span = swing(op)
    threshold = max(TURN_SHARE * span, NOISES * noise_sigma(op), SMALLEST_TURN_PERCENT)
    turns = known[reversals(op[known], threshold)]
    path = np.zeros(n + 1)
    path[turns[1:] + 1] = np.minimum(np.abs(np.diff(op[turns])), span)
    path = np.cumsum(path)
    good = np.concatenate(([0], np.cumsum(usable)))
    step = max(samples // STARTS_PER_STRETCH, 1)
    first = np.unique(np.append(np.arange(0, n - samples, step), n - samples))
    worth = _worth(path, first, samples) * (good[first + samples] - good[first]) / samples
    begin = int(first[int(np.argmax(worth))])
    inside = int(np.count_nonzero((turns >= begin) & (turns < begin + samples)))
    return FitWindow(begin, begin + samples, inside, float(threshold))


def _worth(path: Floats, first: NDArray[np.intp], samples: int) -> Floats:
    """(m,) what OP's way in either half is worth, for stretches that begin at ``first`` (m,)."""
    middle = first + samples // 2
    early, late = path[middle] - path[first], path[first + samples] - path[middle]
    return np.asarray(np.minimum(early, late) + WHOLE_SHARE * (early + late))


def window_sentence(stretch: FitWindow, recording: Recording) -> str:
    """One sentence for the report: which stretch was fitted and why that one."""
    part = recording.part(stretch.first, stretch.last)
    where = f"samples {stretch.first + 1} to {stretch.last}"
    if part.start is not None and part.end is not None:
        where = f"{part.start:%Y-%m-%d %H:%M:%S} to {part.end:%Y-%m-%d %H:%M:%S} UTC"
    return (
        f"The models are fitted to {where}, {stretch.length / len(recording):.0%} of the record: "
        f"where OP works the valve most, turning round {times(stretch.turns)} by at least "
        f"{stretch.turn_percent:.2g} %. Data quality and movement are those of the whole record."
    )


def on_whole_clock(trace: Floats, first: int, samples: int) -> Floats:
    """(samples,) a trace of a stretch that begins at ``first``, NaN outside it."""
    whole = np.full(samples, np.nan)
    whole[first : first + trace.size] = trace
    return whole


__all__ = ["FitWindow", "choose_fit_window", "on_whole_clock", "window_sentence"]
