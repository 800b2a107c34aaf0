"""Onsets of motion: when the recorded stem breaks away, from the position alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.compiled import compiled
from stemwatch.models.recording import Bools, Floats

REST_S = 3.0  # a stem rests when it has not moved for this long, or for three samples
DEPARTS = 4.5  # standard deviations of the noise: beyond it twice in a row, or beyond twice it once
LEAST_PERCENT = 0.15
MEMORY = 5  # samples over which a resting position is averaged: a stem may creep
Samples = NDArray[np.int64]


@dataclass(frozen=True)
class Onsets:
    """``at`` (m,) first samples of motion after a rest, ``side`` (m,) 1.0 rising, -1.0 falling,
    ``rested`` (m,) the samples rested before, ``place`` (m,) where, percent of MV."""

    at: Samples
    side: Floats
    rested: Samples
    place: Floats

    def upcoming(self, n: int) -> tuple[Samples, Samples]:
        """(n,) each: the next onset at or after a sample, rising and falling; n where none."""
        return _upcoming(self.at[self.side > 0], n), _upcoming(self.at[self.side < 0], n)


def _upcoming(starts: Samples, n: int) -> Samples:
    padded = np.append(starts, n)
    return np.asarray(padded[np.searchsorted(starts, np.arange(n), side="left")]).astype(np.int64)


@compiled()
def _scan(
    mv: Floats,
    usable: Bools,
    threshold: float,
    rest_samples: int,
    starts: Samples,
    side: Floats,
    rested: Samples,
    places: Floats,
) -> int:
    """Follow the position: at rest until it departs from its mean, in motion until it stops
    changing.
    """
    count = 0
    resting = False
    total, samples, lasted = 0.0, 0, 0
    for k in range(1, mv.size):
        if not usable[k] or not usable[k - 1]:
            resting, samples = False, 0
            continue
        if resting:
            mean = total / samples
            deviation = mv[k] - mean
            ahead = mv[k + 1] - mean if k + 1 < mv.size else deviation
            departed = abs(deviation) > 2.0 * threshold or (
                abs(deviation) > threshold and ahead * deviation > 0 and abs(ahead) > threshold
            )
            if departed:
                starts[count], rested[count], places[count] = k, lasted, mean
                side[count] = 1.0 if deviation > 0 else -1.0
                count += 1
                resting, samples = False, 0
            else:
                # The mean of the last samples only: a stem may creep, a reading may drift.
                if samples < MEMORY:
                    total += mv[k]
                else:
                    total += mv[k] - total / samples
                samples = min(samples + 1, MEMORY)
                lasted += 1
        else:
            samples += 1
            if samples >= rest_samples:
                low = high = mv[k]
                for i in range(k - rest_samples + 1, k + 1):
                    low, high = min(low, mv[i]), max(high, mv[i])
                if high - low <= threshold:
                    resting, lasted = True, rest_samples
                    samples, total = min(rest_samples, MEMORY), 0.0
                    for i in range(k - samples + 1, k + 1):
                        total += mv[i]
    return count


def least_departure(sigma: float) -> float:
    """How far a stem must depart from its place to be seen in motion, with noise ``sigma``."""
    return max(DEPARTS * sigma, LEAST_PERCENT)


def onsets(mv: Floats, usable: Bools, sigma: float, interval_s: float) -> Onsets:
    """The breakaways of a position (n,) with noise ``sigma``, percent; finite where usable."""
    n = mv.size
    threshold = least_departure(sigma)
    rest_samples = max(round(REST_S / interval_s), 3)
    starts, rested = np.empty(n, np.int64), np.empty(n, np.int64)
    side, places = np.empty(n), np.empty(n)
    count = _scan(mv, usable, threshold, rest_samples, starts, side, rested, places)
    return Onsets(starts[:count], side[:count], rested[:count], places[:count])
