"""The spectra of many loops at once, and the oscillations that each shows by itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.recording import Floats
from stemwatch.models.signals.holes import bridged
from stemwatch.models.signals.oscillation import half_periods

Complexes = NDArray[np.complex128]

FEWEST_CYCLES = 8  # in the record; what is slower is drift
FEWEST_SAMPLES = 4  # of a period
_GRID = 0.03  # relative step of the frequencies at which peaks are looked for
_HALF_WIDTH = 0.15  # of a peak's band, relative
_MOST_PEAKS = 3  # oscillations of one loop
_CLIP = 6.0  # robust standard deviations; a spike is no oscillation
_CROSSINGS = 11  # zero crossings of the autocorrelation from which regularity is computed
_LEAST_SHARE = 0.05
_BLOCK = 64  # loops
_SHORTEST = 128  # samples of a record that shows a period


@dataclass(frozen=True)
class LoopOscillation:
    """An oscillation of one loop by itself at one frequency.

    ``share`` of the variance within 15 % of the frequency; ``regularity`` of the zero crossings of
    the filtered autocorrelation, T / (3 s) with the spread s of the periods.
    """

    loop: int
    frequency: float  # 1/s
    share: float
    regularity: float


@dataclass(frozen=True, kw_only=True)
class LoopSpectra:
    """``spectra`` (m, f) of loops without drift and spikes, of unit variance; ``frequencies`` (f,)
    in 1/s; ``moves`` (m,) how often each loop takes another value; ``size`` samples of
    ``interval_s``."""

    spectra: Complexes
    frequencies: Floats
    moves: NDArray[np.int64]
    size: int
    interval_s: float

    def within(self, low: float, high: float) -> slice:
        """The bins between two frequencies."""
        first, last = np.searchsorted(self.frequencies, (low, high))
        return slice(int(first), max(int(last), int(first) + 1))

    def time(self, spectra: Complexes, band: slice) -> Complexes:
        """(k, n) analytic signals of (k, bins) spectra in ``band``."""
        full_spectrum = np.zeros((*spectra.shape[:-1], self.size), dtype=np.complex128)
        full_spectrum[..., band] = 2.0 * spectra
        return np.asarray(np.fft.ifft(full_spectrum, axis=-1) * np.sqrt(self.size))


def loop_spectra(values: Floats | NDArray[np.float32], interval_s: float) -> LoopSpectra:
    """The spectra of ``values`` (m, n), samples of m loops on one even clock; NaN where there is
    none. A loop that does not move has the spectrum 0.

    The squares of a spectrum add up to 1 over the frequencies of at least ``FEWEST_CYCLES`` in the
    record.
    """
    m, n = values.shape
    spectra = np.empty((m, n // 2 + 1), dtype=np.complex128)
    moves = np.zeros(m, dtype=np.int64)
    for rows in blocks_of(m):
        steps = np.diff(values[rows], axis=1)
        moves[rows] = np.count_nonzero(np.isfinite(steps) & (steps != 0.0), axis=1)
        spectra[rows] = _unit_spectra(np.array(values[rows], dtype=np.float64))
    frequencies = np.arange(n // 2 + 1) / (n * interval_s)
    return LoopSpectra(
        spectra=spectra, frequencies=frequencies, moves=moves, size=n, interval_s=interval_s
    )


def blocks_of(loops: int) -> list[slice]:
    """Consecutive loops that are worked on together: all at once would take several times the
    memory of the result."""
    return [slice(first, first + _BLOCK) for first in range(0, loops, _BLOCK)]


def _unit_spectra(values: Floats) -> Complexes:
    """(m, f) of (m, n), of unit length each."""
    filled = _without_spikes(_without_holes(values))
    time = np.linspace(-1.0, 1.0, filled.shape[1])
    filled -= filled.mean(axis=1, keepdims=True)
    filled -= (filled @ time)[:, None] / float(time @ time) * time
    spectra = np.fft.rfft(filled, axis=1)
    spectra[:, :FEWEST_CYCLES] = 0.0
    power = np.sqrt((np.abs(spectra) ** 2).sum(axis=1, keepdims=True))
    hardly_moves = power <= 1e-9 * np.abs(values_scale(filled))[:, None]
    spectra /= np.where(hardly_moves, 1.0, power)
    spectra[hardly_moves[:, 0]] = 0.0
    return np.asarray(spectra)


def values_scale(values: Floats) -> Floats:
    """(m,) largest magnitude of each row, at least the smallest number that is none."""
    return np.asarray(np.maximum(np.abs(values).max(axis=1, initial=0.0), 1e-300))


def _without_holes(values: Floats) -> Floats:
    known = np.isfinite(values)
    for row in np.flatnonzero(~known.all(axis=1)):
        values[row] = bridged(values[row], known[row]) if known[row].any() else 0.0
    return values


def _without_spikes(values: Floats) -> Floats:
    middle = np.median(values, axis=1, keepdims=True)
    spread = 1.4826 * np.median(np.abs(values - middle), axis=1, keepdims=True)
    spread = np.where(spread > 0.0, _CLIP * spread, np.inf)
    return np.clip(values, middle - spread, middle + spread)


def oscillations(spectra: LoopSpectra) -> list[LoopOscillation]:
    """The oscillations of each loop, up to three, whether or not they are regular."""
    lowest = FEWEST_CYCLES * 1.2 / (spectra.size * spectra.interval_s)
    highest = 1.0 / (FEWEST_SAMPLES * spectra.interval_s)
    if spectra.size < _SHORTEST or highest <= lowest:
        return []
    grid = np.exp(np.arange(np.log(lowest), np.log(highest), _GRID))
    low = np.searchsorted(spectra.frequencies, grid * (1.0 - _HALF_WIDTH))
    high = np.searchsorted(spectra.frequencies, grid * (1.0 + _HALF_WIDTH))
    high = np.maximum(high, low + 1)
    found = []
    for rows in blocks_of(spectra.spectra.shape[0]):
        power = np.abs(spectra.spectra[rows]) ** 2
        total = np.cumsum(np.pad(power, ((0, 0), (1, 0))), axis=1)
        share = total[:, high] - total[:, low]
        for i, k in _peaks(share):
            frequency = float(grid[k])
            regularity = _regularity(spectra, power[i], frequency)
            loop = rows.start + i
            found.append(LoopOscillation(loop, frequency, float(share[i, k]), regularity))
    return found


def _peaks(share: Floats) -> list[tuple[int, int]]:
    """(loop, place on the grid) of the highest maxima, none within 30 % of a higher one."""
    least_distance = round(0.3 / _GRID)
    peaks: list[tuple[int, int]] = []
    for i in range(share.shape[0]):
        high_enough = np.flatnonzero(share[i] >= _LEAST_SHARE)
        kept_peaks: list[int] = []
        for k in high_enough[np.argsort(-share[i, high_enough], kind="stable")]:
            if len(kept_peaks) == _MOST_PEAKS:
                break
            if all(abs(int(k) - other) > least_distance for other in kept_peaks):
                kept_peaks.append(int(k))
        peaks += [(i, k) for k in kept_peaks if _is_top(share[i], k)]
    return peaks


def _is_top(share: Floats, frequency: int) -> bool:
    neighbours = share[max(frequency - 2, 0) : frequency + 3]
    return bool(share[frequency] >= neighbours.max())


def _regularity(spectra: LoopSpectra, power: Floats, frequency: float) -> float:
    """T / (3 s) of the periods between zero crossings of the autocorrelation of what lies within
    half an octave (Thornhill, Huang and Zhang 2003), of one loop's ``power`` (f,).
    """
    band = spectra.within(frequency / np.sqrt(2.0), frequency * np.sqrt(2.0))
    period = 1.0 / (frequency * spectra.interval_s)
    # The autocorrelation is needed over few periods only, at any resolution.
    lags = np.arange(0.0, (_CROSSINGS + 3) * period / 2.0, period / 24.0)
    bins = np.arange(band.start, min(band.stop, power.size))
    phase = 2.0 * np.pi / spectra.size * np.outer(lags, bins)
    return _from_crossings(np.cos(phase) @ power[bins])


def _from_crossings(acf: Floats) -> float:
    half = half_periods(acf, _CROSSINGS)
    if half.size < 5:
        return 0.0
    return float(half.mean() / (3.0 * half.std(ddof=1) + 1e-9))
