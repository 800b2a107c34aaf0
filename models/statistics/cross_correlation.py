"""Sums of products of two signals by delay, the basis of cross-correlations."""

from __future__ import annotations

import numpy as np
from scipy.fft import next_fast_len

from stemwatch.models.recording import Floats


def lagged_products(first: Floats, second: Floats, lags: int) -> Floats:
    """(lags,) ``sum_k first[k] second[k + lag]`` for each ``lag`` from 0, of two (n,) without NaN.

    Computed by fast Fourier transform, padded so that no lag below ``lags`` wraps round.
    """
    size = next_fast_len(first.size + lags - 1, real=True)
    spectrum = np.fft.rfft(first, size)
    other = spectrum if second is first else np.fft.rfft(second, size)
    return np.asarray(np.fft.irfft(np.conj(spectrum) * other, size)[:lags])
