"""A vibration in the position's reading: a line in its spectrum that the command does not have.

A pipe, a pump or a loose bracket shakes the linkage of the transmitter. The reading then swings by
``a sin(2 pi f t)`` whether the stem moves or rests. Left in, it is taken for noise, which hides all
that is smaller; it is settled with the record's own effects, before any physics is named.

    reading less its mean over 15 samples -> slips left out -> the highest line of the spectrum
        -> is it narrow, its own and always there? -> the line is taken out

A loop that oscillates has lines too. They are the command's or multiples of its frequency, or they
are broad because no two cycles are equal, and between two slips of a stem they are not there.
A vibration quicker than half the sampling rate is seen at its alias, which is said; one whose
frequency wanders by more than one over the length of the record is no line, and stays in the noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stemwatch.models.mismatch.findings import RecordEffect
from stemwatch.models.preparation.own_clock import duration
from stemwatch.models.recording import Bools, Floats, Recording, Role

SLUG = "vibration"
WINDOW = 15  # samples of the mean that is taken off
LEAST_SAMPLES = 300
SLOWEST = 0.08  # cycles a sample; slower ones are within what loops do
AT_HALF_RATE = 0.49  # cycles a sample; from here on amplitude and phase cannot be told apart
SLIP = 4.0  # robust standard deviations beyond which the stem is taken to move
LEAST_LEFT = 0.4  # of the samples, once slips and their neighbours are left out
# Of the quick part of the reading, the share of its variance that the line must make; the highest
# line of white noise makes 2 log(n/2)/n of it: 0.4 % in an hour at 1 s, 2.2 % in ten minutes.
LEAST_SHARE = 0.15
LEAST_PERCENT = 0.05  # amplitude
# Of the power within 40 bins of the line, what must lie within 2.
NEAR_BINS, WIDE_BINS, NARROW = 2, 40, 0.7
MOST_OF_COMMAND = 0.3  # the command's own line over the reading's
PARTS, LEAST_OF_PART = 4, 0.6  # of the record, and the line's amplitude in each of them
MULTIPLES, NEAR_MULTIPLE = 20, 1.5  # of the loop's own frequency, and bins by which one is met


@dataclass(frozen=True)
class Vibration:
    """``amplitude`` in percent, zero to peak, at ``frequency``, cycles a sample (0 to 0.5, an alias
    where the vibration is quicker); ``line`` (n,) what it adds to the reading, percent."""

    amplitude: float
    frequency: float
    line: Floats


def find_vibration(recording: Recording, real: Bools) -> Vibration | None:
    """The line in the position's reading, or ``None``; ``real`` (n,) is where it was measured.

    The reading must hold every sample of a regular clock: an archive that draws lines or averages
    keeps no vibration.
    """
    if recording.mv is None:
        return None
    usable = real & recording.usable
    if np.count_nonzero(usable) < max(LEAST_SAMPLES, 0.8 * usable.size):
        return None
    quick, calm = _quick_part(recording.mv.values, usable)
    if np.count_nonzero(calm) < LEAST_LEFT * usable.size:
        return None
    frequency = _highest_line(np.where(calm, quick, 0.0))
    if frequency is None or _of_the_loop(recording, frequency):
        return None
    waves = _waves(frequency, usable.size)
    sizes = _sizes(quick, waves, calm)
    kept = _kept(frequency)
    amplitude = float(np.hypot(*sizes)) / kept
    least = LEAST_SHARE * float(np.mean(quick[calm] ** 2))
    if amplitude < LEAST_PERCENT or 0.5 * (amplitude * kept) ** 2 < least:
        return None
    parts = _parts(recording.mv.values, usable, calm)
    if any(
        np.hypot(*_sizes(quick, waves, part)) < LEAST_OF_PART * kept * amplitude for part in parts
    ):
        return None
    of_command, _ = _quick_part(recording.op.values, recording.op.usable)
    if np.hypot(*_sizes(of_command, waves, calm)) > MOST_OF_COMMAND * kept * amplitude:
        return None
    return Vibration(amplitude, frequency, np.asarray(waves @ sizes / kept))


def without_vibration(recording: Recording, vibration: Vibration) -> Recording:
    """``recording`` with the line taken out of its position."""
    assert recording.mv is not None
    still = replace(recording.mv, values=recording.mv.values - vibration.line)
    return replace(recording, signals={**recording.signals, Role.MV: still})


def vibration_effect(vibration: Vibration, recording: Recording) -> RecordEffect:
    """The vibration, for people."""
    interval_s = recording.interval_s * recording.unit_s
    hertz, rate = vibration.frequency / interval_s, 1.0 / interval_s
    every = duration(recording.interval_s, recording.unit_s, "g")
    return RecordEffect(
        slug=SLUG,
        sentence=(
            f"The position reading vibrates by {vibration.amplitude:.2g} % to either side at "
            f"{hertz:.3g} Hz, moving or at rest. With a sample every {every}, "
            f"{rate - hertz:.3g} Hz, {rate + hertz:.3g} Hz and any multiple of {rate:.3g} Hz "
            f"more or less {hertz:.3g} Hz look the same. It is taken out here and is not counted "
            "as noise: look for a shaking pipe or pump nearby, and check bracket and linkage of "
            "the position transmitter."
        ),
        parameters={"amplitude_percent": vibration.amplitude, "frequency_hz": hertz},
    )


def _quick_part(values: Floats, usable: Bools) -> tuple[Floats, Bools]:
    """(n,) what is left of a signal less its moving mean, and where no slip is near."""
    filled = np.interp(np.arange(values.size), np.flatnonzero(usable), values[usable])
    half = WINDOW // 2
    padded = np.pad(filled, half, mode="edge")
    quick = filled - np.convolve(padded, np.full(WINDOW, 1.0 / WINDOW), mode="valid")
    spread = 1.4826 * float(np.median(np.abs(quick[usable])))
    slips = (np.abs(quick) > SLIP * spread) | ~usable
    near = np.convolve(np.pad(slips, half), np.ones(WINDOW), mode="valid") > 0.0
    return np.asarray(quick), np.asarray(~near)


def _kept(frequency: float) -> float:
    """The share of a line that taking off the moving mean leaves of it."""
    return float(1.0 - np.sin(np.pi * frequency * WINDOW) / (WINDOW * np.sin(np.pi * frequency)))


def _highest_line(quick: Floats) -> float | None:
    """The frequency of the highest line, cycles a sample, or ``None`` where it is broad."""
    power = np.abs(np.fft.rfft(quick * np.hanning(quick.size))) ** 2
    first, last = int(SLOWEST * quick.size), int(AT_HALF_RATE * quick.size)
    peak = first + int(np.argmax(power[first:last]))
    near = power[max(peak - NEAR_BINS, 0) : peak + NEAR_BINS + 1].sum()
    wide = power[max(peak - WIDE_BINS, 0) : peak + WIDE_BINS + 1].sum()
    if near < NARROW * wide:
        return None
    return _top(quick, peak / quick.size)


def _top(quick: Floats, near: float) -> float:
    """The frequency within a bin of ``near`` at which the windowed transform is largest: twice a
    parabola through three points."""
    windowed, times = quick * np.hanning(quick.size), np.arange(quick.size)
    step, frequency = 0.5 / quick.size, near
    for _ in range(3):
        around = frequency + step * np.array([-1.0, 0.0, 1.0])
        left, middle, right = np.abs(np.exp(-2j * np.pi * around[:, None] * times) @ windowed)
        bend = left - 2.0 * middle + right
        if bend < 0.0:
            frequency += step * float(np.clip(0.5 * (left - right) / bend, -1.0, 1.0))
        step *= 0.3
    return frequency


def _of_the_loop(recording: Recording, frequency: float) -> bool:
    """True for a multiple of the frequency at which the command swings most."""
    op = np.where(recording.op.usable, recording.op.values, np.nan)
    op = np.where(np.isfinite(op), op - np.nanmean(op), 0.0)
    swings = np.abs(np.fft.rfft(op * np.hanning(op.size))) ** 2
    swings[:3] = 0.0
    loop = (int(np.argmax(swings)) or 1) / op.size
    folded = np.arange(1, MULTIPLES + 1) * loop
    folded = np.abs(folded - np.round(folded))
    return bool(np.any(np.abs(folded - frequency) * op.size < NEAR_MULTIPLE))


def _waves(frequency: float, n: int) -> Floats:
    """(n, 2) cosine and sine."""
    phase = 2.0 * np.pi * frequency * np.arange(n)
    return np.column_stack((np.cos(phase), np.sin(phase)))


def _sizes(quick: Floats, waves: Floats, where: Bools) -> Floats:
    """(2,) cosine and sine by least squares over some samples."""
    rows = waves[where]
    return np.asarray(np.linalg.lstsq(rows.T @ rows, rows.T @ quick[where], rcond=None)[0])


def _parts(values: Floats, usable: Bools, calm: Bools) -> list[Bools]:
    """Where no slip is near: the quarters of the record, and its slower and its quicker half."""
    n = values.size
    quarter = np.arange(n) * PARTS // n
    filled = np.interp(np.arange(n), np.flatnonzero(usable), values[usable])
    smooth = np.convolve(np.pad(filled, WINDOW, mode="edge"), np.full(2 * WINDOW + 1, 1.0), "valid")
    speed = np.abs(np.gradient(smooth))
    slow = speed <= np.median(speed[calm])
    parts = [calm & (quarter == part) for part in range(PARTS)]
    parts += [calm & slow, calm & ~slow]
    return [part for part in parts if np.count_nonzero(part) >= LEAST_SAMPLES // PARTS]
