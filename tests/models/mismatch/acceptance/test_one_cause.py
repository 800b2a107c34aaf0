"""Two effects of one kind are given as one that the recording cannot tell from the other."""

from __future__ import annotations

import pytest

from stemwatch.models.mismatch.acceptance.one_cause import one_cause
from stemwatch.models.mismatch.findings import Effect, EffectEvidence


def named(slug: str, mean: float, *others: str) -> Effect:
    """An effect with this mean gain, and others that the recording cannot tell from it."""
    return Effect(
        slug=slug,
        members=(slug, *others),
        sentence="",
        where="",
        check="",
        decide="",
        parameters={},
        evidence=EffectEvidence(mean=mean, t=3.0, share=0.5, strength=2.0, note="Seen."),
    )


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("viscous_drag", "actuator_lag"),
        ("underdamped_positioner", "asymmetric_lag"),
        ("asymmetric_rate_limit", "supply_sag"),
    ],
)
def test_two_of_one_kind_are_one_finding(first, second):
    """The one with the larger gain has the name, whichever comes first, and says why."""
    stronger, weaker = named(first, 1.0), named(second, 0.2)
    for pair in ((stronger, weaker), (weaker, stronger)):
        (one,) = one_cause(pair)
        assert one.slug == first
        assert one.members == (first, second)
        assert second.replace("_", " ") in one.evidence.note


def test_effects_of_two_kinds_stay_two_findings():
    """A lag, a speed limit and a zero error each have a cause of their own."""
    three = [named("actuator_lag", 0.3), named("rate_limit", 0.5), named("zero_shift", 1.0)]
    assert {effect.slug for effect in one_cause(three)} == {effect.slug for effect in three}
    assert all(len(effect.members) == 1 for effect in one_cause(three))


def test_a_class_keeps_each_of_its_members_once():
    """The weaker one may have a class of its own, of which the stronger one is a member."""
    drag = named("viscous_drag", 0.4, "actuator_lag", "dead_time")
    (one,) = one_cause([named("actuator_lag", 1.0, "dead_time"), drag])
    assert one.members == ("actuator_lag", "dead_time", "viscous_drag")


def test_an_effect_that_may_be_the_cause_of_both_has_the_name():
    """The lag cannot be told from a ringing positioner, which is named itself."""
    lag = named("actuator_lag", 1.0, "underdamped_positioner", "dead_time")
    (one,) = one_cause([lag, named("underdamped_positioner", 0.8)])
    assert one.members == ("underdamped_positioner", "actuator_lag", "dead_time")
