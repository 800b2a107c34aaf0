"""The time of each literature model beside the product's own kernel: printed, without a limit.

Run with ``pytest tests/benchmarks/test_bench_models.py -s``.
"""

from __future__ import annotations

import time

import numpy as np
import pytest

from stemwatch.models.studies.literature.canonical import CANONICAL
from stemwatch.models.studies.literature.catalogue import DATA_DRIVEN, EVERY
from stemwatch.models.studies.literature.model import values_of

SAMPLES, REPEATS = 3600, 200


def _median_us(model, op, repeats):
    q = values_of(model)
    model.simulate(op, q, 1.0, float(op[0]))
    seconds = []
    for _ in range(repeats):
        started = time.perf_counter()
        model.simulate(op, q, 1.0, float(op[0]))
        seconds.append(time.perf_counter() - started)
    return 1e6 * float(np.median(seconds))


@pytest.fixture(scope="module")
def commands():
    """A smooth command, and a noisy one that defeats branch prediction."""
    k = np.arange(SAMPLES)
    sine = 50.0 + 20.0 * np.sin(2 * np.pi * k / 151.0)
    return {
        "sine": sine,
        "noisy sine": sine + 0.2 * np.random.default_rng(1).standard_normal(SAMPLES),
    }


@pytest.mark.parametrize(
    "model",
    [
        CANONICAL,
        *(pytest.param(item, marks=pytest.mark.long) for item in EVERY if item is not CANONICAL),
    ],
    ids=lambda m: m.name,
)
def test_time_beside_the_canonical_kernel(model, commands):
    """Microseconds for 3,600 samples, and the ratio to the canonical kernel on the same command."""
    repeats = REPEATS if model in DATA_DRIVEN else 3
    for name, op in commands.items():
        own, canonical = _median_us(model, op, repeats), _median_us(CANONICAL, op, repeats)
        print(f"\n{model.name:20} {name:11} {own:9.1f} us {own / canonical:7.2f} x canonical")
        assert model.simulate(op, values_of(model), 1.0, 50.0).size == SAMPLES
