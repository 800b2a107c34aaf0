"""Whether an archive keeps averages or samples, by the steps of signals that people and logic set.

A set point, or an OP in manual, rests, is set anew at once, and rests again. A sample shows it
before or after, never between. An average over n scans holds both wherever the step does not fall
between two averages, n - 1 times of n. So each step from rest to rest votes:

    rest, rest, rest | rest', rest', rest'              at once: samples, or one average of n
    rest, rest, rest, between, rest', rest', rest'      averages, or a ramp of about one row

Of five steps that averages over five scans hold, two or more come at once in 26 %, four or more in
0.7 %.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stemwatch.models.recording import Bools, Floats, Recording, Role, kept

REST_ROWS = 3
REST = 0.02  # of the step, by which a signal at rest may move, as by the last digit
BETWEEN = 0.02  # of the step, from either end
# A step is larger than what the signal usually does from row to row (this percentile of it).
USUAL, TIMES = 90.0, 3.0
FEWEST = 4
AVERAGES_FROM, SAMPLES_UP_TO = 0.7, 0.2  # share of the steps that come by a value between


@dataclass(frozen=True)
class StepsFromRest:
    """Steps from rest to rest: how many came ``at_once``, and how many by a value ``between``."""

    at_once: int
    between: int

    @property
    def averages(self) -> bool | None:
        """Whether an archive keeps averages; ``None`` where too few steps, or steps of both kinds,
        leave it open."""
        count = self.at_once + self.between
        share = self.between / max(count, 1)
        if count < FEWEST or SAMPLES_UP_TO < share < AVERAGES_FROM:
            return None
        return share >= AVERAGES_FROM


@kept
def keeps_averages(recording: Recording) -> bool | None:
    """Whether the archive of a ``recording`` keeps averages, by the steps of OP and set point;
    ``None`` where they do not show it."""
    counted = [
        steps_from_rest(signal.values, signal.usable)
        for role, signal in recording.signals.items()
        if role in (Role.OP, Role.SP)
    ]
    return StepsFromRest(
        at_once=sum(one.at_once for one in counted),
        between=sum(one.between for one in counted),
    ).averages


def steps_from_rest(values: Floats, usable: Bools) -> StepsFromRest:
    """The steps of a signal (n,) from rest to rest."""
    if np.count_nonzero(usable) <= 2 * REST_ROWS + 1:
        return StepsFromRest(0, 0)
    moves = np.abs(np.diff(values))
    moves = moves[np.isfinite(moves)]
    least = TIMES * float(np.percentile(moves, USUAL)) if moves.size else np.inf
    at_once, _ = _from_rest_to_rest(values, usable, between=0)
    by_a_row, share = _from_rest_to_rest(values, usable, between=1)
    between = (np.abs(by_a_row) > least) & (np.abs(share - 0.5) < 0.5 - BETWEEN)
    return StepsFromRest(
        at_once=int(np.count_nonzero(np.abs(at_once) > least)),
        between=int(np.count_nonzero(between)),
    )


def _from_rest_to_rest(values: Floats, usable: Bools, *, between: int) -> tuple[Floats, Floats]:
    """(m,) the steps over windows of two rests with so many rows ``between``, 0 where they are no
    rests; and which share of it the first row after the first rest has."""
    rows = np.lib.stride_tricks.sliding_window_view(values, 2 * REST_ROWS + between)
    before, after = rows[:, :REST_ROWS], rows[:, -REST_ROWS:]
    step = after[:, 0] - before[:, -1]
    rests = np.maximum(np.ptp(before, axis=1), np.ptp(after, axis=1)) <= REST * np.abs(step)
    good = np.lib.stride_tricks.sliding_window_view(usable, rows.shape[1]).all(axis=1)
    step = np.where(good & rests, step, 0.0)
    share = np.zeros(step.shape)
    np.divide(rows[:, REST_ROWS] - before[:, -1], step, out=share, where=step != 0.0)
    return step, share
