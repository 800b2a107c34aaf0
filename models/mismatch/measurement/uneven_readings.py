"""Position readings that were taken at uneven instants, though their stamps are even.

A gateway that polls the position when it can, and stamps it when it stores it, gives a position
that is late by another amount in every sample. On the average that is a dead time; what tells the
two apart is the single sample. A dead time delays all samples of a move by the same amount, and a
breakaway that comes early or late shifts all samples of its move too; a reading of uneven age moves
to and fro within the move.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d
from scipy.special import logsumexp

from stemwatch.models.recording import Bools, Floats

# Of 80 simulated valves with a dead time (`prove --effect dead_time --seed 4071`) none gained more
# than 42; of the 17 of 80 with uneven readings to which a delay was fitted (`prove --effect
# sampling_jitter --seed 4070`) none less than 70.
LEAST_GAIN = 50.0  # natural logarithm of the likelihood
HALF_WIDTHS = (0.5, 1.0, 1.5, 2.0)  # samples, of the ages about their mean
AGES = 21  # at which the likelihood is summed over each width
FAST = 4.0  # times the noise that the stem must move within the width, to be called moving
STRAY = 0.05  # share of readings that lie anywhere
FEWEST = 4  # samples of moves
AT_REST = 0.005  # percent a sample
FEWEST_AT_REST = 20
MAD_TO_SIGMA = 1.4826


@dataclass(frozen=True)
class UnevenReadings:
    """Ages spread evenly over ``half_width`` samples on either side of their mean.

    ``gain`` is by how much the logarithm of the likelihood is larger than both with one age for
    each move and with the same age everywhere.
    """

    half_width: float
    gain: float


def find_uneven_readings(
    run: Floats, mv: Floats, measured: Bools, sigma: float
) -> UnevenReadings | None:
    """The uneven ages of the readings ``mv`` (n,) percent of a stem that moved like ``run`` (n,), a
    model's with its mean delay in it; ``None`` where one age for each move says as much.

    With ``z`` the residual over its noise, ``p(z) = (1 - a) N(z) + a / range`` and the ages ``d``
    even over ``[-w, w]``, a sample of its own age has the likelihood ``mean over d of
    p(z_k(d))``, and a move of one age ``mean over d of the product over k of p(z_k(d))``.
    ``measured`` (n,) marks readings that count, ``sigma`` is their noise, percent.
    """
    sigma = _noise(run, mv, measured, sigma)
    found = [
        one
        for half_width in HALF_WIDTHS
        if (one := _with_ages(run, mv, measured, sigma, half_width)) is not None
    ]
    best = max(found, key=lambda one: one.gain, default=None)
    return best if best is not None and best.gain >= LEAST_GAIN else None


def _noise(run: Floats, mv: Floats, measured: Bools, sigma: float) -> float:
    """What a reading is off by where the stem stands, percent; at least ``sigma``."""
    still = np.abs(np.diff(run)) < AT_REST
    rest = measured & np.append(True, still) & np.append(still, True)
    if np.count_nonzero(rest) < FEWEST_AT_REST:
        return sigma
    return max(sigma, MAD_TO_SIGMA * float(np.median(np.abs(mv[rest] - run[rest]))))


def _with_ages(
    run: Floats, mv: Floats, measured: Bools, sigma: float, half_width: float
) -> UnevenReadings | None:
    """What ages of this width gain."""
    window = 2 * int(np.ceil(half_width)) + 1
    way = maximum_filter1d(run, window) - minimum_filter1d(run, window)
    moving = way > FAST * sigma
    counted = np.flatnonzero(moving & measured)
    if counted.size < FEWEST:
        return None
    ages = np.linspace(-half_width, half_width, AGES)
    read = np.interp(counted[:, None] - ages, np.arange(run.size), run)
    z = (mv[counted, None] - read) / sigma
    reach = max(float(np.ptp(mv[measured])) / sigma, 1.0)
    normal = (1.0 - STRAY) * np.exp(-0.5 * z * z) / np.sqrt(2.0 * np.pi)
    log_p = np.log(normal + STRAY / reach)
    moves = np.append(0, np.flatnonzero(np.diff(counted) > 1) + 1)
    of_samples = float(np.sum(logsumexp(log_p, axis=1) - np.log(AGES)))
    of_moves = float(np.sum(logsumexp(np.add.reduceat(log_p, moves), axis=1) - np.log(AGES)))
    same = float(np.sum(log_p[:, AGES // 2]))
    return UnevenReadings(half_width, of_samples - max(of_moves, same))
