"""Whether a loop oscillates, and how regularly; with or without a valve position."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stemwatch.models.recording import Floats, Recording, Role, Signal
from stemwatch.models.signals.holes import bridged
from stemwatch.models.statistics.cross_correlation import lagged_products

MIN_CROSSINGS = 6  # zero crossings of the autocorrelation that make a period
# Regularity above 1 is the usual criterion for an oscillation (Thornhill, Huang and Zhang 2003,
# quoted from memory): the spread of the half periods is below a third of their mean.
REGULAR = 1.0
LEAST_SPREAD = 1e-9  # standard deviation over the largest value; less is floating-point noise
FEWEST_KNOWN = 64  # samples of a signal with holes
FEWEST_CYCLES = 4  # in the record; what is slower is drift


@dataclass(frozen=True)
class Oscillation:
    """Period in seconds and regularity of a signal's oscillation."""

    period_s: float
    regularity: float

    @property
    def regular(self) -> bool:
        """Whether the regularity is above 1, the usual limit of an oscillation."""
        return self.regularity > REGULAR


def _autocorrelation(values: Floats, lags: int) -> Floats:
    centred = values - values.mean()
    products = lagged_products(centred, centred, lags)
    return np.asarray(products / products[0])


def _high_pass(values: Floats) -> Floats:
    """Remove everything slower than a quarter of the record: drift is no oscillation.

    The straight line goes first, because a spectrum sees it as a jump at the record's ends.
    """
    time = np.linspace(-1.0, 1.0, values.size)
    slope = float(time @ values) / float(time @ time)
    spectrum = np.fft.rfft(values - values.mean() - slope * time)
    spectrum[:FEWEST_CYCLES] = 0.0
    return np.asarray(np.fft.irfft(spectrum, values.size))


def half_periods(acf: Floats, most: int) -> Floats:
    """Samples between the first zero crossings, ``most`` at most, of an autocorrelation (n,), each
    crossing between two samples placed by a straight line."""
    sign = np.signbit(acf)
    crossings = np.flatnonzero(sign[1:] != sign[:-1])[:most]
    before, after = acf[crossings], acf[crossings + 1]
    return np.diff(crossings + before / (before - after))


def oscillation(values: Floats, interval_s: float) -> Oscillation | None:
    """Oscillation of a signal (n,) without holes, or ``None`` where there is nothing to measure.

    Zero crossings of the autocorrelation give half periods ``h``; the period is ``T = 2 mean(h)``
    and the regularity ``T / (3 s)`` with the spread ``s = 2 std(h)``, that is, half periods that
    are long and short together.
    """
    largest = float(np.abs(values).max(initial=0.0))
    if values.size < 64 or largest == 0.0:
        return None
    values = values / largest  # so that no square overflows
    if float(np.std(values)) < LEAST_SPREAD:
        return None
    acf = _autocorrelation(_high_pass(values), values.size // 2)
    half = half_periods(acf, 2 * MIN_CROSSINGS)
    if half.size < MIN_CROSSINGS - 1:
        return None
    period = 2.0 * float(half.mean()) * interval_s
    scatter = float(half.std(ddof=1)) * interval_s * 2.0
    return Oscillation(period_s=period, regularity=period / (3.0 * scatter + 1e-9))


def signal_oscillation(signal: Signal, interval_s: float) -> Oscillation | None:
    """The oscillation of a signal, its holes bridged by straight lines; ``None`` as above."""
    known = np.isfinite(signal.values)
    if np.count_nonzero(known) < FEWEST_KNOWN:
        return None
    return oscillation(bridged(signal.values, known), interval_s)


def loop_oscillation(recording: Recording) -> dict[Role, Oscillation]:
    """The oscillation of each signal of the loop that has one, regular or not."""
    oscillations: dict[Role, Oscillation] = {}
    for role in (Role.OP, Role.PV, Role.MV):
        signal = recording.get(role)
        cycle = None if signal is None else signal_oscillation(signal, recording.interval_s)
        if cycle is not None:
            oscillations[role] = cycle
    return oscillations
