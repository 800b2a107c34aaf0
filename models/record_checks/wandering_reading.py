"""A position reading that wanders up and down by itself, over minutes to hours.

A transmitter in the sun, a loose magnet or moisture in its terminals moves the reading while the
stem stands. A fit of friction sees a stem far from its command, and in a slow archive a loop that
was sampled too slowly. Here three accounts of the position compete on samples that none was fitted
to, each with a bent line of OP and with OP behind several lags:

    nothing more,   a stem that stays within S/2 of OP,   a course of time between K knots

A reading that wanders is told by the last one alone, and its stem goes with OP within each few
samples, which one that sticks does not. Slower than ``SLOW`` it is a drift, which the search for
effects names.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stemwatch.models.compiled import compiled
from stemwatch.models.preparation.own_clock import period
from stemwatch.models.recording import PERCENT, Bools, Floats, Recording
from stemwatch.models.signals.excitation import reversals
from stemwatch.models.signals.first_order_lag import first_order_lag

MOST_SAMPLES, FEWEST_SAMPLES = 4000, 300  # of the samples so many are looked at, evenly spaced
BEND, LAGS = 5, (1.0, 3.0, 10.0)  # degree of the line of OP; samples
# A reading that is off by more is taken for the stem's: of 160 valves with a hidden effect
# (`draw_hidden`, 4090) four have a course of 6 % and more, by weak air, speed limits and friction.
MOST_PERCENT = 5.0
KNOTS, OF_A_KNOT = (96, 48, 24, 12), 15  # over the record; samples from one to the next at least
BANDS = (0.15, 0.3, 0.6, 1.0, 1.5, 2.0, 3.0, 4.0)  # halves of S, percent
HELD_OUT, RUN = 4, 3  # every fourth run of three samples is not fitted to
# Of what the better of the other accounts leaves, root mean square, at most so much. `python
# tests/benchmarks/bench_wandering_reading.py` counts what that tells, of true readings as well.
LEFT = 0.6
# Of the samples' own movement within a few, the share that OP tells (median of the livelier half).
GOES_WITH, FEW, PIECES = 0.8, 4, 400
SLOW = 3  # half waves over the record, beside a drift
QUICKER = 0.7  # of what these leave, at most so much
AS_GOOD = 1.1  # times as much as by most knots, up to which fewer knots do
LEAST_PERCENT = 0.7  # of travel, from the 5th to the 95th percentile of the course
QUICKEST_S = 600.0  # what moves quicker may be the stem: see ``pulsing_stem`` and ``own_swing``
LEAST_LEFT = 0.25  # of that, the standard deviation of any such course
RIDGE = 1e-9


@dataclass(frozen=True)
class Wander:
    """How a reading wandered. ``course`` (n,) is what it read too much, percent of travel, zero in
    the middle; ``percent`` its range from the 5th to the 95th percentile; ``period_s`` about the
    time of an up and down, on the record's own clock."""

    course: Floats
    percent: float
    period_s: float

    def sentence(self, unit_s: float) -> str:
        """How far and how slowly."""
        return (
            f"the position reading wanders by {self.percent:.1f} % of travel, up and down in about "
            f"{period(self.period_s, unit_s)}, apart from OP"
        )


def find_wander(recording: Recording) -> Wander | None:
    """The wander of the position reading; ``None`` where none is seen, or none that is quicker than
    a drift, and where OP and position are not both in percent."""
    if recording.mv is None or not recording.mv.unit == recording.op.unit == PERCENT:
        return None
    at = np.flatnonzero(recording.usable)
    if at.size < FEWEST_SAMPLES:
        return None
    at = at[:: -(-at.size // MOST_SAMPLES)]
    op, mv = recording.op.values[at], recording.mv.values[at]
    if np.ptp(op) <= 0.0 or not _goes_with(op, mv):
        return None
    line, time = _line(op), at / len(recording)
    plain = _left(line, mv)
    if plain < LEAST_LEFT * LEAST_PERCENT:
        return None
    of_time = {knots: _hats(time, knots) for knots in KNOTS if at.size >= OF_A_KNOT * knots}
    least = _left(np.column_stack((line, of_time[max(of_time)])), mv)
    if least > LEFT * plain or least > QUICKER * _left(np.column_stack((line, _slow(time))), mv):
        return None
    if least > LEFT * min(_left(np.column_stack((line, _band(op, half))), mv) for half in BANDS):
        return None
    enough = [
        knots
        for knots, hats in of_time.items()
        if _left(np.column_stack((line, hats)), mv) <= AS_GOOD * least
    ]
    return _of_course(recording, line, of_time[min(enough)], mv, min(enough))


def _of_course(
    recording: Recording, line: Floats, hats: Floats, mv: Floats, knots: int
) -> Wander | None:
    """The wander by the fit to all samples, unless it is too small to matter or too quick."""
    slopes = _solved(np.column_stack((line, hats)), mv, np.ones(mv.size, dtype=bool))
    heights = slopes[line.shape[1] :]
    samples = len(recording)
    course = np.interp(np.arange(samples) / samples, np.linspace(0.0, 1.0, knots + 1), heights)
    course -= np.median(course)
    low, high = np.percentile(course, (5.0, 95.0))
    if not LEAST_PERCENT <= high - low <= MOST_PERCENT:
        return None
    turns = reversals(course, 0.4 * float(high - low)).size
    period_s = 2.0 * samples * recording.interval_s / max(turns, 1)
    if period_s * recording.unit_s < QUICKEST_S:
        return None
    return Wander(course, float(high - low), period_s)


def _line(op: Floats) -> Floats:
    """(m, BEND + 1 + lags) a constant and bends of OP, and how far it is ahead of its lags."""
    scaled = 2.0 * (op - op.min()) / np.ptp(op) - 1.0
    behind = [op - op[0] - first_order_lag(op - op[0], samples) for samples in LAGS]
    return np.column_stack((np.polynomial.legendre.legvander(scaled, BEND), *behind))


def _hats(time: Floats, knots: int) -> Floats:
    """(m, knots + 1) how near each time, 0 to 1, is to each knot: straight lines between them."""
    apart = np.abs(time[:, None] * knots - np.arange(knots + 1))
    return np.asarray(np.maximum(1.0 - apart, 0.0))


def _slow(time: Floats) -> Floats:
    """(m, SLOW + 1) a drift, and slow waves on it."""
    waves = np.sin(np.pi * np.outer(time, np.arange(1, SLOW + 1)))
    return np.column_stack((time, waves))


@compiled()
def _band(op: Floats, half: float) -> Floats:
    """(m,) a stem that stays within ``half`` of OP."""
    stem = np.empty_like(op)
    place = op[0]
    for k in range(op.size):
        place = min(max(place, op[k] - half), op[k] + half)
        stem[k] = place
    return stem


def _solved(columns: Floats, values: Floats, fitted: Bools) -> Floats:
    """Slopes by least squares over the ``fitted`` samples."""
    chosen = columns[fitted]
    normal = chosen.T @ chosen
    normal[np.diag_indices_from(normal)] += RIDGE * np.trace(normal) / normal.shape[0]
    return np.asarray(np.linalg.solve(normal, chosen.T @ values[fitted]))


def _left(columns: Floats, values: Floats) -> float:
    """Root mean square of what ``columns`` (m, k) leave of samples they were not fitted to."""
    turn = np.arange(values.size) // RUN % HELD_OUT
    left = []
    for held in (0, HELD_OUT // 2):
        slopes = _solved(columns, values, turn != held)
        left.append(values[turn == held] - columns[turn == held] @ slopes)
    return float(np.sqrt(np.mean(np.concatenate(left) ** 2)))


def _goes_with(op: Floats, mv: Floats) -> bool:
    """Whether the stem goes with OP within each few samples, either way."""
    piece = np.arange(op.size) // max(op.size // PIECES, FEW)
    count = np.bincount(piece)
    of_op, of_mv = (values - (np.bincount(piece, values) / count)[piece] for values in (op, mv))
    both, of_command, of_stem = (
        np.bincount(piece, first * second)
        for first, second in ((of_op, of_mv), (of_op, of_op), (of_mv, of_mv))
    )
    told = both**2 / np.maximum(of_command * of_stem, 1e-12)
    return float(np.median(told[of_stem >= np.median(of_stem)])) >= GOES_WITH
