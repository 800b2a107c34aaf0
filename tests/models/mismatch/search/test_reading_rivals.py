"""A span error and a bowed linkage: one class over a part of the stroke, two names over more."""

from __future__ import annotations

import re

import numpy as np
import pytest

from stemwatch.models.mismatch.fit import base_coordinate
from stemwatch.models.mismatch.fit.batched_search import conclude
from stemwatch.models.mismatch.fit.crossfit import CAREFUL, LOOK, crossfit, refit
from stemwatch.models.mismatch.search.reading_errors import findings
from stemwatch.models.mismatch.search.reading_rivals import bent_instead, departure
from stemwatch.models.mismatch.terms import catalogue
from tests.models.mismatch.fitted_chain import (
    candidate,
    evaluator_of,
    hypothesis,
    rescaled,
    simulated_by_chain,
)

BOW = catalogue()["bowed_linkage"]


def straight(recording, gain: float):
    """The evaluator of a recording and S, J, zero and gain fitted to it, begun near ``gain``."""
    evaluator = evaluator_of(recording)
    layout = evaluator.layout(hypothesis())
    start = candidate(layout, base={base_coordinate.GAIN: gain})
    fitted = conclude(evaluator, crossfit(evaluator, layout, start[None], LOOK))
    return evaluator, conclude(evaluator, refit(evaluator, fitted, CAREFUL))


def test_over_half_of_the_stroke_a_span_error_is_told_from_a_bow():
    """Over 25 to 75 % a bow of the same slope leaves its line by more than the noise."""
    recording = simulated_by_chain(base={base_coordinate.GAIN: 0.09}, noise=0.03)
    evaluator, fitted = straight(recording, 0.09)
    assert bent_instead(evaluator, fitted, BOW) is None


def test_over_a_small_part_of_the_stroke_the_two_are_one_class():
    """A bowed reading, of which noise hides the bend, is a span error or a bow; the answer says how
    far the stem must move to tell, and that is farther than it did."""
    recording = simulated_by_chain(bowed_linkage=[-1.0], noise=0.3)
    evaluator, fitted = straight(recording, 0.05)
    (off,), _ = findings(evaluator, fitted, catalogue())
    assert off.members == ("span_error", "bowed_linkage")
    seen, wider = (tuple(map(int, pair)) for pair in re.findall(r"(\d+) to (\d+) %", off.tells))
    assert wider[0] < seen[0] < seen[1] < wider[1]


def test_beside_a_bow_no_span_error_is_said():
    """How much of the slope belongs to the bow cannot be told."""
    plain = simulated_by_chain()
    mv = plain.mv.values
    evaluator = evaluator_of(
        rescaled(plain, mv + 0.04 * (mv - 50.0) + 1.5 * np.sin(mv * np.pi / 50.0))
    )
    layout = evaluator.layout(hypothesis("bowed_linkage"))
    start = candidate(layout, base={base_coordinate.GAIN: 0.04}, bowed_linkage=[-1.5])
    fitted = conclude(evaluator, crossfit(evaluator, layout, start[None], LOOK))
    off, _ = findings(evaluator, fitted, catalogue())
    assert [] == off


@pytest.mark.parametrize(
    ("low", "high", "least", "most"), [(40, 60, 0.0, 0.01), (0, 100, 0.38, 0.41)]
)
def test_a_bow_leaves_its_straight_line_only_over_much_of_the_stroke(low, high, least, most):
    """The rms of a bow of height 1 about the line through it."""
    assert least <= departure(low, high) <= most
