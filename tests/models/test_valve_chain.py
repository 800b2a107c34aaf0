"""The fitted valve as numbers with names: from the quick fit, and from named effects."""

from dataclasses import replace

import pytest

from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.open_question import OpenQuestion, RivalModel
from stemwatch.models.mismatch.terms import catalogue
from stemwatch.models.screening_result import Indicator
from stemwatch.models.stickslip.stroke_curve import StrokeCurve
from stemwatch.models.valve_chain import CHAIN_PARAMETERS, ValveChain, valve_chain
from tests.models.health_indicators.test_response_figures import effect, judged, percent
from tests.models.mismatch.test_terms import LOOK

QUESTION = OpenQuestion(unit_s=30.0, interval=1.0, op=62.0, duration=120.0)
BASE = (4.0, 0.5, 0.3, 0.01, 0.4, 0.02)


def chain_of(screening) -> ValveChain:
    chain = valve_chain(screening)
    assert isinstance(chain, ValveChain), chain
    return chain


def indicator(name, value):
    return Indicator(name=name, value=value, unit="s", meaning="")


def named(slugs, terms):
    """A screening that named ``slugs`` by a fit with ``terms``."""
    model = RivalModel(slug="", base=(BASE, BASE), terms=terms)
    return judged(
        percent(4.0),
        percent(2.0),
        effects=[effect(slug) for slug in slugs],
        question=replace(QUESTION, published=model),
    )


def test_the_quick_fit_gives_actuator_and_zero() -> None:
    """By its indicators, which are in seconds already; the record's interval is the sample time."""
    found = [indicator("dead_time_s", 2.5), indicator("lag_falling_s", 4.0),
             indicator("position_zero_percent", -0.5)]  # fmt: skip
    curve = StrokeCurve(op=(0.0, 100.0), travel=(100.0, 0.0))
    screening = judged(percent(5.0), percent(1.0), question=QUESTION, indicators=found)
    chain = chain_of(replace(screening, stroke_curve=curve))
    told = {name: chain.values[name] for name in
            ("S", "J", "dead_time", "lag_rising", "lag_falling", "sample_time", "reading_zero",
             "travel_per_op", "position_start")}  # fmt: skip
    assert told == {
        "S": 5.0,
        "J": 1.0,
        "dead_time": 2.5,
        "lag_rising": 0.0,
        "lag_falling": 4.0,
        "sample_time": 30.0,
        "reading_zero": -0.5,
        "travel_per_op": -1.0,
        "position_start": pytest.approx(37.5),
    }
    assert chain.one_actuator
    assert chain.op_start == 62.0


def test_an_effect_that_the_chain_does_not_have_is_told() -> None:
    """A new term is found by being there; until it has a place in the chain there is no model."""
    screening = named(["coarse_converter"], {"coarse_converter": ((2.0,), (3.0,))})
    told = "models for other simulators do not have coarse converter, which was named"
    assert valve_chain(screening) == told


def test_a_named_effect_comes_from_the_stored_fit_in_seconds() -> None:
    """Times of the own clock, 30 s a unit, in seconds; delays add up; S and J are the published."""
    chain = chain_of(
        named(
            ["viscous_drag", "rate_limit"],
            {"viscous_drag": ((2.0,), (3.0,)), "rate_limit": ((0.5,), (0.5,))},
        )
    )
    values = chain.values
    assert values["drag"] == pytest.approx(75.0)
    assert values["speed_rising"] == values["speed_falling"] == pytest.approx(1.0 / 15.0)
    assert values["dead_time"] == pytest.approx(12.0)
    assert values["restick_speed"] == pytest.approx(0.02 / 30.0)
    assert (values["S"], values["J"], values["reading_gain"]) == (4.0, 2.0, 1.01)
    assert not chain.one_actuator


def test_what_changes_over_the_record_comes_with_its_length() -> None:
    """A drift goes from half below to half above the zero in the time of the recording."""
    terms = {"sensor_drift": ((1.0, 0.2, 0.0, -0.1),) * 2, "lost_motion": ((0.7,),) * 2}
    chain = chain_of(named(["lost_motion", "sensor_drift"], terms))
    assert chain.named == ("lost_motion", "sensor_drift")
    values = chain.values
    assert (values["play"], values["reading_drift"], values["record_time"]) == (0.7, 1.0, 3600.0)
    waves = [values[f"reading_wave_{j}"] for j in (1, 2, 3)]
    assert waves == [0.2, 0.0, -0.1]
    zero = values["reading_zero"]
    assert values["position_start"] == pytest.approx(50.0 + 1.01 * 12.0 + zero - 0.5)


def test_a_growth_of_unknown_length_has_no_chain() -> None:
    """Where a store kept the fit without the length of its recording."""
    screening = named(["growing_stiction"], {"growing_stiction": ((0.4,),) * 2})
    question = replace(screening.mismatch.open_question, duration=0.0)
    older = replace(screening, mismatch=replace(screening.mismatch, open_question=question))
    assert "growing stiction was named by a version that did not keep" in str(valve_chain(older))


def test_why_there_is_no_chain() -> None:
    """Without S, without the fitted model of what was named, without an interval."""
    unknown = Estimate.unknown("the valve did not move", "%")
    assert valve_chain(judged(unknown, unknown)) == "S is not known: the valve did not move"
    older = judged(percent(4.0), percent(1.0), effects=[effect("dead_time")], question=QUESTION)
    assert "dead time was named by a version that did not keep" in str(valve_chain(older))
    bare = judged(percent(4.0), percent(1.0))
    assert "interval" in str(valve_chain(bare))


@pytest.mark.parametrize("slug", sorted(set(catalogue()) - {"zero_shift", "span_error"}))
def test_every_effect_of_the_catalogue_has_its_place(slug: str) -> None:
    """A new effect needs a place in the chain; zero and gain of the reading are part of every
    fit.
    """
    neutral = {one.name: one.neutral for one in CHAIN_PARAMETERS}
    size = len(catalogue()[slug].coordinates(LOOK))
    chain = chain_of(named([slug], {slug: ((0.2,) * size,) * 2}))
    without = chain_of(named([slug], {})).values
    assert chain.values.keys() == neutral.keys()
    assert chain.values != without
    assert chain.named == (slug,)
