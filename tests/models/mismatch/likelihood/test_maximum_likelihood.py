"""Points of the likelihood of the record that are weighed together are weighed as each alone is,
and none is weighed twice.
"""

from __future__ import annotations

import numpy as np
import pytest

from stemwatch.models.mismatch.fit.batched_search import conclude
from stemwatch.models.mismatch.fit.crossfit import scored
from stemwatch.models.mismatch.likelihood.breakaway_filter import GIVEN_UP
from stemwatch.models.mismatch.likelihood.maximum_likelihood import (
    BEHIND,
    MORE_ROUNDS,
    RecordLikelihood,
)
from stemwatch.models.mismatch.search.compared_by_likelihood import AHEAD, _worth_a_search
from stemwatch.models.mismatch.search.named_terms import Named
from stemwatch.models.mismatch.terms import catalogue
from tests.models.mismatch.fitted_chain import (
    candidate,
    evaluator_of,
    hypothesis,
    simulated_by_chain,
)


def searched(**numbers):
    """The likelihood of a record by S and J alone: itself, its layout, and points about the truth,
    the last far from it.
    """
    evaluator = evaluator_of(simulated_by_chain(S=5.0, J=1.5, **numbers))
    likelihood, layout = RecordLikelihood(evaluator), evaluator.layout(hypothesis())
    points = [
        np.append(candidate(layout, S, J), likelihood.first_of_record)
        for S, J in ((5.0, 1.5), (4.98, 1.49), (5.02, 1.5), (20.0, 1.0))
    ]
    return likelihood, layout, points


def test_points_are_ranked_as_each_of_them_is_likely() -> None:
    """But for the one that falls far behind, which is not followed to its end."""
    likelihood, layout, points = searched()
    alone = [RecordLikelihood(likelihood.evaluator).at(layout, point) for point in points]
    likelihood.evaluator.likelihoods.clear()
    ranked = likelihood.ranked(layout, points)
    totals = sorted((one.total for one in alone[:3]), reverse=True)
    assert [one.total for one in ranked] == pytest.approx(totals, abs=1e-9)
    assert alone[3].total < totals[0] - BEHIND


def test_no_point_is_weighed_twice() -> None:
    """Whichever search comes to it again; and one that falls far behind is given up as before."""
    likelihood, layout, points = searched()
    first = likelihood.at(layout, points[0])
    again = RecordLikelihood(likelihood.evaluator).at(layout, points[0])
    assert again.by_block is first.by_block
    fewer = RecordLikelihood(likelihood.evaluator, courses=4).at(layout, points[0])
    assert fewer.by_block is not first.by_block
    far = likelihood.at(layout, points[3])
    assert far.total > GIVEN_UP
    assert likelihood.at(layout, points[3], first).total <= GIVEN_UP


def test_slopes_are_differences_of_single_points() -> None:
    """Of every coordinate that is free."""
    likelihood, layout, points = searched()
    at = likelihood.at(layout, points[1])
    free, steps, slopes = likelihood._slopes(at)
    for place, step, slope in zip(free, steps, slopes.T, strict=True):
        beside = at.point.copy()
        beside[place] += step
        likelihood.evaluator.likelihoods.clear()
        there = likelihood.of_blocks(layout, beside)
        assert slope == pytest.approx(there - at.by_block, abs=1e-9)


def first_looks(monkeypatch, **effects):
    """The terms that are climbed from in first looks at the whole catalogue, each with its rounds,
    and the looks that are worth a search.
    """
    evaluator = evaluator_of(simulated_by_chain(S=5.0, J=1.5, **effects))
    quick, layout = RecordLikelihood(evaluator, 4), evaluator.layout(hypothesis())
    row = candidate(layout, 5.0, 1.5)
    fitted = conclude(evaluator, scored(layout, np.vstack((row, row))))
    named = Named(evaluator, fitted, fitted, (), ())
    point = np.append(row, quick.first_of_record)
    alone = quick.maximised(layout, [point])
    climbed, climbs = [], RecordLikelihood.climbed

    def counted(self, begun, rounds):
        climbed.append((*begun.layout.hypothesis.slugs, rounds))
        return climbs(self, begun, rounds)

    monkeypatch.setattr(RecordLikelihood, "climbed", counted)
    terms = [term for slug, term in catalogue().items() if slug != "motor_drive"]
    return climbed, _worth_a_search(quick, alone, named, terms)


def test_only_terms_that_begin_ahead_are_climbed(monkeypatch) -> None:
    """Of the whole catalogue six at most, and a lag that is there among them."""
    climbed, looks = first_looks(monkeypatch, actuator_lag=[3.0])
    assert len({slug for slug, _ in climbed}) <= AHEAD
    assert {("actuator_lag", 1), ("actuator_lag", MORE_ROUNDS)} <= set(climbed)
    assert any("actuator_lag" in look.layout.places for look in looks)


def test_terms_that_gain_little_in_their_first_step_are_climbed_no_further(monkeypatch) -> None:
    """Where nothing is hidden that is most of those that begin ahead."""
    climbed, looks = first_looks(monkeypatch)
    assert [rounds for _, rounds in climbed].count(1) == AHEAD
    assert [rounds for _, rounds in climbed].count(MORE_ROUNDS) < 0.5 * AHEAD
    assert not looks
