"""Six input signals on which stiction models are compared, and a recording made of one."""

from __future__ import annotations

import numpy as np
import pytest

from stemwatch.models.recording import Recording, Role, Signal
from stemwatch.models.studies.literature.model import values_of

SAMPLES = 1500


@pytest.fixture(scope="session")
def signals():
    """Command signals (1500,) by name. Their steps divide no threshold of a test exactly."""
    k = np.arange(SAMPLES)
    rng = np.random.default_rng(3)
    sine = 50.0 + 9.87654 * np.sin(2 * np.pi * (k + 0.3) / 150.0)
    ar = np.zeros(SAMPLES)
    for i in range(1, SAMPLES):
        ar[i] = 0.98 * ar[i - 1] + rng.standard_normal()
    walk = np.cumsum(rng.standard_normal(SAMPLES) * 0.5)
    return {
        "triangle": 50.0 + 9.87654 * (2.0 * np.abs((k / 100.0) % 2.0 - 1.0) - 1.0),
        "sine": sine,
        "random walk": 50.0 + 20.0 * np.sin(walk / 20.0),  # within 0..100, where nothing saturates
        "noisy sine": sine + 0.2 * rng.standard_normal(SAMPLES),
        "quantised sine": np.round(sine / 0.5) * 0.5,
        "autoregressive": 50.0 + ar,
    }


@pytest.fixture(scope="session")
def recorded():
    """Makes a recording of a model's own simulation, with noise and a zero error."""

    def make(model, op, *, noise=0.1, zero=0.7, seed=1, interval_s=1.0, **named):
        rng = np.random.default_rng(seed)
        mv = model.simulate(op, values_of(model, **named), interval_s, float(op[0])) + zero
        mv += noise * rng.standard_normal(op.size)
        signals = {Role.OP: Signal.good(op, "OP"), Role.MV: Signal.good(mv, "ZT")}
        return Recording(valve="FV-1", signals=signals, interval_s=interval_s)

    return make
