"""Which of several effects is mended first."""

from __future__ import annotations

from stemwatch.models.mismatch.evidence.describe_effect import in_order_of_work
from stemwatch.models.mismatch.findings import Effect, EffectEvidence


def effect(slug: str, *, share: float, mean: float = 0.2, inherent: bool = False) -> Effect:
    return Effect(
        slug=slug, members=(slug,), sentence="", where="", check="", decide="", parameters={},
        evidence=EffectEvidence(mean=mean, t=5.0, share=share), inherent=inherent,
    )  # fmt: skip


def order(*effects: Effect) -> list[str]:
    return [one.slug for one in in_order_of_work(effects)]


def test_a_slow_vent_comes_before_a_delay_that_the_clocks_may_have_made() -> None:
    """However strong the delay's evidence is: at the valve nothing may be wrong."""
    late = effect("dead_time", share=0.7, mean=0.6)
    assert order(late, effect("asymmetric_rate_limit", share=0.4)) == [
        "asymmetric_rate_limit",
        "dead_time",
    ]


def test_at_the_valve_the_larger_deviation_comes_first() -> None:
    """By the share of the squared residual, and not by the gain that named it."""
    often, far = effect("lost_motion", share=0.2, mean=0.5), effect("travel_stop", share=0.5)
    assert order(often, far) == ["travel_stop", "lost_motion"]


def test_what_needs_no_work_comes_last() -> None:
    """A lag that belongs to the machine, after a zero that is off."""
    made_so = effect("actuator_lag", share=0.9, inherent=True)
    assert order(made_so, effect("zero_shift", share=0.1)) == ["zero_shift", "actuator_lag"]
