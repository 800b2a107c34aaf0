"""A position that swings by itself: its command does not have the swing, and noise has no period.

A positioner whose gain or integral action is too high for its actuator and packing hunts: the stem
goes to and fro about a command that stands. So does a stem that a pulsating flow shakes. Neither
needs to stick, and a fit of friction then finds a small S and takes the swing for noise, for from
one sample to the next it is as large. With the residual ``r = MV - model``, its power ``P(f)``,
that of the command ``C(f)`` and their cross power ``X(f)`` (Welch 1967,
doi:10.1109/TAU.1967.1161901), the position swings at the highest line ``f0`` where, over the band
``B`` from 3/4 to 4/3 of it,

    P(f0) is three times P about half of it, and five times the median of P, and
    the sum of P over B is nine times that of C, or |X|^2/C is less than half of it.

The swing is then ``2 sqrt(2 sum of P over B)`` from peak to peak. The first condition keeps out
white noise and what wanders, the second a loop that oscillates: what the command does explains the
residual there. A swing slower than 43 samples is not looked for; the controller answers it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.recording import Bools, Floats
from stemwatch.models.stickslip.problem import FitProblem

Lines = NDArray[np.complex128]

SEGMENT, STEP = 256, 128  # samples
LEAST_KNOWN = 0.9  # of a segment
FEWEST = 3  # segments
FIRST = 6  # line of the slowest swing, of SEGMENT samples: 43 samples
BELOW, BAND = (0.35, 0.65), (0.75, 4.0 / 3.0)  # of the line's frequency
# White noise of any size reaches 2.2 and 2.
ABOVE_SLOWER, ABOVE_MEDIAN = 3.0, 5.0
OVER_COMMAND = 9.0  # times its power: three times its amplitude
MOST_EXPLAINED = 0.5  # of the power, by the command
NO_POWER = 1e-30


@dataclass(frozen=True)
class OwnSwing:
    """A swing of ``percent`` of travel from peak to peak, every ``period_s`` seconds."""

    period_s: float
    percent: float


def own_swing(problem: FitProblem, run: Floats) -> OwnSwing | None:
    """The swing of the position about the model's ``run`` (n,), percent, that the command does not
    have; ``None`` where there is none, or where too few samples in a row are known.
    """
    known = problem.scored
    starts = [
        start
        for start in range(0, known.size - SEGMENT + 1, STEP)
        if known[start : start + SEGMENT].mean() >= LEAST_KNOWN
    ]
    if len(starts) < FEWEST:
        return None
    rows = np.array(starts)[:, None] + np.arange(SEGMENT)
    residual = _lines((problem.mv - run)[rows], known[rows])
    command = _lines(problem.op[rows], known[rows])
    own = _mean_power(residual)
    line = FIRST + int(np.argmax(own[FIRST:]))
    slower = own[int(BELOW[0] * line) : int(BELOW[1] * line) + 1]
    if own[line] < max(ABOVE_SLOWER * slower.mean(), ABOVE_MEDIAN * float(np.median(own))):
        return None
    band = slice(int(np.ceil(BAND[0] * line)), int(BAND[1] * line) + 1)
    if _is_of_command(residual[:, band], command[:, band]):
        return None
    return OwnSwing(
        period_s=problem.interval_s * SEGMENT / line,
        percent=2.0 * float(np.sqrt(2.0 * own[band].sum())),
    )


def _lines(parts: Floats, known: Bools) -> Lines:
    """(k, m) the spectra of ``parts`` (k, SEGMENT), so that the sums of their squares are
    variances."""
    kept = np.where(known, parts, 0.0)
    mean = kept.sum(axis=1, keepdims=True) / known.sum(axis=1, keepdims=True)
    window = np.hanning(SEGMENT)
    scale = np.sqrt(2.0 / (SEGMENT * float(window @ window)))
    return np.asarray(scale * np.fft.rfft(np.where(known, kept - mean, 0.0) * window, axis=1))


def _mean_power(lines: Lines) -> Floats:
    """(m,) the mean power at each frequency."""
    return np.asarray((np.abs(lines) ** 2).mean(axis=0))


def _is_of_command(residual: Lines, command: Lines) -> bool:
    """Whether the command has the swing as well, and explains half of it."""
    own, of_command = _mean_power(residual), _mean_power(command)
    if own.sum() >= OVER_COMMAND * of_command.sum():
        return False
    cross = np.abs((residual * np.conj(command)).mean(axis=0)) ** 2
    explained = cross / np.maximum(of_command, NO_POWER)
    by_chance = own / len(residual)  # of two signals that have nothing to do with each other
    return bool((explained - by_chance).sum() >= MOST_EXPLAINED * (own - by_chance).sum())
