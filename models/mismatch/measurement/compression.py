"""What a historian dropped: straight lines between stored points, or a last report that is held."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.recording import Bools, Floats
from stemwatch.models.signals.forensics import COARSE_PERCENT, quantum
from stemwatch.models.signals.runs_of_samples import Runs, long_runs, runs_of

LEAST_SAMPLES = 60
# Swinging-door compression drops most of a signal; in a measured signal hardly any three points lie
# on one line.
LEAST_DRAWN = 0.25
LEAST_LINES = 12
COARSEST_DIGIT = 0.02  # percent
SHARP = 4.0  # times the bend that printing makes
ONE_SPEED = (
    0.5  # share of the interpolated samples that one slope each way may have; more is a speed limit
)
LEAST_REPORTS, HELD_SHARE = 30, 0.3
LEAST_DEVIATION, FINE_DEVIATION = 0.05, 0.3  # percent
JUST_ABOVE = 0.3  # share of the reports within 30 % of the smallest
IMPOSSIBLE = 0.03  # share of the reports that no stem could have caused
NARROWEST_DOOR, WIDEST_DOOR = 0.05, 0.5  # percent
DOOR_NOISE = 0.17  # of the deviation: least noise of a signal that is known to within it
# White noise through a swinging door (40,000 samples each): the share that is kept, and the noise,
# in deviations. Where less is kept, the moves of the stem may be what keeps it.
KEPT_OF_NOISE = (0.20, 0.24, 0.33, 0.45, 0.53, 0.60, 0.65, 0.72, 0.81)
NOISE_OF_KEPT = (0.46, 0.50, 0.60, 0.80, 1.00, 1.25, 1.50, 2.00, 3.00)
DOOR_WINDOW = 60  # samples, over which the kept share is taken
_RELATIVE_ZERO = 1e-9


@dataclass(frozen=True)
class StoredPoints:
    """``stored`` (n,) True at samples the archive stored; ``kept`` their share; ``held`` where it
    repeats the last report instead of drawing lines; ``deviation`` of the reports, percent."""

    stored: Bools
    kept: float
    held: bool
    deviation: float = 0.0


def _bends(values: Floats) -> tuple[Floats, Floats]:
    """(n,) second difference and slope per sample at each inner sample; NaN at ends and gaps."""
    bend, slope = np.full(values.size, np.nan), np.full(values.size, np.nan)
    bend[1:-1] = values[2:] - 2.0 * values[1:-1] + values[:-2]
    slope[1:-1] = 0.5 * (values[2:] - values[:-2])
    return bend, slope


def _resolution(values: Floats) -> float:
    """The last digit of the printed values, or 0: their differences' common step."""
    for digits in range(6):
        step = 10.0**-digits
        if np.all(np.abs(values / step - np.round(values / step)) < 1e-6):
            return step
    return 0.0


def drawn_lines(values: Floats, other: Floats) -> StoredPoints | None:
    """Stored points of a signal (n,) whose other samples lie on straight lines; else ``None``.

    Lines with the same slope as ``other`` (n,) are a stem that follows a ramp, and a signal with
    one slope each way is a stem at its top speed: the archive made neither.
    """
    finite = np.isfinite(values)
    if np.count_nonzero(finite) < LEAST_SAMPLES:
        return None
    digit = _resolution(values[finite])
    if digit > COARSEST_DIGIT:
        return None  # with steps this coarse, points lie on lines by chance
    zero = _RELATIVE_ZERO * max(float(np.max(np.abs(values[finite]))), 1e-12)
    bend, slope = _bends(values)
    # Each of the three values may be off by half a digit, so a bend by two.
    tolerance = np.maximum(1e-6 * np.abs(slope), max(4.0 * zero, 2.001 * digit))
    straight = np.abs(bend) <= tolerance
    sloped = np.abs(slope) > max(16.0 * zero, 2.0 * digit)
    lines = long_runs(straight & sloped, 3 if digit > 0.0 else 1)
    follows = np.abs(slope - _bends(other)[1]) <= 0.1 * np.abs(slope)
    drawn_here = lines & ~follows
    inner = np.isfinite(bend) & ~(straight & ~sloped)
    if np.count_nonzero(inner) < LEAST_SAMPLES or drawn_here.sum() < LEAST_DRAWN * inner.sum():
        return None
    if len(runs_of(drawn_here)) < LEAST_LINES:
        return None
    # Short and flat lines are the archive's as well.
    stored = finite & ~straight
    # No stem at its top speed turns at the recorder's steps alone and passes between them.
    between_steps = quantum(values[stored]) >= COARSE_PERCENT and quantum(values) == 0.0
    if _one_speed(slope[drawn_here]) and not between_steps:
        return None
    kinks = np.abs(bend[np.isfinite(bend) & ~straight])
    # A smooth signal printed with few digits bends a little everywhere; an interpolated one bends
    # at its knots only.
    if digit > 0.0 and kinks.size and float(np.median(kinks)) < SHARP * 2.0 * digit:
        return None
    kept_share = float(stored.sum() / finite.sum())
    return StoredPoints(
        stored=stored,
        kept=kept_share,
        held=False,
        deviation=swinging_door_deviation(values, stored),
    )


def flat_lines(values: Floats, points: StoredPoints) -> Runs:
    """(m, 2) first and last + 1 of each line that the archive drew and in which it may have hidden
    a signal (n,) that stood still: its ends differ by no more than two deviations, and the signal
    goes further elsewhere, up and down. (At a stop a stem stands still while OP moves on.)
    """
    stored = np.flatnonzero(points.stored)
    first, last = stored[:-1], stored[1:]
    lower, upper = np.sort((values[first], values[last]), axis=0)
    low, high = np.nanmin(values) + points.deviation, np.nanmax(values) - points.deviation
    flat = (upper - lower <= 2.0 * points.deviation) & (lower > low) & (upper < high)
    flat_ones: Runs = np.stack((first, last + 1), axis=1)[flat]
    return flat_ones


def swinging_door_deviation(values: Floats, stored: Bools) -> float:
    """The deviation of the archive that drew the lines, percent, or a little more.

    A stored point between two stored neighbours lay farther from the line between them than the
    deviation, else the archive would have dropped it.
    """
    stored_index = np.flatnonzero(stored)
    if stored_index.size < 3:
        return WIDEST_DOOR
    first, middle, last = stored_index[:-2], stored_index[1:-1], stored_index[2:]
    share = (middle - first) / (last - first)
    bend = np.abs(values[middle] - values[first] - share * (values[last] - values[first]))
    close = bend[last - first == 2]
    least = float(close.min()) if close.size else WIDEST_DOOR
    return float(np.clip(min(least, float(np.median(bend))), NARROWEST_DOOR, WIDEST_DOOR))


def noise_behind_door(stored: Bools, deviation: float) -> float:
    """The noise of a signal, in its own unit, of which a swinging door kept the samples ``stored``
    (n,); the ``deviation`` of the door is in the same unit.

    Stored points do not show it directly: they are stored where the signal bends. But noise beyond
    a third of the deviation gets through the door by itself, and the more of it the more samples
    are kept: their share in the median window of 60 samples tells how much.
    """
    least, count = DOOR_NOISE * deviation, stored.size // DOOR_WINDOW
    if not count:
        return least
    windows = stored[: count * DOOR_WINDOW].reshape(count, DOOR_WINDOW)
    kept = float(np.median(windows.mean(axis=1)))
    if kept < KEPT_OF_NOISE[0]:
        return least
    return max(least, deviation * float(np.interp(kept, KEPT_OF_NOISE, NOISE_OF_KEPT)))


def _one_speed(slopes: Floats) -> bool:
    """True where one slope each way makes up most of the interpolated samples."""
    at_usual_speed = 0
    for side in (slopes[slopes > 0.0], -slopes[slopes < 0.0]):
        if side.size:
            usual_speed = float(np.median(side))
            at_usual_speed += int(
                np.count_nonzero(np.abs(side - usual_speed) <= 0.01 * usual_speed)
            )
    return at_usual_speed > ONE_SPEED * slopes.size


def held_reports(values: Floats, other: Floats) -> StoredPoints | None:
    """Reports of a signal (n,) that is held until it has moved by a deviation; else ``None``.

    They show as long repeats, and as steps that are never small and not multiples of one
    resolution; a measured stem has small steps while it slides or slips. A stem that only rests and
    jumps would look the same without noise, so a deviation of 0.3 % or more is believed only where
    many steps lie just above it, or turn back although ``other`` (n,), the command, has not moved
    as far.
    """
    finite = np.isfinite(values)
    steps = np.diff(values)
    report_index = np.flatnonzero(np.isfinite(steps) & (np.abs(steps) > _RELATIVE_ZERO * 100.0))
    known_count = np.count_nonzero(np.isfinite(steps))
    if (
        report_index.size < LEAST_REPORTS
        or report_index.size > (1.0 - HELD_SHARE) * known_count
        or quantum(values) > 0.0
    ):
        return None
    sizes = np.abs(steps[report_index])
    deviation = float(np.partition(sizes, 1)[1])
    if deviation < LEAST_DEVIATION:
        return None
    just_above = float(np.mean(sizes <= 1.3 * deviation))
    seen = just_above >= JUST_ABOVE or _impossible(steps, report_index, other) >= IMPOSSIBLE
    if deviation > FINE_DEVIATION and not seen:
        return None
    stored = np.zeros(values.size, dtype=bool)
    stored[report_index + 1] = True
    stored &= finite
    kept_share = float(stored.sum() / finite.sum())
    return StoredPoints(stored=stored, kept=kept_share, held=True, deviation=deviation)


def _impossible(steps: Floats, report_index: NDArray[np.int64], other: Floats) -> float:
    """Share of the steps that turn back while ``other`` moved by less than the step."""
    turns = steps[report_index[1:]] * steps[report_index[:-1]] < 0.0
    moved = np.array(
        [np.ptp(other[a : b + 2]) for a, b in pairwise(report_index)], dtype=np.float64
    )
    return float(np.mean(turns & (moved < np.abs(steps[report_index[1:]]))))
