"""A stem is followed through PV while the process is fitted."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from stemwatch.models.recording import Floats
from stemwatch.models.without_position.hammerstein import element
from tests.benchmarks.followed_stem import FEWEST_VALUES, NAMES, followed_stem

GAIN, S = NAMES.index("likelier with a stem that sticks"), NAMES.index("S that is followed")


def loop(size: float, ratio: float) -> tuple[Floats, Floats]:
    """OP that wanders and swings, and PV behind a stem of S ``size`` and J/S ``ratio``."""
    rng = np.random.default_rng(3)
    op = 50.0 + 4.0 * np.sin(np.arange(600) / 9.0) + 0.2 * np.cumsum(rng.standard_normal(600))
    stem = op.copy()
    if size > 0.0:
        element(op, size, size * ratio, stem)
    pv = lfilter([0.0, 0.2], [1.0, -0.8], stem - 50.0) + 0.05 * rng.standard_normal(600)
    return op, pv


@pytest.mark.long
@pytest.mark.parametrize("ratio", [0.2, 0.6, 1.0])
@pytest.mark.parametrize("size", [2.0, 5.0])
def test_a_stem_that_sticks_is_likelier_and_its_s_is_followed_coarsely(size, ratio) -> None:
    """Its S comes out within a quarter, whatever part of it the stem slips."""
    numbers = followed_stem(*loop(size, ratio))
    assert numbers[GAIN] > np.arcsinh(10.0)  # 20 nats
    assert np.exp(numbers[S]) == pytest.approx(size, rel=0.25)


@pytest.mark.long
def test_a_stem_that_follows_op_is_likelier_sound() -> None:
    """Without a stick band the hypothesis of one gains nothing."""
    assert followed_stem(*loop(0.0, 0.0))[GAIN] < 0.0


def test_neither_scale_nor_sign_of_pv_counts() -> None:
    """PV in other units, the other way round, gives the same numbers."""
    op, pv = loop(3.0, 0.6)
    assert followed_stem(op, 7.0 - 20.0 * pv) == pytest.approx(followed_stem(op, pv), abs=1e-6)


def test_a_spike_does_not_hide_it() -> None:
    """Two readings far off change no answer."""
    op, pv = loop(3.0, 0.6)
    pv[[150, 400]] += 50.0
    assert followed_stem(op, pv)[GAIN] > np.arcsinh(10.0)


def test_a_record_that_is_too_short_says_nothing() -> None:
    """All numbers are nought there."""
    op, pv = loop(3.0, 0.6)
    assert not followed_stem(op[: FEWEST_VALUES - 1], pv[: FEWEST_VALUES - 1]).any()
