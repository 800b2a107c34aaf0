"""A span error over a small part of the stroke is not told as a zero error alone."""

from __future__ import annotations

import pytest

from stemwatch.models.mismatch.explain import explain
from stemwatch.models.studies.simulator.hidden import draw_hidden


def classes(place):
    """The class of each effect that is named on a valve of seed 4090, its slug first."""
    case = draw_hidden(place + 1, 4090)[place]
    named = [effect.members for effect in explain(case.simulated().recording).effects]
    return case.hidden, named


@pytest.mark.long
def test_a_span_error_over_a_tenth_of_the_stroke_is_given_beside_the_zero():
    """In a quiet loop, beside a stiction that grows, the zero takes up most of it."""
    hidden, named = classes(343)
    assert hidden == ("growing_stiction", "span_error")
    assert ("zero_shift", "span_error") in named


@pytest.mark.parametrize("place", [205, pytest.param(336, marks=pytest.mark.long)])
def test_a_zero_error_has_no_span_beside_it(place):
    """The gain stays at 1 by itself, in a quiet loop and in a routine hour."""
    hidden, named = classes(place)
    assert hidden == ("zero_shift",)
    assert named == [("zero_shift",)]
