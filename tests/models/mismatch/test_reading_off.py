"""A position that reads several percent off is named, also where the stem follows closely: its zero
then makes up for nearly all that S and J alone would leave.
"""

from __future__ import annotations

from functools import cache

import pytest

from stemwatch.models.mismatch.explain import explain
from stemwatch.models.recording import Recording
from stemwatch.models.studies.simulator import draw_healthy, simulate_loop
from tests.benchmarks.bench_reading_off import kept


@cache
def healthy(number: int) -> Recording:
    """Six hours of a healthy valve."""
    loop = draw_healthy(number + 1, 6161)[number]
    return simulate_loop(loop.lasting(6 * 3600.0), 6161 + number).recording


@pytest.mark.parametrize("number", [1, 3])
@pytest.mark.parametrize("off", [-7.0, 7.0])
@pytest.mark.parametrize("step", [5, 10])
def test_a_reading_that_is_far_off_is_named_with_its_size(number, off, step):
    """The zero is named as one that needs work, also beside a span that is a percent off."""
    found = explain(kept(healthy(number), step, off, 0.99))
    (zero,) = (effect for effect in found.effects if effect.slug == "zero_shift")
    # The transmitter of the draw has a zero of its own.
    assert zero.parameters["zero"].value == pytest.approx(off, abs=0.8)
    assert not zero.inherent
