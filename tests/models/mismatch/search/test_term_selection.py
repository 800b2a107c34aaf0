"""The effects with which a recording was simulated are named, with their numbers, and no others."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from stemwatch.models.mismatch.fit import base_coordinate
from stemwatch.models.mismatch.fit.base_fit import fit_base
from stemwatch.models.mismatch.fit.batched_search import conclude
from stemwatch.models.mismatch.fit.crossfit import CAREFUL, gain, own_losses, refit, scored
from stemwatch.models.mismatch.fit.evaluator import TermSet
from stemwatch.models.mismatch.measurement.record_effects import measured_record
from stemwatch.models.mismatch.prepared_recording import problem_of, summary_of
from stemwatch.models.mismatch.search import explaining_terms, term_selection
from stemwatch.models.mismatch.search.explaining_terms import AS_GOOD, accepted, passes
from stemwatch.models.mismatch.search.named_terms import SelectionStage, TermScore
from stemwatch.models.mismatch.search.needed_terms import pruned
from stemwatch.models.mismatch.search.other_coordinates import in_bounds_of, without
from stemwatch.models.mismatch.search.term_scores import neutral, reduced
from stemwatch.models.mismatch.search.term_selection import MOST_TERMS, name_terms
from stemwatch.models.mismatch.terms import catalogue
from stemwatch.models.recording import Recording
from stemwatch.models.stickslip.advantage import Advantage
from stemwatch.models.stickslip.parameters import Bounds
from stemwatch.models.studies.simulator.hidden import draw_hidden
from tests.models.mismatch.fitted_chain import (
    candidate,
    evaluator_of,
    hypothesis,
    simulated_by_chain,
)

NAMES = [slug for slug, term in catalogue().items() if not term.in_base]


def begun(recording: Recording):
    """The base of a recording, and every term that does not belong to the reading."""
    problem = problem_of(recording, measured_record(recording))
    terms = [catalogue()[slug] for slug in NAMES]
    return fit_base(problem, summary_of(problem, problem.interval_s)), terms


@cache
def named(**terms):
    """What is named in a recording that the chain made with ``terms`` (slug to a value)."""
    values = {slug: np.atleast_1d(value) for slug, value in terms.items()}
    return name_terms(*begun(simulated_by_chain(**values)))


@pytest.mark.parametrize(
    ("slug", "value", "within"),
    [
        ("dead_time", 3.0, 0.05),
        ("actuator_lag", 4.0, 0.1),
        ("asymmetric_rate_limit", (1 / 8.0, 1 / 1.2), (0.02, 0.02)),
        pytest.param("viscous_drag", 3.0, 0.15, marks=pytest.mark.long),
        pytest.param("lost_motion", 0.8, 0.1, marks=pytest.mark.long),
        ("growing_stiction", 0.8, 0.05),
        pytest.param("flow_force", 5.0, 0.3, marks=pytest.mark.long),
        pytest.param("stem_creep", 0.02, 0.002, marks=pytest.mark.long),
        ("position_dependent_friction", (2.5, 55.0, 4.0), (0.2, 0.3, 0.3)),
    ],
)
def test_the_simulated_term_is_recovered(slug, value, within):
    """The term is named alone, with its own coordinates, S and J on both folds."""
    selection = named(**{slug: value})
    assert [slug] == [item.term.slug for item in selection.needed]
    assert (slug,) == selection.fitted.slugs
    off = np.abs(selection.fitted.values(slug) - np.atleast_1d(value))
    assert (off <= np.atleast_1d(within)).all(), selection.fitted.values(slug)
    S, ratio = selection.fitted.candidates[:, [base_coordinate.S_PERCENT, base_coordinate.RATIO]].T
    np.testing.assert_allclose(S, 4.0, atol=0.2)
    np.testing.assert_allclose(S * ratio, 1.2, atol=0.2)
    # What is needed is what stands at the end, against the best fit that lacks it.
    (need,) = selection.needed
    again_gained = gain(selection.evaluator, need.without, selection.fitted)
    assert (need.advantage.mean, need.advantage.t) == (again_gained.mean, again_gained.t)
    assert slug not in need.without.slugs


def test_where_nothing_is_hidden_nothing_is_named():
    """S, J and noise: no term is accepted, and the hypothesis stays the base."""
    selection = named()
    assert () == selection.needed
    assert () == selection.fitted.slugs
    assert 1 == len(selection.stages)
    assert not selection.stages[0].accepted


def test_the_scores_of_a_round_are_of_all_terms_best_first():
    """Every term that the recording could show has a score, in falling order."""
    selection = named()
    means = [score.advantage.mean for score in selection.stages[0].scores]
    assert sorted(means, reverse=True) == means
    assert {score.slug for score in selection.stages[0].scores} <= set(NAMES)
    assert len(means) >= 14


@pytest.mark.parametrize(
    "terms",
    [
        {"dead_time": 3.0, "lost_motion": 0.8},
        pytest.param(
            {"rate_limit": 1 / 1.5, "sensor_drift": (3.0, 0.0, 0.0, 0.0)}, marks=pytest.mark.long
        ),
    ],
)
def test_two_effects_are_both_found(terms):
    """Both are needed at the end, each against the best fit that lacks it alone, and no third."""
    selection = named(**terms)
    assert (
        set(terms) == {item.term.slug for item in selection.needed} == set(selection.fitted.slugs)
    )
    for item in selection.needed:
        assert {item.term.slug} == set(terms) - set(item.without.slugs)
    for slug, value in terms.items():
        first = float(selection.fitted.values(slug)[:, 0].mean())
        assert first == pytest.approx(np.atleast_1d(value)[0], rel=0.12)


def test_there_are_no_more_rounds_than_terms_that_may_be_named():
    """A round without a name is the last."""
    for item in (named(), named(dead_time=3.0), named(dead_time=3.0, lost_motion=0.8)):
        assert len(item.stages) <= MOST_TERMS
        assert all(stage.accepted for stage in item.stages[:-1])


def went_on(evaluator, simple, rich):
    """``simple`` searched further in the coordinates of ``rich``."""
    started = conclude(evaluator, neutral(evaluator, simple, rich))
    return conclude(evaluator, refit(evaluator, started, CAREFUL))


@pytest.mark.long
def test_a_term_is_needed_beside_the_best_fit_that_is_known_without_it():
    """Behind coarse steps what dwell takes over of S and J is not found again without it: from the
    fit with both, its gain beside a bowed linkage was 0.61 instead of 0.26.
    """
    case = draw_hidden(269, 2124)[268]
    selection = name_terms(*begun(case.simulated().recording))
    assert len(selection.needed) == 2
    for item in selection.needed:
        known = [one.before for one in selection.stages if one.before.slugs == item.without.slugs]
        reached = own_losses(selection.evaluator, item.without)
        for fit in known:
            np.testing.assert_array_less(
                reached, np.multiply(own_losses(selection.evaluator, fit), 1.0 + 1e-9)
            )


def test_a_first_term_is_dropped_when_a_second_replaces_it():
    """A lag that stood in for the dead time goes once the dead time is there."""
    selection = named(dead_time=3.0)
    evaluator, both = selection.evaluator, hypothesis("actuator_lag", "dead_time")
    of_lag = went_on(evaluator, selection.base, hypothesis("actuator_lag"))
    fitted = went_on(evaluator, selection.fitted, both)
    lag, late = (catalogue()[slug] for slug in ("actuator_lag", "dead_time"))
    stages = [
        SelectionStage(
            selection.base,
            (),
            (TermScore(lag, of_lag, gain(evaluator, selection.base, of_lag)),),
        ),
        SelectionStage(of_lag, (), (TermScore(late, fitted, gain(evaluator, of_lag, fitted)),)),
    ]
    left, needed = pruned(evaluator, fitted, stages)
    assert ["dead_time"] == [item.term.slug for item in needed]
    assert ("dead_time",) == left.slugs
    np.testing.assert_allclose(left.values("dead_time"), 3.0, atol=0.1)


# Nothing in the range of the positioner's coordinates is neutral.
@pytest.mark.parametrize("slug", [slug for slug in NAMES if slug != "underdamped_positioner"])
def test_a_richer_hypothesis_contains_the_simpler_one(slug):
    """With its new term neutral it costs the same in every block: it can win by the term alone."""
    evaluator = named().evaluator
    simple = conclude(
        evaluator, scored(evaluator.layout(hypothesis()), two(evaluator, hypothesis()))
    )
    rich = conclude(evaluator, neutral(evaluator, simple, hypothesis(slug)))
    np.testing.assert_allclose(rich.heldout, simple.heldout, rtol=1e-9)
    back = reduced(evaluator, rich, hypothesis())
    np.testing.assert_array_equal(back, simple.candidates)


def test_play_that_is_left_out_is_a_dead_band_of_friction():
    """S grows by it and J stays, so that friction alone is searched again from there as well."""
    evaluator = named().evaluator
    rich = two(evaluator, hypothesis("lost_motion"))
    layout = evaluator.layout(hypothesis("lost_motion"))
    rich[:, layout.places["lost_motion"]] = 1.5
    fitted = conclude(evaluator, scored(layout, rich))
    as_it_is, as_friction = without(fitted, evaluator.layout(hypothesis()))
    assert base_coordinate.S_and_J(as_it_is[1]) == pytest.approx((3.5, 2.0))
    assert base_coordinate.S_and_J(as_friction[1]) == pytest.approx((3.5 + 1.5, 2.0))


def two(evaluator, which, S=3.5):
    """Two candidates of a hypothesis without a delay within the sample."""
    layout = evaluator.layout(which)
    return np.vstack([candidate(layout, S, J, {base_coordinate.ZERO: 0.3}) for J in (0.5, 2.0)])


def score_of(slug, result, mean, t, values=None):
    """A score of a term on the evaluator of ``result`` with a given advantage."""
    evaluator = result.evaluator
    layout = evaluator.layout(hypothesis(slug))
    both = two(evaluator, hypothesis(slug))
    if values is not None:
        both[:, layout.places[slug]] = values
    return TermScore(
        catalogue()[slug], conclude(evaluator, scored(layout, both)), Advantage(mean, t)
    )


def test_what_is_left_of_a_hypothesis_keeps_its_bounds():
    """S and the size that a term was held at, when another term goes."""
    evaluator = evaluator_of(simulated_by_chain())
    both = evaluator.layout(hypothesis("lost_motion", "dead_time"))
    places = [base_coordinate.S_PERCENT, both.places["dead_time"].start]
    low = both.bounds.low.copy()
    low[places] = (4.5, 1.5)
    one = in_bounds_of(
        evaluator.layout(hypothesis("dead_time")),
        replace(both, bounds=Bounds(low, both.bounds.high)),
    )
    assert one.bounds.low[base_coordinate.S_PERCENT] == 4.5
    assert one.bounds.low[one.places["dead_time"]] == 1.5
    assert one.bounds.high[one.places["dead_time"]] == both.bounds.high[both.places["dead_time"]]


def test_an_immaterial_effect_is_not_named_however_certain():
    """A certain dead time of 0.2 s is not named; one of 3 s is; one of 3 s within chance is not."""
    evaluator, result = evaluator_of(simulated_by_chain()), named()
    assert not passes(score_of("dead_time", result, 1.0, 20.0, 0.2), evaluator, 0)
    assert passes(score_of("dead_time", result, 1.0, 20.0, 3.0), evaluator, 0)
    assert not passes(score_of("dead_time", result, 0.5, 0.8, 3.0), evaluator, 0)
    assert not passes(score_of("dead_time", result, 0.005, 20.0, 3.0), evaluator, 0)


def test_the_simpler_of_two_that_are_as_good_comes_first():
    """An asymmetric limit that predicts no better than one limit gives way to it."""
    selection = named(rate_limit=1 / 1.5)
    evaluator = selection.evaluator
    simple = score_of("rate_limit", selection, 1.0, 9.0, 1 / 1.5)
    both = score_of("asymmetric_rate_limit", selection, 1.1, 9.0, (1 / 1.5, 1 / 1.5))
    simple, both = matched(evaluator, simple), matched(evaluator, both)
    taken = accepted(evaluator, [both, simple], 0)
    assert "rate_limit" == taken[0].slug


def matched(evaluator, score):
    """The score with the S and J that the recording has."""
    candidates = score.fitted.candidates.copy()
    (
        candidates[:, base_coordinate.S_PERCENT],
        candidates[:, base_coordinate.RATIO],
        candidates[:, base_coordinate.ZERO],
    ) = 4.0, 0.3, 0.0
    return replace(score, fitted=conclude(evaluator, scored(score.fitted.layout, candidates)))


def test_a_rival_that_predicts_as_well_is_a_member_of_the_class():
    """A rival is kept beside the best where blocks it did not see do not tell them apart."""
    selection = named(dead_time=3.0)
    evaluator = selection.evaluator
    late = matched(evaluator, score_of("dead_time", selection, 1.5, 9.0, 3.0))
    lag = matched(evaluator, score_of("actuator_lag", selection, 1.4, 9.0, 3.0))
    assert gain(evaluator, lag.fitted, late.fitted).t > AS_GOOD
    assert [late] == accepted(evaluator, [late, lag], 0)
    same = replace(lag, fitted=replace(lag.fitted, losses=late.fitted.losses))
    assert [late, same] == accepted(evaluator, [late, same], 0)
    assert [] == accepted(evaluator, [], 0)


def test_another_term_goes_before_a_second_one_of_the_same_kind(monkeypatch):
    """A lag that differs by direction, on top of a lag, is what a delay looks like: where both do
    as well, the delay is taken and the other stands as its rival."""
    catalogue_of = catalogue()

    def score(slug):
        terms = TermSet((catalogue_of["actuator_lag"], catalogue_of[slug]))
        fitted = SimpleNamespace(layout=SimpleNamespace(hypothesis=terms))
        return SimpleNamespace(slug=slug, term=catalogue_of[slug], fitted=fitted)

    scores = [score("asymmetric_lag"), score("dead_time")]
    monkeypatch.setattr(explaining_terms, "passes", lambda *_: True)
    monkeypatch.setattr(explaining_terms, "_as_good", lambda *_: True)
    monkeypatch.setattr(explaining_terms, "_nearly", lambda *_: True)
    taken = explaining_terms.accepted(None, scores, 1)
    assert [item.slug for item in taken] == ["dead_time", "asymmetric_lag"]


def test_play_is_dropped_where_a_later_term_removes_the_jump(monkeypatch):
    """Whether play can be separated from friction is checked again at the end: without a jump the
    two are one dead band, and the search is repeated without play.
    """
    base, terms = begun(simulated_by_chain(lost_motion=np.atleast_1d(0.8)))
    assert ["lost_motion"] == [item.term.slug for item in name_terms(base, terms).needed]

    def lose_the_jump(evaluator, fitted, stages):
        fitted, needed = pruned(evaluator, fitted, stages)
        candidates = fitted.candidates.copy()
        candidates[:, base_coordinate.RATIO] = 0.0
        return replace(fitted, candidates=candidates), needed

    monkeypatch.setattr(term_selection, "pruned", lose_the_jump)
    again = name_terms(base, terms)
    assert "lost_motion" not in [item.term.slug for item in again.needed]
    assert "lost_motion" not in again.fitted.slugs
