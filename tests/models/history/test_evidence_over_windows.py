"""The evidence of many windows of one valve: two must agree, or one is confirmed by the others."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from stemwatch.models.estimate import Estimate
from stemwatch.models.history.evidence_over_windows import (
    MEMORY,
    FindingState,
    WindowEvidence,
    lasting_findings,
    pooled_stiction,
)
from stemwatch.models.mismatch.findings import EffectScore

BEGIN = datetime(2026, 3, 1, 6, tzinfo=UTC)
HOUR, DAY = timedelta(hours=1), timedelta(days=1)
SLUG = "flow_force"


def window(day, *named, mean=0.0, t=0.0, slug=SLUG, S=None, anew="", start=None):
    """An hour on ``day``; each of ``named`` is a slug, or a class of slugs."""
    classes = tuple((item,) if isinstance(item, str) else tuple(item) for item in named)
    at = BEGIN + day * DAY
    error = 0.1
    size = None if S is None else Estimate(value=S, low=S - 2 * error, high=S + 2 * error, unit="%")
    return WindowEvidence(
        at=at,
        start=at - HOUR if start is None else start,
        named=classes,
        scores=(EffectScore(slug=slug, mean=mean, t=t, strength=0.0),),
        S=size,
        J=size,
        begins_anew=anew,
    )


def states(windows):
    """The state of every finding by its slug."""
    return {finding.slug: finding.state for finding in lasting_findings(windows)}


def test_one_window_alone_confirms_nothing():
    """What one window names is first seen, with the day, whatever its strength."""
    (finding,) = lasting_findings([window(0), window(1, SLUG, mean=1.0, t=9.0)])
    assert finding.state is FindingState.FIRST_SEEN
    assert not finding.holds
    assert finding.first_seen == BEGIN + DAY
    assert finding.confirmed is None


def test_two_windows_that_agree_confirm():
    """The second window that names it confirms, and after the next one it stands."""
    two = [window(0, SLUG), window(1), window(2, SLUG)]
    (finding,) = lasting_findings(two)
    assert finding.state is FindingState.CONFIRMED
    assert (finding.named, finding.of) == (2, 3)
    assert finding.confirmed == BEGIN + 2 * DAY
    assert states([*two, window(3)]) == {SLUG: FindingState.STANDING}


def test_two_windows_far_apart_do_not_agree():
    """Of very many windows two name something by chance: only those within memory count."""
    windows = [window(0, SLUG), *[window(day) for day in range(1, MEMORY)], window(MEMORY, SLUG)]
    assert states(windows) == {SLUG: FindingState.FIRST_SEEN}


def test_the_combined_gain_of_other_windows_confirms_an_effect():
    """None of the others names it, and all of them gain a little by it."""
    little = [window(day, mean=0.05, t=0.65) for day in range(1, 5)]
    assert states([window(0, SLUG), *little]) == {SLUG: FindingState.CONFIRMED}
    nothing = [window(day, mean=0.005, t=0.9) for day in range(1, 5)]
    assert states([window(0, SLUG), *nothing]) == {SLUG: FindingState.FIRST_SEEN}


def test_gains_of_windows_that_name_another_effect_do_not_confirm():
    """Whatever does a part of that one's work gains there too."""
    elsewhere = [window(day, "viscous_drag", mean=0.05, t=1.5) for day in range(1, 5)]
    assert states([window(0, SLUG), *elsewhere])[SLUG] is FindingState.FIRST_SEEN


def test_an_effect_that_no_window_names_is_never_a_finding():
    """Gains that no window could name alone may be a bias that all of them share."""
    assert lasting_findings([window(day, mean=0.1, t=3.0) for day in range(30)]) == ()


def test_two_others_are_too_few_to_confirm():
    """Two windows with a gain are no more than chance."""
    others = [window(day, mean=0.2, t=2.0) for day in (1, 2)]
    assert states([window(0, SLUG), *others]) == {SLUG: FindingState.FIRST_SEEN}


@pytest.mark.parametrize("slug", ["lost_motion", "dwell_dependent_breakaway"])
def test_effects_that_chance_names_often_need_one_more_window(slug):
    """Play and dwell: scatter of the breakaways is named so on valves without."""
    named = [window(day, slug, slug=slug) for day in (0, 3, 5)]
    between = [window(day, slug=slug) for day in (1, 2, 4)]
    assert states([*named[:2], *between]) == {slug: FindingState.FIRST_SEEN}
    assert states([*named, *between]) == {slug: FindingState.CONFIRMED}
    gaining = [window(day, slug=slug, mean=0.05, t=1.0) for day in (1, 2, 4)]
    assert states([*named[:2], *gaining]) == {slug: FindingState.CONFIRMED}


def test_a_finding_goes_when_windows_on_end_do_not_name_it():
    """One that every window named is gone after three that do not; one that every second named
    needs more of them."""
    always = [window(day, SLUG) for day in range(8)]
    assert states([*always, window(8), window(9)]) == {SLUG: FindingState.STANDING}
    assert states([*always, *[window(day) for day in (8, 9, 10)]]) == {SLUG: FindingState.GONE}
    half = [window(day, *([SLUG] if day % 2 else [])) for day in range(8)]
    assert states([*half, *[window(day) for day in (8, 9, 10)]]) == {SLUG: FindingState.STANDING}
    assert states([*half, *[window(day) for day in range(8, 16)]]) == {SLUG: FindingState.GONE}


def test_a_finding_that_is_gone_comes_back_as_confirmed_anew():
    """Two windows must agree again."""
    removed = [window(day, SLUG) for day in range(4)] + [window(day) for day in range(4, 14)]
    assert states([*removed, window(14, SLUG)]) == {SLUG: FindingState.GONE}
    (finding,) = lasting_findings([*removed, window(14, SLUG), window(15, SLUG)])
    assert finding.state is FindingState.CONFIRMED
    assert finding.confirmed == BEGIN + 15 * DAY


def test_a_change_shown_by_a_window_restarts_the_evidence():
    """After a change of the positioner's settings, earlier findings do not describe the valve."""
    before = [window(day, SLUG) for day in range(5)]
    assert states([*before, window(5, anew="the curve from OP to stroke is another one")]) == {}
    (finding,) = lasting_findings([*before, window(5, SLUG, anew="another curve")])
    assert finding.first_seen == BEGIN + 5 * DAY
    assert finding.state is FindingState.FIRST_SEEN


def test_overlapping_windows_are_not_counted_twice():
    """A run that is repeated, or windows that overlap, confirm nothing."""
    hourly = [
        window(index / 240, SLUG, start=BEGIN + index / 240 * DAY - HOUR) for index in range(6)
    ]
    (finding,) = lasting_findings(hourly)
    assert finding.of == 1
    assert finding.state is FindingState.FIRST_SEEN


def test_an_ambiguous_window_counts_for_the_effect_that_others_name():
    """Three windows name a lag, one cannot separate it from a dead time: one finding, in four
    windows.
    """
    windows = [window(day, "actuator_lag", slug="actuator_lag") for day in range(3)]
    windows.append(window(3, ("dead_time", "actuator_lag"), slug="actuator_lag"))
    (finding,) = lasting_findings(windows)
    assert (finding.slug, finding.named) == ("actuator_lag", 4)


def test_an_effect_that_a_window_could_not_have_shown_is_no_evidence_against_it():
    """A window without travel says nothing of a flow force."""
    blind = [
        WindowEvidence(at=BEGIN + day * DAY, start=BEGIN + day * DAY - HOUR) for day in range(2, 30)
    ]
    (finding,) = lasting_findings([window(0, SLUG), window(1, SLUG), *blind])
    assert finding.holds
    assert finding.of == 2


@pytest.mark.parametrize("slug", ["low_speed_restick", "flow_force"])
def test_an_effect_of_friction_is_gone_when_S_is_small(slug):
    """After a repair that nobody recorded S is small, and no window could show restick: three of
    them say that it is gone. Of a flow force they say nothing, nor windows with S as before."""

    def after(S, days):
        size = Estimate(value=S, low=0.9 * S, high=1.1 * S, unit="%")
        ends = [BEGIN + day * DAY for day in range(8, 8 + days)]
        return [WindowEvidence(at=at, start=at - HOUR, S=size) for at in ends]

    worn = [window(day, slug, slug=slug, S=4.0) for day in range(8)]
    (two,) = lasting_findings([*worn, *after(0.2, 2)])
    (three,) = lasting_findings([*worn, *after(0.2, 3)])
    (as_before,) = lasting_findings([*worn, *after(3.0, 3)])
    of_friction = slug == "low_speed_restick"
    assert two.holds
    assert (three.state is FindingState.GONE) is of_friction
    assert as_before.holds


def test_confirmed_comes_before_what_was_only_seen():
    """The order of the findings is that in which people should read them."""
    windows = [window(0, "zero_shift"), window(1, SLUG), window(2, SLUG)]
    assert [lasting_finding.slug for lasting_finding in lasting_findings(windows)] == [
        SLUG,
        "zero_shift",
    ]


def test_pooled_S_lies_between_and_is_surer_than_one_window():
    """Of windows that name just what holds; one that names nothing restates another S."""
    rng = np.random.default_rng(5)
    windows = [window(day, SLUG, S=4.0 + 0.1 * rng.standard_normal()) for day in range(6)]
    windows.append(window(6, S=6.0))
    pooled = pooled_stiction(windows, lasting_findings(windows))
    assert pooled.S.low < 4.0 < pooled.S.high
    assert pooled.S.high - pooled.S.low < 0.4
    assert pooled_stiction(windows[:1], lasting_findings(windows[:1])) is None


def test_windows_that_disagree_widen_the_pooled_interval():
    """Their scatter beyond their own intervals counts."""
    apart = [window(day, SLUG, S=S) for day, S in enumerate((3.0, 5.0, 3.2, 4.8))]
    pooled = pooled_stiction(apart, lasting_findings(apart))
    assert pooled.S.high - pooled.S.low > 1.0


def test_a_finding_stays_while_windows_gain_by_it_without_naming_it():
    """A weak effect is named only now and then; the gain of the other windows supports it."""
    little = [window(day, mean=0.05, t=0.9) for day in range(1, 20)]
    assert states([window(0, SLUG), *little]) == {SLUG: FindingState.STANDING}


def test_chance_of_what_many_windows_name():
    """One window of eight at 0.01 gives 0.08, two give 28 times the square."""
    named = [replace(window(day, SLUG), p_value=0.01) for day in range(2)]
    rest = [window(day) for day in range(2, 8)]
    assert lasting_findings([named[0], *rest, window(8), window(9)]) == ()
    (item,) = lasting_findings([named[0], *rest])
    assert item.p_value == pytest.approx(7 * 0.01)
    (two,) = lasting_findings([*named, *rest])
    assert two.p_value == pytest.approx(28 * 0.01**2)
