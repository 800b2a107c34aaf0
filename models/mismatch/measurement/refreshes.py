"""A recording whose values all change at refreshes only, read at these.

An archive that averages over ten seconds, or a gateway that scans every ten, and an export with a
row each second: nine of ten rows repeat the one before, and are no measurements. Command and
position of one refresh belong together. As a recording of a sample every ten seconds it is on its
own clock, and what an archive of averages does to S and J is known there (``between_samples``).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.mismatch.findings import FreeRuns, Mismatch
from stemwatch.models.mismatch.search.breakaway_levels import DWELL
from stemwatch.models.mismatch.search.reading_errors import STICKS_AGAIN
from stemwatch.models.preparation.own_clock import duration, off_own_clock, on_own_clock
from stemwatch.models.recording import Floats, Recording
from stemwatch.models.signals.forensics import position_step
from stemwatch.models.signals.refresh_period import ON_TIME, refresh_period

FEWEST = 80  # refreshes
LEAST_MOVES = 12
MOVES = 6.0  # standard deviations of the noise, from which a step of the position is a move
MEDIAN_STEP = 0.954  # median of the size of a step between two readings of one sigma


@dataclass(frozen=True)
class AtRefreshes:
    """The ``recording`` of one sample for each refresh, on its own clock: every ``period`` samples
    of the one that was read, which had ``samples``, from sample ``phase`` on.
    """

    recording: Recording
    period: int
    phase: int
    samples: int

    @property
    def refused(self) -> dict[str, str]:
        """The effects that show within a refresh only, and why they cannot be tested."""
        every = duration(self.recording.interval_s, self.recording.unit_s, "g")
        reason = f"the values are averages of {every}, or one for all of them, and hide a stop"
        return dict.fromkeys((*STICKS_AGAIN, DWELL), reason)

    def of(self, values: Floats) -> Floats:
        """(m,) values (n,) at the refreshes."""
        return np.asarray(values[self.phase :: self.period])

    def spread(self, mismatch: Mismatch) -> Mismatch:
        """A mismatch of the refreshes with its runs on the clock that was read, held between."""
        runs = mismatch.runs
        if runs is None:
            return mismatch
        last = np.maximum(np.arange(self.samples) - self.phase, 0) // self.period
        held = FreeRuns(
            naive=runs.naive[last],
            extended=runs.extended[last],
            heldout_from=min(runs.heldout_from * self.period + self.phase, self.samples),
            position=None if runs.position is None else runs.position[last],
        )
        return replace(mismatch, runs=held)


def at_refreshes(recording: Recording) -> AtRefreshes | None:
    """The refreshes of a recording; ``None`` where its values may change at any sample, where
    signals have a scan of their own, or where the refreshes are few.

    OP and position must change at the same samples, but for noise that a transmitter may have added
    to what the archive gave. A controller that scans slowly holds its OP too, and no position.
    """
    period, phase = refresh_period(recording.op.values)
    if recording.mv is None or period <= 1 or (len(recording) - phase) // period < FEWEST:
        return None
    position = recording.mv.values
    if refresh_period(position) != (period, phase) and not _moves_at(position, period, phase):
        return None
    return AtRefreshes(_every(recording, period, phase), period, phase, len(recording))


def _moves_at(position: Floats, period: int, phase: int) -> bool:
    """Whether a position (n,) moves by more than its noise and its steps at refreshes only."""
    steps = np.abs(np.diff(position))
    between = (np.arange(1, position.size) - phase) % period != 0
    still = steps[between & np.isfinite(steps)]
    if not still.size:
        return False
    noise = float(np.percentile(still, 50.0)) / MEDIAN_STEP
    moves = steps > max(MOVES * noise, 1.5 * position_step(position[np.isfinite(position)]))
    on_time = np.count_nonzero(moves & ~between)
    return bool(on_time >= max(LEAST_MOVES, ON_TIME * np.count_nonzero(moves)))


def _every(recording: Recording, period: int, phase: int) -> Recording:
    """Every ``period``-th sample from ``phase`` on, on its own clock."""
    recording = off_own_clock(recording)
    places: NDArray[np.int64] = np.arange(phase, len(recording), period)
    signals = {
        role: replace(
            signal,
            values=signal.values[places],
            quality=signal.quality[places],
            interval_s=None,
        )
        for role, signal in recording.signals.items()
    }
    return on_own_clock(
        replace(recording, signals=signals, interval_s=period * recording.interval_s)
    )
