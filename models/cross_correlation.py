"""Products of a signal with another one shifted against it: what correlations over delay need."""

from __future__ import annotations

import numpy as np

from stemwatch.models.recording import Floats

# A spectrum is quick where its length has no factor but 2, 3 and 5; these are times a power of 2.
_ODD_FACTORS: tuple[int, ...] = tuple(
    3**threes * 5**fives for threes in range(5) for fives in range(4)
)


def lagged_products(first: Floats, second: Floats, lags: int) -> Floats:
    """(lags,) ``sum_k first[k] second[k + lag]`` for each ``lag`` from 0, of two (n,) without NaN.

    By a spectrum that is padded just far enough for the wanted lags not to wrap round.
    """
    size = quick_length(first.size + lags - 1)
    spectrum = np.fft.rfft(first, size)
    other = spectrum if second is first else np.fft.rfft(second, size)
    return np.asarray(np.fft.irfft(np.conj(spectrum) * other, size)[:lags])


def quick_length(least: int) -> int:
    """``least`` samples (1 or more) or little more: a length with a quick spectrum."""
    return min(odd << (-(-least // odd) - 1).bit_length() for odd in _ODD_FACTORS)
