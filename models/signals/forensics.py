"""What recorder and historian did to a signal, from its values alone: noise, resolution, repeats.

Every function takes a one-dimensional array that may hold NaN (a gap) and looks only at pairs or
triples of neighbouring finite samples, so that a gap is never taken for a step.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.recording import Bools, Floats
from stemwatch.models.signals.kept_of_array import kept_of_array
from stemwatch.models.signals.runs_of_samples import equal_runs
from stemwatch.models.statistics.quantiles import median, percentiles

# Differences this small against the signal's own size are floating-point noise.
_RELATIVE_ZERO = 1e-9
# White noise reverses at two samples of three, a moving stem hardly ever.
NOISE_TURNS = 0.4


def _steps(values: Floats) -> Floats:
    """(m,) differences of neighbouring finite samples."""
    steps = np.diff(values)
    return np.asarray(steps[np.isfinite(steps)])


def _zero(values: Floats) -> float:
    finite = values[np.isfinite(values)]
    return _RELATIVE_ZERO * max(float(np.max(np.abs(finite))), 1e-12) if finite.size else 0.0


@kept_of_array
def noise_sigma(values: Floats) -> float:
    """Standard deviation of white measurement noise, in the signal's own unit.

    ``1.4826 MAD(y[k+1] - 2 y[k] + y[k-1]) / sqrt(6)``: second differences do not see a steady
    motion and the median does not see slips. A quantised or noiseless signal gives 0; widen by
    ``quantum / sqrt(12)`` where that matters.
    """
    bends = np.diff(values, n=2)
    bends = bends[np.isfinite(bends)]
    if bends.size < 3:
        return 0.0
    return float(1.4826 * median(np.abs(bends - median(bends))) / np.sqrt(6.0))


QUIET_WINDOW = 30  # samples
LEAST_WINDOWS = 5
COARSE_PERCENT = 0.1  # a finer step of a recorder is not mentioned
MOST_REPEATS = 0.93  # share of repeats, up to which a signal shows its recorder's step
MANY_CHANGES = 100  # from which on it does so however long it rests between them, as a stuck stem
LEAST_SIZES = 5  # of the changes of a position, that are no slips of one size


def medians_of_three(values: Floats) -> Floats:
    """(n - 2,) each of ``values`` (n,) but the first and last as the median of itself and its
    neighbours, so that a single wrong reading is gone.
    """
    return np.asarray(np.median(np.stack((values[:-2], values[1:-1], values[2:])), axis=0))


def quiet_sigma(values: Floats) -> float:
    """``noise_sigma`` over the quieter windows, for a stem that moves nearly all the time.

    Such a stem has larger second differences than the noise. The estimate is the 20th percentile
    over windows of 30 samples, times 1.15 (the bias of that percentile for white noise), and never
    above ``noise_sigma``.
    """
    sigma_of_all = noise_sigma(values)
    count = values.size // QUIET_WINDOW
    if count < 5:
        return sigma_of_all
    bent = np.isfinite(np.convolve(values, (1.0, 1.0, 1.0), "valid"))
    windows = zip(np.array_split(values[1:-1], count), np.array_split(bent, count), strict=True)
    # A window with few measured samples gives no estimate of the noise.
    parts = [
        noise_sigma(part)
        for part, finite in windows
        if np.count_nonzero(finite) >= QUIET_WINDOW // 2
    ]
    if len(parts) < LEAST_WINDOWS:
        return sigma_of_all
    return min(sigma_of_all, 1.15 * float(np.percentile(parts, 20.0)))


@kept_of_array
def quantum(values: Floats) -> float:
    """The recorder's resolution: the step of which (nearly) all differences are multiples, or 0.

    The smallest common step is tried first and accepted when 99 % of the differences are multiples
    of it within 2 %; a signal with fewer than 8 changes cannot show a step and gives 0.
    """
    steps = np.abs(_steps(values))
    steps = steps[steps > _zero(values)]
    if steps.size < 8:
        return 0.0
    (candidate,) = percentiles(steps, (1.0,))
    candidate = median(steps[steps < 1.5 * candidate])
    ratio = steps / candidate
    on_lattice = np.abs(ratio - np.round(ratio)) < 0.02 * np.maximum(1.0, ratio * 0.05)
    if on_lattice.mean() < 0.99:
        return 0.0
    # Few distinct multiples of a step much finer than the signal's range are no coincidence.
    distinct = np.unique(np.round(ratio)).size
    return candidate if distinct < 0.5 * steps.size else 0.0


def repeat_share(values: Floats) -> float:
    """Share of neighbouring pairs that are bit-exact repeats, 0 to 1."""
    steps = _steps(values)
    return float(np.mean(steps == 0.0)) if steps.size else 0.0


def coarse_step(values: Floats) -> float:
    """The recorder's step of a signal in percent where it is coarse enough to be seen, else 0."""
    step = quantum(values)
    # Round numbers that an operator set by hand from time to time do not show the recorder's step.
    often = np.count_nonzero(_steps(values)) >= MANY_CHANGES or repeat_share(values) <= MOST_REPEATS
    return step if step >= COARSE_PERCENT and often and noise_sigma(values) <= 2.0 * step else 0.0


def position_step(values: Floats) -> float:
    """The recorder's step of a position (n,) in percent as ``coarse_step`` tells it, 0 without one.

    Nobody sets a position by hand. So the few changes of a stem that sticks show a step too, if
    they are of several sizes: the slips of a stem that is read without noise may all be alike.
    """
    step = coarse_step(values)
    if step > 0.0:
        return step
    step = quantum(values)
    if step < COARSE_PERCENT or noise_sigma(values) > 2.0 * step:
        return 0.0
    sizes = np.unique(np.round(np.abs(_steps(values)) / step))
    return step if np.count_nonzero(sizes) >= LEAST_SIZES else 0.0


def turns_like_noise(values: Floats, runs: NDArray[np.int64], least: int) -> bool:
    """True where the signal, outside ``runs``, reverses at more than ``NOISE_TURNS`` of its
    samples; ``runs`` (m, 2) are first and last + 1, ``least`` the number of samples needed to
    decide.
    """
    outside = values.copy()
    for first, last in runs:
        outside[first:last] = np.nan
    steps = np.diff(outside)
    turning = steps[1:] * steps[:-1]
    turning = turning[np.isfinite(turning)]
    return bool(turning.size >= least and np.mean(turning < 0.0) > NOISE_TURNS)


def longest_repeat(values: Floats) -> int:
    """Length in samples of the longest run of bit-exact repeats (1: none)."""
    return int(np.diff(equal_runs(values), axis=1).max(initial=1))


def interpolated(values: Floats) -> Bools:
    """(n,) True for interior points that lie on a sloped straight line between their neighbours.

    A swinging-door archive keeps some points and interpolates between them; a measured signal with
    noise almost never has three points on one line. Flat triples are repeats and do not count.
    """
    interpolated_samples = np.zeros(values.size, dtype=bool)
    if values.size < 3:
        return interpolated_samples
    bend = np.abs(values[2:] - 2.0 * values[1:-1] + values[:-2])
    slope = np.abs(values[2:] - values[:-2])
    zero = _zero(values)
    # A value printed with few digits is off the line by up to its last digit.
    interpolated_samples[1:-1] = (bend <= np.maximum(1e-6 * slope, 4.0 * zero)) & (
        slope > 16.0 * zero
    )
    return interpolated_samples
