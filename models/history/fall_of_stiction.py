"""``history_since_fall``: where S of a valve fell and stayed low, its history begins anew.

A worn stem does not heal by itself: S that falls, beyond its own scatter, and stays there was
repaired, and what it was before says nothing of the stem that is there now. S fell before the day k
where, with the medians ``before`` and ``after`` of up to ``NEAR`` days on either side of it,

    before - after >= max(LEAST_FALL_PERCENT, LEAST_T * error),
    error = OF_A_MEDIAN * scatter * sqrt(1 / n_before + 1 / n_after),

the day before k lies above the middle between them, and the days from k on that are compared all
lie below it. At least ``STAYS`` days must be there on either side; with fewer after it, it is not
known yet whether S stays there. The scatter of a day is that of the differences of neighbouring
days, whose median no single fall moves.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import date

import numpy as np

from stemwatch.models.recording import Floats

NEAR = 5  # days on either side that are compared
STAYS = 3  # days after a fall, from which it counts
LEAST_FALL_PERCENT = 0.3
LEAST_T = 5.0
LEAST_SCATTER_PERCENT = 0.05
OF_A_MEDIAN = 1.25  # its standard error, in that of a mean


@dataclass(frozen=True, kw_only=True)
class Fall:
    """S fell from ``before`` to ``after``, percent of OP span, between the days ``last`` and
    ``first``, in the days of the history that it was found in."""

    before: float
    after: float
    last: float
    first: float


@dataclass(frozen=True, kw_only=True)
class UnexplainedFall:
    """A ``Fall`` that no recorded work explains; ``on`` is the first day with the smaller S."""

    before: float
    after: float
    on: date

    @property
    def sentence(self) -> str:
        """What it means and asks for."""
        return (
            f"S fell from {self.before:.1f} to {self.after:.1f} % of OP span around "
            f"{self.on:%Y-%m-%d}, and no work is recorded: was this valve repaired? Record it as "
            "maintenance."
        )


@dataclass(frozen=True, kw_only=True)
class SinceFall:
    """The days and S since the last fall; ``fall`` is ``None``, and they are all there are, where
    there was none. ``unsettled``: the newest days are well below those before, and too few yet to
    tell a fall from chance."""

    days: Sequence[float]
    S: Sequence[float]
    fall: Fall | None = None
    unsettled: bool = False


def history_since_fall(days: Sequence[float], S: Sequence[float]) -> SinceFall:
    """``S`` (n,), percent, at ``days`` (n,), since it fell the last time."""
    t, y = np.asarray(days, dtype=np.float64), np.asarray(S, dtype=np.float64)
    scatter = _scatter(y)
    for begin in range(t.size - STAYS, STAYS - 1, -1):
        if _fell(y, begin, scatter):
            before, after = _levels(y, begin)
            fall = Fall(before=before, after=after, last=float(t[begin - 1]), first=float(t[begin]))
            return SinceFall(days=days[begin:], S=S[begin:], fall=fall)
    newest = range(max(t.size - STAYS + 1, STAYS), t.size)
    unsettled = any(_fell(y, begin, scatter) for begin in newest)
    return SinceFall(days=days, S=S, unsettled=unsettled)


def _scatter(y: Floats) -> float:
    if y.size < 2:
        return LEAST_SCATTER_PERCENT
    between = float(np.median(np.abs(np.diff(y)))) / 0.6745 / math.sqrt(2.0)
    return max(between, LEAST_SCATTER_PERCENT)


def _levels(y: Floats, begin: int) -> tuple[float, float]:
    """The medians of the days near ``begin``, before it and from it on."""
    before, after = y[max(begin - NEAR, 0) : begin], y[begin : begin + NEAR]
    return float(np.median(before)), float(np.median(after))


def _fell(y: Floats, begin: int, scatter: float) -> bool:
    """Whether S is lower from the day ``begin`` on than before it."""
    before, after = _levels(y, begin)
    n_before, n_after = min(begin, NEAR), min(y.size - begin, NEAR)
    error = OF_A_MEDIAN * scatter * math.sqrt(1.0 / n_before + 1.0 / n_after)
    middle = 0.5 * (before + after)
    stays = bool(y[begin - 1] > middle and np.all(y[begin : begin + NEAR] < middle))
    return stays and before - after >= max(LEAST_FALL_PERCENT, LEAST_T * error)
