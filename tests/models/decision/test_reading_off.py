"""A position that stands beside OP although its stem follows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stemwatch.models.decision.reading_off import reading_off
from stemwatch.models.recording import Floats
from stemwatch.models.stickslip import parameters as coordinate
from stemwatch.models.stickslip.stroke_curve import StrokeCurve

OP = np.linspace(20.0, 80.0, 601)
TO_90 = StrokeCurve(op=(0.0, 100.0), travel=(0.0, 90.0))
HALF = StrokeCurve(op=(0.0, 100.0), travel=(0.0, 50.0))
BENT = StrokeCurve(op=(0.0, 50.0, 100.0), travel=(0.0, 40.0, 100.0))


def fitted(zero: float = 0.0) -> Floats:
    candidate = np.zeros(coordinate.N_COORDINATES)
    candidate[coordinate.ZERO] = zero
    return candidate


@pytest.mark.parametrize("zero", [-7.0, -2.1, 2.1, 4.9])
def test_a_zero_that_is_off_is_told_at_both_ends(zero):
    """With its sign."""
    off = reading_off(OP, None, fitted(zero))
    assert off is not None
    assert (off.at_low, off.at_high) == pytest.approx((zero, zero))
    assert off.percent == pytest.approx(abs(zero))


def test_below_what_a_stroke_check_finds_nothing_is_said():
    """Nor of a record without a sample."""
    assert reading_off(OP, None, fitted(1.9)) is None
    assert reading_off(OP[:0], None, fitted(9.0)) is None


def test_a_span_that_a_curve_takes_in_is_told_where_it_is_largest():
    """OP 23 to 77 % brings the position from 20.7 to 69.3 %."""
    off = reading_off(OP, TO_90, fitted())
    assert off is not None
    assert (off.at_low, off.at_high) == pytest.approx((-2.3, -7.7))


@pytest.mark.parametrize("curve", [HALF, BENT, replace(TO_90, given=True)])
def test_what_is_meant_or_given_says_nothing_of_the_reading(curve):
    """A split range, a characteristic, and a curve of the plant file."""
    assert reading_off(OP, curve, fitted(3.0)) is None
