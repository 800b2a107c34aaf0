"""``Timeline``: the times of a tag's samples, with quantities derived from them.

The tags of a valve mostly share their times, so each quantity is computed once.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stemwatch.connectors.historian.times.time_fields import Ints
from stemwatch.models.recording import Floats

_EXCEPTION_SPREAD = 3.0  # steps' 90th percentile over their median: reported by exception
_FEWEST_STEPS = 10  # from which reporting by exception can be recognised


@dataclass(frozen=True, eq=False)
class Timeline:
    """``ns`` (n,) nanoseconds, in order but for the rows of a file as they stand in it; a time may
    be there more than once."""

    ns: Ints

    @cached_property
    def distinct(self) -> Ints:
        """The times in rising order, each once, ns since 1970."""
        return distinct_times(self.ns)

    @cached_property
    def steps(self) -> Floats:
        """Nanoseconds from each distinct time to the next."""
        return np.diff(self.distinct).astype(np.float64)

    @cached_property
    def usual_step(self) -> float | None:
        """The median step; ``None`` of fewer than two times."""
        return middle(self.steps) if self.steps.size else None

    @cached_property
    def ticks(self) -> Ints:
        """(n,) the times in whole usual steps after the first; zeros where there is no step."""
        if self.usual_step is None:
            return np.zeros(self.ns.size, dtype=np.int64)
        ticks = np.round((self.ns - self.distinct[0]) / self.usual_step)
        return np.asarray(ticks, dtype=np.int64)

    @cached_property
    def by_exception(self) -> bool:
        """Whether the samples come when the tag changes, not at even steps."""
        steps, usual_step = self.steps, self.usual_step
        if usual_step is None or steps.size < _FEWEST_STEPS:
            return False
        if usual_step == steps.max() == steps.min():
            return False
        off_step = np.abs(steps - usual_step) > 0.2 * usual_step
        return bool(
            np.percentile(steps, 90) > _EXCEPTION_SPREAD * usual_step or off_step.mean() > 0.5
        )


def distinct_times(ns: Ints) -> Ints:
    """``ns`` in order, each time once; without a sort where it is so already."""
    return ns if ns.size and bool((ns[1:] > ns[:-1]).all()) else np.unique(ns)


def middle(steps: Floats | Ints) -> float:
    """The median; without looking for it where all are equal, as those of a good clock are."""
    low = steps.min()
    return float(low if low == steps.max() else np.median(steps))
