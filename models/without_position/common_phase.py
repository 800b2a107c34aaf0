"""Surrogates of a loop: the same linear relation between OP and PV, and nothing beyond it."""

from __future__ import annotations

import numpy as np

from stemwatch.models.recording import Floats


def common_phase_surrogate(
    op: Floats, pv: Floats, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """``op`` and ``pv`` (n,) with the same random phases added to both spectra.

    Spectra and cross spectrum, and with them every linear model between the two, stay; what a
    stick-slip element would explain does not. The line through the ends goes first, because a
    spectrum sees it as a jump, and comes back afterwards. Prichard and Theiler (1994),
    doi:10.1103/PhysRevLett.73.951.
    """
    n = op.size
    phases = rng.uniform(0.0, 2.0 * np.pi, n // 2 + 1)
    phases[0] = 0.0
    if n % 2 == 0:
        phases[-1] = 0.0
    turn = np.exp(1j * phases)
    return _turned(op, turn), _turned(pv, turn)


def _turned(values: Floats, turn: np.ndarray) -> Floats:
    line = np.linspace(values[0], values[-1], values.size)
    return np.asarray(np.fft.irfft(np.fft.rfft(values - line) * turn, values.size) + line)
