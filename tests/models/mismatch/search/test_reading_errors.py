"""Errors of the reading are findings where they are material, and each under its own name."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from stemwatch.models.mismatch.fit import base_coordinate
from stemwatch.models.mismatch.fit.base_fit import RESTICK_REACH
from stemwatch.models.mismatch.fit.batched_search import conclude
from stemwatch.models.mismatch.fit.crossfit import LOOK, crossfit
from stemwatch.models.mismatch.search.reading_errors import COORDINATES, findings, pinned, values_of
from stemwatch.models.mismatch.terms import catalogue
from tests.models.mismatch.fitted_chain import (
    candidate,
    evaluator_of,
    hypothesis,
    simulated_by_chain,
)


@cache
def found_in(base=(), slugs=(), values=()):
    """What is off in a recording with ``base`` coordinates and terms, and the fit before, after."""
    terms = dict(zip(slugs, values, strict=True))
    evaluator = evaluator_of(simulated_by_chain(base=dict(base), **terms))
    layout = evaluator.layout(hypothesis(*slugs))
    # Started near the truth, because the search itself is tested elsewhere.
    start = candidate(layout, 3.8, 1.0, dict(base), **terms)
    plain = candidate(layout, 3.8, 1.0, **terms)
    fitted = conclude(evaluator, crossfit(evaluator, layout, np.vstack((start, plain)), LOOK))
    off, after = findings(evaluator, fitted, catalogue())
    return off, fitted, after


def slugs_of(result):
    """The slugs of what is off."""
    return [item.term.slug for item in result[0]]


@pytest.mark.parametrize(
    ("slug", "value", "within"),
    [
        ("zero_shift", 1.5, 0.05),
        ("zero_shift", -1.0, 0.05),
        ("span_error", 0.06, 0.01),
        ("span_error", -0.05, 0.01),
        ("low_speed_restick", 0.5, 0.3),
    ],
)
def test_an_error_of_the_reading_is_found_as_what_it_is(slug, value, within):
    """It is the only finding, with its size, and unseen blocks are predicted worse without it."""
    place = COORDINATES[slug][0]
    result = found_in(base=((place, value),))
    assert [slug] == slugs_of(result)
    (off,), fitted, _ = result
    assert off.members == (slug,)
    middle = fitted.candidates.mean(axis=0)
    np.testing.assert_allclose(values_of(slug, middle), [value], atol=within)
    assert off.advantage.mean > 0.1
    assert off.without.heldout.sum() > fitted.heldout.sum()


def test_a_stem_that_sticks_at_every_speed_is_not_said_to_stick_at_low_speed():
    """Its slips overshoot; nothing shows that it slides at some speed, so both effects are
    given.
    """
    result = found_in(base=((base_coordinate.RESTICK, RESTICK_REACH),))
    assert slugs_of(result) == ["slip_overshoot"]
    (off,), _, _ = result
    assert off.members == ("slip_overshoot", "low_speed_restick")
    assert off.advantage.mean > 0.1


def test_a_stem_that_sticks_again_on_the_slowest_ramps_only_has_no_finding():
    """Every packing does so; scatter of the breakaways looks like it too."""
    assert [] == slugs_of(found_in(base=((base_coordinate.RESTICK, 0.2),)))


def test_a_correct_reading_has_no_finding_and_a_gain_of_one():
    """Where gain and zero are right nothing is found, and the gain is 1 from there on."""
    off, fitted, after = found_in()
    assert [] == off
    assert (
        0.0
        == after.layout.bounds.low[base_coordinate.GAIN]
        == after.layout.bounds.high[base_coordinate.GAIN]
    )
    assert not after.candidates[:, base_coordinate.GAIN].any()
    assert fitted.layout.bounds.high[base_coordinate.GAIN] > 0.0


def test_a_span_error_explains_its_offset_at_mid_travel():
    """A span that turns about 0 % is off at mid-travel too; that is no second finding."""
    result = found_in(base=((base_coordinate.GAIN, 0.06), (base_coordinate.ZERO, 3.0)))
    assert ["span_error"] == slugs_of(result)


def test_a_zero_that_a_span_error_does_not_explain_is_found_beside_it():
    """A span that turns about an end of the stroke moves mid-travel by a percent; five are more."""
    result = found_in(base=((base_coordinate.GAIN, 0.02), (base_coordinate.ZERO, 5.0)))
    assert ["span_error", "zero_shift"] == slugs_of(result)


@pytest.mark.parametrize(("gain", "named"), [(0.02, []), (0.05, ["span_error"])])
def test_a_slope_that_a_flow_force_may_have_is_a_part_of_its_shape(gain, named):
    """It is no finding beside the force, and stays in the fit; a larger one is a span error."""
    result = found_in(((base_coordinate.GAIN, gain),), ("flow_force",), ((5.0,),))
    assert named == slugs_of(result)
    fitted_gain = result[2].candidates[:, base_coordinate.GAIN].mean()
    assert fitted_gain == pytest.approx(gain, abs=0.01)


@pytest.mark.parametrize(
    ("zero", "named"), [(-5.0, []), (-2.0, []), (2.0, ["zero_shift"]), (-7.5, ["zero_shift"])]
)
def test_the_mean_of_a_flow_force_is_no_zero_shift(zero, named):
    """A force that is none at the ends of travel moves the stem all along the stroke, by as much
    as it rises to the middle at most."""
    result = found_in(((base_coordinate.ZERO, zero),), ("flow_force",), ((5.0,),))
    assert named == slugs_of(result)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_drift_that_began_or_ended_at_zero_is_no_zero_shift(side):
    """Zero plus and minus half the drift: at the one end or the other the reading was right."""
    drift = (2.0, 0.0, 0.0, 0.0)
    result = found_in(((base_coordinate.ZERO, side),), ("sensor_drift",), (drift,))
    assert [] == slugs_of(result)


def test_a_reading_that_wanders_through_zero_is_no_zero_shift():
    """It begins at -0.6 and ends at -5.4 %; a slow wave brings it to 0 in between."""
    drift = (-4.8, 2.6, 0.0, 0.0)
    result = found_in(((base_coordinate.ZERO, -3.0),), ("sensor_drift",), (drift,))
    assert [] == slugs_of(result)


def test_a_zero_that_a_drift_does_not_explain_is_found_beside_it():
    """A small drift about a large error has the zero shift as a finding of its own."""
    result = found_in(((base_coordinate.ZERO, 3.0),), ("sensor_drift",), ((1.2, 0.0, 0.0, 0.0),))
    assert ["zero_shift"] == slugs_of(result)


def test_a_zero_that_uneven_friction_makes_is_no_finding_beside_uneven_slips():
    """S of 2.8 % rising and 5.2 % falling is the same as 4 % both ways and a zero of 0.6 %."""
    result = found_in(((base_coordinate.ZERO, 0.6),), ("asymmetric_slip",), ((0.6,),))
    assert [] == slugs_of(result)


@pytest.mark.parametrize(("S", "zero"), [(2.4, 1.6), (5.0, -2.4)])
def test_a_zero_beyond_all_friction_or_that_asks_for_work_is_found_beside_uneven_slips(S, zero):
    """Of S of 2.4 % one way would be below nothing; from 2 % on a zero is calibrated."""
    recording = simulated_by_chain(S, base={base_coordinate.ZERO: zero}, asymmetric_slip=(0.6,))
    evaluator = evaluator_of(recording)
    layout = evaluator.layout(hypothesis("asymmetric_slip"))
    truth = candidate(layout, S, base={base_coordinate.ZERO: zero}, asymmetric_slip=(0.6,))
    fitted = conclude(evaluator, crossfit(evaluator, layout, truth[None], LOOK))
    off, _ = findings(evaluator, fitted, catalogue())
    assert [item.term.slug for item in off] == ["zero_shift"]


def test_a_refused_reading_error_is_not_a_finding():
    """An error of the reading that could not be tested is no finding, however large."""
    evaluator = evaluator_of(simulated_by_chain(base={base_coordinate.ZERO: 1.5}))
    layout = evaluator.layout(hypothesis())
    start = candidate(layout, 3.8, 1.0, {base_coordinate.ZERO: 1.4})
    fitted = conclude(evaluator, crossfit(evaluator, layout, start[None], LOOK))
    terms = {slug: term for slug, term in catalogue().items() if slug != "zero_shift"}
    assert [] == findings(evaluator, fitted, terms)[0]


def test_pinning_limits_one_coordinate_only():
    """Pinning changes one coordinate's limits and no other, and leaves the layout it came from."""
    evaluator = evaluator_of(simulated_by_chain())
    layout = evaluator.layout(hypothesis("dead_time"))
    held = pinned(layout, base_coordinate.RESTICK, 0.12)
    assert (0.0, 0.12) == (
        held.bounds.low[base_coordinate.RESTICK],
        held.bounds.high[base_coordinate.RESTICK],
    )
    others = np.arange(layout.size) != base_coordinate.RESTICK
    np.testing.assert_array_equal(held.bounds.low[others], layout.bounds.low[others])
    np.testing.assert_array_equal(held.bounds.high[others], layout.bounds.high[others])
    assert layout.bounds.high[base_coordinate.RESTICK] > 0.12
