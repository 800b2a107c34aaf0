"""Which stretch of a long recording is fitted: the one in which OP works the valve most.

The cost of a fit grows with the samples, its precision hardly does: S and J show only where OP
reverses and goes far enough for the stem to follow. A day is therefore fitted on the hour with most
such movement; numbers that need no fit are still taken from the whole day.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.recording import Floats, Recording
from stemwatch.models.signals.excitation import reversals, swing
from stemwatch.models.signals.forensics import noise_sigma
from stemwatch.models.words import times

# A reversal counts where OP goes back by a quarter of its swing, and by more than noise and
# resolution.
TURN_SHARE = 0.25
NOISES = 6.0
SMALLEST_TURN_PERCENT = 0.3
# A recording of up to twice as many samples is fitted whole.
CHOOSE_BEYOND = 2.0
STARTS_PER_STRETCH = 6
# The first half is fitted and the second held out, so movement in one half only is worth little.
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

    OP's path is cut into legs between reversals of at least ``max(swing/4, 6 sigma, 0.3 %)``; a leg
    counts by its length, at most one swing (1st to 99th percentile). With ``a`` and ``b`` the sums
    over either half of a stretch, its worth is ``(min(a, b) + (a + b)/10) u`` with ``u`` the share
    of usable samples. Starts are tried every sixth of a stretch; the first of equals is taken. MV
    is not used in the choice, because a choice by the stem's movement would favour one verdict.
    """
    n = len(recording)
    if samples < 2 or n <= CHOOSE_BEYOND * samples:
        return None
    movement = _Movement.of(recording)
    if movement is None:
        return None
    step = max(samples // STARTS_PER_STRETCH, 1)
    first = np.unique(np.append(np.arange(0, n - samples, step), n - samples))
    return movement.window(int(first[int(np.argmax(movement.worth(first, samples)))]), samples)


def windows_with_most_movement(
    recording: Recording, samples: int, most_windows: int
) -> tuple[FitWindow, ...]:
    """The record cut into equal windows of ``samples`` samples and a little more, in order of time;
    of more than ``most_windows`` those with the most useful movement of OP, as
    ``choose_fit_window`` measures it. Empty where OP is not known.
    """
    count = len(recording) // max(samples, 2)
    movement = _Movement.of(recording)
    if movement is None or count < 1:
        return ()
    length = len(recording) // count
    first = np.arange(count) * length
    chosen = np.argsort(-movement.worth(first, length), kind="stable")[:most_windows]
    return tuple(movement.window(int(begin), length) for begin in np.sort(first[chosen]))


@dataclass(frozen=True)
class _Movement:
    """The legs of OP's path: ``turns`` the samples where it reverses by ``threshold`` percent,
    ``path`` (n + 1,) the path length so far, ``good`` (n + 1,) the usable samples so far.
    """

    turns: NDArray[np.intp]
    threshold: float
    path: Floats
    good: NDArray[np.intp]

    @classmethod
    def of(cls, recording: Recording) -> _Movement | None:
        """The movement of a recording; ``None`` where hardly any OP is known."""
        op, usable = recording.op.values, recording.usable
        finite = np.flatnonzero(np.isfinite(op))
        if finite.size < 3:
            return None
        span = swing(op)
        threshold = max(TURN_SHARE * span, NOISES * noise_sigma(op), SMALLEST_TURN_PERCENT)
        turns = finite[reversals(op[finite], threshold)]
        path = np.zeros(len(recording) + 1)
        path[turns[1:] + 1] = np.minimum(np.abs(np.diff(op[turns])), span)
        good = np.concatenate(([0], np.cumsum(usable)))
        return cls(turns, float(threshold), np.cumsum(path), good)

    def worth(self, first: NDArray[np.intp], samples: int) -> Floats:
        """(m,) the worth of stretches of ``samples`` samples that begin at ``first`` (m,)."""
        usable = (self.good[first + samples] - self.good[first]) / samples
        return np.asarray(_worth_of_windows(self.path, first, samples) * usable)

    def window(self, begin: int, samples: int) -> FitWindow:
        """The stretch that begins at ``begin``."""
        turn_count = np.count_nonzero((self.turns >= begin) & (self.turns < begin + samples))
        return FitWindow(begin, begin + samples, int(turn_count), self.threshold)


def _worth_of_windows(path: Floats, first: NDArray[np.intp], samples: int) -> Floats:
    """(m,) the worth of OP's path in both halves, for stretches that begin at ``first`` (m,)."""
    middle = first + samples // 2
    early, late = path[middle] - path[first], path[first + samples] - path[middle]
    return np.asarray(np.minimum(early, late) + WHOLE_SHARE * (early + late))


def window_sentence(stretch: FitWindow, recording: Recording) -> str:
    """One sentence for the report: which stretch was fitted and why that one."""
    part = recording.part(stretch.first, stretch.last)
    window_text = f"samples {stretch.first + 1} to {stretch.last}"
    if part.start is not None and part.end is not None:
        window_text = f"{part.start:%Y-%m-%d %H:%M:%S} to {part.end:%Y-%m-%d %H:%M:%S} UTC"
    return (
        f"The models are fitted to {window_text}, {stretch.length / len(recording):.0%} of the "
        f"record: where OP works the valve most, turning round {times(stretch.turns)} by at least "
        f"{stretch.turn_percent:.2g} %. Data quality and movement are those of the whole record."
    )


def on_whole_clock(trace: Floats, first: int, samples: int) -> Floats:
    """(samples,) a trace of a stretch that begins at ``first``, NaN outside it."""
    whole_record = np.full(samples, np.nan)
    whole_record[first : first + trace.size] = trace
    return whole_record
