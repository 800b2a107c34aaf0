"""How often loops that have nothing to do with each other would look as coherent as these.

A short record has few cycles, and a band around one period then has few bins: two spectra of six
bins are half alike whatever they are. So coherence alone says little. It is compared with that of
spectra of the same sizes whose phases are random and whose powers lie elsewhere in the band.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.special import betainc, gammaln

from stemwatch.models.oscillation_groups.loop_spectra import Complexes
from stemwatch.models.recording import Floats

_LEAST_CHANCE = 1e-300
_FINER = 32  # frequencies a bin: steady cycles are told apart by a small part of one
_NOTHING_LEFT = 1e-12  # of the power: two recordings of one signal


def log_chance(basis: Complexes, part: Complexes) -> float:
    """ln of the probability that an unrelated loop's spectrum ``part`` (bins,) is as coherent with
    a reference. ``basis`` (bins, t), orthonormal: the reference, then what makes of it the
    reference behind any smooth transfer function.

    A narrow line tells by its frequency, a broad spectrum by its phases: the smaller chance of both
    counts, twice.
    """
    bins, terms = basis.shape
    power = np.abs(part) ** 2
    if bins <= terms or not power.any():
        return 0.0
    unit = part / np.sqrt(power.sum())
    chance = min(_of_frequency(basis[:, 0], unit), _of_phases_and_powers(basis, unit))
    return min(float(np.log(2.0)) + chance, 0.0)


def _of_frequency(reference: Complexes, unit: Complexes) -> float:
    """ln of the part of all frequencies in the band at which the same oscillation would be as
    coherent with the reference. Of two steady cycles the phases drift apart by the difference of
    their frequencies: the spectrum of x(t) conj(r(t)) over that difference.
    """
    beat = np.fft.ifft(unit) * np.fft.ifft(reference).conj()
    as_coherent = np.abs(np.fft.fft(beat, _FINER * unit.size))
    return float(np.log(np.mean(as_coherent >= as_coherent[0] * (1.0 - 1e-9))))


def _of_phases_and_powers(basis: Complexes, unit: Complexes) -> float:
    """ln of the probability by two things that are independent where the loops are:

    - the phases agree. With random ones the share along the basis has the mean
      m = sum_f w_f sum_k abs(b_fk)^2, w the powers, and is taken for a Beta variable
      B(t, t / m - t), which is exact for equal powers;
    - the powers lie where those of the basis do: the part of all shifts of w around the band for
      which m is at least as large.

    The product q of two such probabilities is as small with the probability q (1 - ln q) (Fisher).
    """
    bins, terms = basis.shape
    powers, weights = np.abs(unit) ** 2, (np.abs(basis) ** 2).sum(axis=1)
    along = float((np.abs(unit @ basis.conj()) ** 2).sum())
    expected = float(powers @ weights)
    rest = max(terms / max(expected, 1e-9) - terms, 1e-3)
    of_phases = float(betainc(rest, terms, max(1.0 - along, _NOTHING_LEFT)))
    shifted = np.fft.irfft(np.fft.rfft(weights) * np.fft.rfft(powers).conj(), n=bins)
    of_powers = max(float(np.mean(shifted >= expected - 1e-9)), 1.0 / bins)
    both = float(np.log(max(of_phases, _LEAST_CHANCE)) + np.log(of_powers))
    return both + float(np.log1p(-both))


def log_chances(
    parts: Complexes,
    basis_of: Callable[[Complexes], Complexes],
    common: Callable[[Complexes], Complexes],
) -> Floats:
    """(k,) ``log_chance`` of each of k loops' ``parts`` (k, bins), beside what the others have in
    common."""
    sizes = np.maximum(np.linalg.norm(parts, axis=1, keepdims=True), 1e-15)
    unit = parts / sizes
    out = np.empty(parts.shape[0])
    for i in range(out.size):
        others = np.delete(unit, i, axis=0)
        reference = others[0] if others.shape[0] == 1 else common(others)
        out[i] = log_chance(basis_of(reference), parts[i])
    return out


def log_expected(chances: Floats, compared: int, searches: int) -> float:
    """ln of the number of groups as coherent as this that are expected among unrelated loops.

    ``chances`` (k,) are the members' ``log_chance``, of ``compared`` loops that move enough in the
    band; ``searches`` are the oscillations from which such a search was begun. k - 1 members agree
    with the one from which it begins, out of all ways to choose them.
    """
    k = chances.size
    ways = gammaln(compared) - gammaln(k) - gammaln(compared - k + 1)
    return float(np.log(max(searches, 1)) + ways + (k - 1) / k * chances.sum())
