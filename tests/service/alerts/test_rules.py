"""What is worth an alert: in N of M runs, with significance, and closed only after K without it."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime, timedelta

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stemwatch.models.estimate import Estimate
from stemwatch.models.history.evidence_over_windows import WindowEvidence
from stemwatch.models.history.trend_over_weeks import TrendOverWeeks
from stemwatch.models.history.wear_forecast import WearForecast
from stemwatch.models.mismatch.findings import (
    Effect,
    EffectEvidence,
    EffectScore,
    Finding,
    Mismatch,
    Stiction,
)
from stemwatch.models.mismatch.terms import catalogue
from stemwatch.models.verdict import Shape, Verdict
from stemwatch.service.alerts.one_per_cause import faded, one_per_cause
from stemwatch.service.alerts.rules import (
    AlertDecision,
    ValveRecord,
    alert_decision,
    apply_rules,
    has_grown,
)
from stemwatch.service.config.service_schema import AlertRules
from stemwatch.service.presenter.advice import first_step, parts_for, steps_for
from stemwatch.service.presenter.evidence_of_weeks import EvidenceOfWeeks, evidence_of_weeks
from stemwatch.service.presenter.finding import why_no_work
from stemwatch.service.presenter.suspicion_words import HOW_SURE
from stemwatch.service.store.alerts.alerts import AlertKind, AlertSeverity
from stemwatch.service.store.screenings.records import JudgedScreening, StoredValve
from tests.service.example_mismatches import named
from tests.service.report.test_without_position import cannot_tell, no_sign, suspected

NOW = datetime(2026, 3, 2, tzinfo=UTC)
RULES = AlertRules()
VALVE = StoredValve(id="FIC-1", description="Feed", criticality=3)
J = Estimate.unknown("too few slips")


def percent(value: float, half: float = 0.2) -> Estimate:
    return Estimate(value=value, low=value - half, high=value + half, unit="%")


def screening(number: int, verdict: Verdict = Verdict.HEALTHY, **changes) -> JudgedScreening:
    fields = {
        "id": number,
        "run_id": 1,
        "window": (NOW, NOW + timedelta(hours=number)),
        "verdict": verdict,
        "reason": "The stem sticks.",
        "advice": "Check the packing.",
        "severity": 50.0,
        "S": percent(2.0),
        "J": None,
    }
    return JudgedScreening(**fields | changes)


def kinds(*newest_first: Verdict | JudgedScreening, **seen) -> tuple[list, list]:
    screenings = [
        item if isinstance(item, JudgedScreening) else screening(99 - index, item)
        for index, item in enumerate(newest_first)
    ]
    raised, closed = apply_rules(ValveRecord(valve=VALVE, screenings=screenings, **seen), RULES)
    return [item.kind for item in raised], [cause.split(":")[0] for cause in closed]


STICKY, WELL, DUMB = Verdict.STICKY, Verdict.HEALTHY, Verdict.UNDETERMINED


@pytest.mark.parametrize(
    ("verdicts", "raised", "closed"),
    [
        ([STICKY], False, False),
        ([STICKY, STICKY], True, False),
        ([STICKY, WELL, STICKY], True, False),
        ([STICKY, WELL, WELL, STICKY], False, False),
        ([WELL, STICKY, STICKY], False, False),
        ([WELL, WELL, STICKY], False, False),
        ([WELL, WELL, WELL, STICKY, STICKY], False, True),
        ([WELL, WELL, WELL, STICKY], False, False),  # in the only run before: as good as half
        ([WELL, WELL, WELL, WELL, WELL, STICKY], False, True),
        ([WELL, WELL, WELL, WELL, STICKY, WELL, STICKY], False, False),
        ([WELL, WELL, WELL, WELL, WELL, STICKY, WELL, STICKY], False, True),
        ([STICKY, DUMB, DUMB, DUMB, STICKY], True, False),
        ([DUMB, DUMB, DUMB, STICKY, STICKY], True, False),
        ([DUMB, DUMB, DUMB], False, False),
        ([], False, False),
    ],
)
def test_two_of_three_raise_and_three_without_close(verdicts, raised: bool, closed: bool) -> None:
    """One run is no alert, one good run is no repair, and a run without a verdict says nothing."""
    result, over = kinds(*verdicts)
    assert (AlertKind.STICKY in result, "sticky" in over) == (raised, closed)


@given(
    st.lists(st.booleans(), max_size=12), st.integers(1, 5), st.integers(0, 5), st.integers(1, 5)
)
def test_nothing_is_raised_and_closed_at_once(present, n: int, more: int, k: int) -> None:
    """Whatever the rules are, what raises contains the finding now and what closes does not."""
    rules = AlertRules(raise_after_runs=n, of_runs=n + more, clear_after_runs=k)
    result = alert_decision(present, rules)
    if result is AlertDecision.RAISE:
        assert present[0]
        assert sum(present[: n + more]) >= n
    if result is AlertDecision.CLEAR:
        assert not any(present[:k])


SUSPECTED, NO_SIGN, OPEN = suspected(), no_sign(), cannot_tell("OP hardly moved")


@pytest.mark.parametrize(
    ("answers", "raised", "closed"),
    [
        ([SUSPECTED], False, False),
        ([SUSPECTED, SUSPECTED], True, False),
        ([SUSPECTED, OPEN, SUSPECTED], True, False),  # nobody could tell in between
        ([OPEN, SUSPECTED, SUSPECTED], False, False),
        ([NO_SIGN, SUSPECTED, SUSPECTED], False, False),
        ([NO_SIGN, NO_SIGN, NO_SIGN, NO_SIGN, NO_SIGN], False, True),
        ([None, None, None], False, True),  # windows with a verdict say more
    ],
)
def test_a_suspicion_is_an_alert_where_the_plant_asks_for_it(answers, raised, closed) -> None:
    """By the same counts as a verdict; and never without being asked for."""
    screenings = [
        screening(99 - at, WELL if answer is None else DUMB, without_position=answer)
        for at, answer in enumerate(answers)
    ]
    record = ValveRecord(valve=VALVE, screenings=screenings)
    found, over = apply_rules(record, AlertRules(sticking_suspected=True))
    assert ([AlertKind.SUSPECTED] == [one.kind for one in found]) is raised
    assert ("suspected:FIC-1" in over) is closed
    unasked, over = apply_rules(record, AlertRules())
    assert unasked == []
    assert "suspected:FIC-1" in over  # one that was raised before the plant file was changed


def test_an_alert_of_a_suspicion_says_how_sure_it_is_and_what_to_do() -> None:
    """In the words of report and page; where the stem was found to stick, that alert speaks for
    both."""
    record = ValveRecord(
        valve=VALVE,
        screenings=[screening(n, DUMB, without_position=SUSPECTED) for n in (9, 8)],
    )
    (alert,), _ = apply_rules(record, AlertRules(sticking_suspected=True))
    assert alert.text == f"FIC-1 (Feed): {SUSPECTED.reason}"
    assert alert.severity is AlertSeverity.MEDIUM  # of a valve that the plant can least do without
    assert alert.evidence["first_step"] == SUSPECTED.advice
    assert alert.evidence["then"] == HOW_SURE
    assert one_per_cause([alert], set())[0] == [alert]
    assert one_per_cause([alert], {"sticky:FIC-1"}) == ([], ["suspected:FIC-1"])


@pytest.mark.parametrize(
    ("now", "before", "grown"),
    [
        (percent(3.0), percent(1.0), True),
        (percent(1.3), percent(1.0), False),  # less than half a percent
        (percent(3.0, half=2.5), percent(1.0), False),  # nobody can be sure
        (percent(3.0), percent(1.0, half=2.5), False),
        (percent(0.5), percent(3.0), False),
        (percent(3.0), None, False),
        (J, percent(1.0), False),
    ],
)
def test_growth_must_be_large_and_certain(now, before, grown: bool) -> None:
    """S has grown when the change is worth it and both intervals agree."""
    assert has_grown(now, before, RULES.grown_S_percent) is grown


def test_growth_is_told_with_both_intervals() -> None:
    """The text names what was and what is."""
    several = [screening(n, S=percent(4.0)) for n in (2, 1)]
    raised, _ = apply_rules(
        ValveRecord(valve=VALVE, screenings=several, at_baseline=percent(1.0)), RULES
    )
    (alert,) = raised
    assert alert.kind is AlertKind.GROWN
    assert "from 1" in alert.text
    assert "to 4" in alert.text
    assert (alert.evidence["S"], alert.evidence["screening"]) == (4.0, 2)


def test_leaving_the_baseline() -> None:
    """Following the baseline network worse than the limit in two of three runs."""
    several = [screening(n) for n in (3, 2, 1)]
    seen = ValveRecord(valve=VALVE, screenings=several, ratios={3: 4.0, 1: 5.0}, ratio_limit=3.0)
    raised, _ = apply_rules(seen, RULES)
    assert [item.kind for item in raised] == [AlertKind.BASELINE]
    assert "4.0 times worse" in raised[0].text


@pytest.mark.parametrize(
    ("ratios", "raised", "closed"),
    [
        ({6: 5.0, 3: 4.0}, True, False),  # what lies between could not be compared
        ({3: 4.0, 2: 4.0}, False, False),  # nor could the newest: what is open stays open
        ({6: 1.0, 5: 1.0, 3: 4.0}, False, False),
        ({6: 1.0, 5: 1.0, 3: 1.0, 2: 9.0, 1: 9.0}, False, True),
        ({}, False, False),
    ],
)
def test_a_run_that_was_not_compared_tells_nothing(ratios, raised: bool, closed: bool) -> None:
    """A valve that moves beyond what its baseline has seen is not back at its baseline."""
    several = [screening(n) for n in (6, 5, 4, 3, 2, 1)]
    result, over = apply_rules(
        ValveRecord(valve=VALVE, screenings=several, ratios=ratios, ratio_limit=3.0), RULES
    )
    assert (AlertKind.BASELINE in [item.kind for item in result]) is raised
    assert ("baseline:FIC-1" in over) is closed


def test_a_named_mismatch_is_told_with_its_check() -> None:
    """Only what has a name and stands; closed when it had none in three runs."""
    effect = Effect(
        slug="lost_motion", members=("lost_motion",), sentence="There is play.", where="",
        check="Look at the linkage.", decide="", parameters={},
        evidence=EffectEvidence(mean=0.2, t=5.0, share=0.4),
    )  # fmt: skip
    both = Stiction(S=percent(1.0), J=J)
    mismatch = Mismatch(
        finding=Finding.NAMED, sentence="", naive=both, restated=both, effects=(effect,)
    )
    held_back = [screening(n, mismatch=mismatch, named=False) for n in (3, 2, 1)]
    raised, closed = kinds(*held_back)
    assert raised == []
    assert "mismatch" in closed
    several = [screening(n, mismatch=mismatch, named=True) for n in (2, 1)]
    confirmed = evidence(True, True, True)
    assert apply_rules(ValveRecord(valve=VALVE, screenings=several), RULES)[0] == []
    by_chance = ValveRecord(valve=VALVE, screenings=several, by_window=confirmed, stands=False)
    assert apply_rules(by_chance, RULES)[0] == []
    raised, _ = apply_rules(replace(by_chance, stands=True), RULES)
    check = catalogue()["lost_motion"].words.check
    since = "Lost motion: first seen on 2026-03-02, confirmed in 3 of 3 windows."
    assert raised[0].text == f"FIC-1 (Feed): There is play. {since}"
    assert f"{raised[0].evidence['first_step']} {raised[0].evidence['then']}" == check


def test_a_sticky_stem_is_told_with_the_first_step_of_its_work_order() -> None:
    """The shape decides it, as on the order; the advice of the screening comes after it."""
    several = [screening(n, STICKY, shape=Shape.OVERSHOOT) for n in (2, 1)]
    (alert,) = apply_rules(ValveRecord(valve=VALVE, screenings=several), RULES)[0]
    assert alert.text == "FIC-1 (Feed): The stem sticks."
    assert alert.evidence["first_step"] == steps_for(["stiction_overshoot"])[0].text
    assert alert.evidence["then"] == "Check the packing."
    assert alert.evidence["parts"] == list(parts_for(["stiction_overshoot"]))


@pytest.mark.parametrize(("now", "kind"), [(WELL, "watch"), (STICKY, "stiction_undershoot")])
def test_friction_that_grew_is_looked_at_over_months_only_while_the_stem_follows(now, kind) -> None:
    """One run that sticks is no alert of that yet, but the first step is already its own."""
    several = [screening(2, now, S=percent(4.0)), screening(1, S=percent(4.0))]
    record = ValveRecord(valve=VALVE, screenings=several, at_baseline=percent(1.0))
    (alert,) = apply_rules(record, RULES)[0]
    assert alert.kind is AlertKind.GROWN
    assert alert.evidence["first_step"] == first_step(kind)
    # Of a valve to watch none is needed yet, and the message does not say so.
    assert bool(alert.evidence["parts"]) == (kind != "watch")


def test_of_several_effects_the_newest_window_says_which_to_mend_first() -> None:
    """The alert begins with the effect at the front there, whichever more windows name."""
    both = (("lost_motion",), ("asymmetric_rate_limit",))
    weeks = evidence_of_weeks(
        WindowEvidence(at=NOW + timedelta(days=day), named=both if day else both[:1])
        for day in range(5)
    )
    assert weeks is not None
    effects = [
        Effect(
            slug=slug, members=(slug,), sentence=f"It is {slug}.", where="", check="", decide="",
            parameters={}, evidence=EffectEvidence(mean=0.2, t=5.0, share=0.4),
        )
        for slug in ("asymmetric_rate_limit", "lost_motion")
    ]  # fmt: skip
    size = Stiction(S=percent(1.0), J=J)
    mismatch = Mismatch(
        finding=Finding.NAMED, sentence="", naive=size, restated=size, effects=tuple(effects)
    )
    several = [screening(n, mismatch=mismatch, named=True) for n in (2, 1)]
    record = ValveRecord(valve=VALVE, screenings=several, by_window=weeks, stands=True)
    assert weeks.confirmed[0].slug == "lost_motion"
    (alert,) = apply_rules(record, RULES)[0]
    assert alert.text.startswith("FIC-1 (Feed): It is asymmetric_rate_limit. Asymmetric")
    assert alert.evidence["first_step"] == first_step("asymmetric_rate_limit")


def evidence(*named: bool) -> EvidenceOfWeeks | None:
    """Days on which play is named or not."""
    return evidence_of_weeks(
        WindowEvidence(
            at=NOW + timedelta(days=day),
            named=(("lost_motion",),) if item else (),
            scores=(EffectScore(slug="lost_motion", mean=0.0, t=0.0, strength=0.0),),
        )
        for day, item in enumerate(named)
    )


def test_an_effect_that_one_window_named_raises_and_closes_nothing() -> None:
    """It waits for another window; an alert that was open stays open meanwhile."""
    well = [screening(n) for n in (4, 3, 2, 1)]
    seen = ValveRecord(valve=VALVE, screenings=well, by_window=evidence(True, False), stands=True)
    raised, closed = apply_rules(seen, RULES)
    assert AlertKind.MISMATCH not in {item.kind for item in raised}
    assert "mismatch:FIC-1" not in closed


@pytest.mark.parametrize(("slug", "alone"), [("low_speed_restick", False), ("lost_motion", True)])
def test_friction_that_shows_twice_is_one_alert(slug: str, alone: bool) -> None:
    """On a valve that sticks, re-sticking at low speed has the same cause; play has another."""
    windows = [WindowEvidence(at=NOW + timedelta(days=day), named=((slug,),)) for day in range(3)]
    several = [screening(n, STICKY) for n in (3, 2, 1)]
    of_weeks = evidence_of_weeks(windows)
    seen = ValveRecord(valve=VALVE, screenings=several, by_window=of_weeks, stands=True)
    raised, joined = one_per_cause(apply_rules(seen, RULES)[0], ())
    assert (AlertKind.MISMATCH in {item.kind for item in raised}) is alone
    assert ("mismatch:FIC-1" in joined) is not alone
    sticky = next(item for item in raised if item.kind is AlertKind.STICKY)
    assert ("Also seen" in sticky.text) is not alone


def test_an_effect_of_friction_has_the_cause_of_a_sticking_stem() -> None:
    """Before S passes its limit and after: one cause, which is not over while either is there."""
    windows = [
        WindowEvidence(at=NOW + timedelta(days=day), named=(("low_speed_restick",),))
        for day in range(3)
    ]
    of_weeks = evidence_of_weeks(windows)
    well = [screening(n) for n in (4, 3, 2, 1)]
    seen = ValveRecord(valve=VALVE, screenings=well, by_window=of_weeks, stands=True)
    raised, closed = apply_rules(seen, RULES)
    assert [(item.kind, item.cause) for item in raised] == [(AlertKind.MISMATCH, "sticky:FIC-1")]
    assert "sticky:FIC-1" not in closed
    play = ValveRecord(valve=VALVE, screenings=well, by_window=evidence(*[True] * 4), stands=True)
    raised, closed = apply_rules(play, RULES)
    assert [item.cause for item in raised] == ["mismatch:FIC-1"]
    assert "sticky:FIC-1" in closed


def told(record: ValveRecord, *still_open: str) -> dict[AlertKind, tuple[str, ...]]:
    """The alerts of a run by kind, with the causes under which their trouble stood so far."""
    raised, closed = apply_rules(record, RULES)
    alerts, _ = one_per_cause(raised, set(still_open) - set(closed), faded(record, RULES))
    return {alert.kind: alert.formerly for alert in alerts}


def test_a_name_that_replaces_another_is_the_same_trouble() -> None:
    """Play was named while S grew; now the stem sticks and the windows do not name play any more.
    While they name both there are two troubles, and after work on the valve there is a new one."""
    stuck = [screening(9 - n, STICKY) for n in range(3)]
    replaced = ValveRecord(
        valve=VALVE, screenings=stuck, stands=True,
        by_window=evidence(True, True, True, False, False),
    )  # fmt: skip
    assert told(replaced, "mismatch:FIC-1") == {AlertKind.STICKY: ("mismatch:FIC-1",)}
    assert told(replaced) == {AlertKind.STICKY: ()}
    assert told(replaced, "sticky:FIC-1") == {AlertKind.STICKY: ()}
    both = replace(replaced, by_window=evidence(True, True, True, True, True))
    assert told(both, "mismatch:FIC-1") == {AlertKind.STICKY: (), AlertKind.MISMATCH: ()}
    worked = replace(replaced, worked_at=[NOW + timedelta(minutes=1)])
    assert AlertKind.STICKY not in told(worked, "mismatch:FIC-1"), "the work lies in each window"


def test_a_sticking_stem_that_turns_out_to_be_play_keeps_its_alert() -> None:
    """The windows name play in place of it; where they still tell both, the two stand."""
    freed = [screening(9, WELL), screening(8, WELL), screening(7, STICKY)]
    play = ValveRecord(
        valve=VALVE, screenings=freed, stands=True, by_window=evidence(True, True, True)
    )
    assert told(play, "sticky:FIC-1") == {AlertKind.MISMATCH: ("sticky:FIC-1",)}
    still = replace(play, screenings=[screening(9, WELL), *freed[2:], screening(6, STICKY)])
    assert told(still, "sticky:FIC-1") == {AlertKind.MISMATCH: ()}
    day = timedelta(days=1)
    dated = [
        replace(one, window=(NOW + n * day, NOW + (n + 1) * day))
        for n, one in zip((2, 1, 0), freed, strict=True)
    ]
    repaired = replace(play, screenings=dated, worked_at=[NOW + 1.5 * day])
    assert told(repaired, "sticky:FIC-1") == {AlertKind.MISMATCH: ()}


def test_an_effect_that_is_gone_closes_its_alert() -> None:
    """After windows on end without it."""
    well = [screening(n) for n in (4, 3, 2, 1)]
    removed = evidence(*[True] * 4, *[False] * 6)
    seen = ValveRecord(valve=VALVE, screenings=well, by_window=removed)
    assert "mismatch:FIC-1" in apply_rules(seen, RULES)[1]


@pytest.mark.parametrize(("criticality", "severity"), [(3, "high"), (2, "medium"), (1, "low")])
def test_urgency_follows_the_valve(criticality: int, severity: str) -> None:
    """The valve that the plant can least do without is the most urgent."""
    several = [screening(n, STICKY) for n in (2, 1)]
    seen = ValveRecord(valve=StoredValve(id="V", criticality=criticality), screenings=several)
    assert apply_rules(seen, RULES)[0][0].severity is AlertSeverity(severity)


def test_a_window_that_the_work_lies_in_tells_nothing() -> None:
    """It holds the old valve and the new one: it neither raises, nor closes, nor counts."""
    day = timedelta(days=1)
    days = [(NOW + n * day, NOW + (n + 1) * day) for n in range(5)]
    work = NOW + 2.5 * day
    mixed = screening(3, STICKY, window=days[2])
    before = [screening(2, STICKY, window=days[1]), screening(1, STICKY, window=days[0])]
    assert AlertKind.STICKY in kinds(mixed, *before)[0]
    raised, closed = kinds(mixed, *before, worked_at=[work])
    assert AlertKind.STICKY not in raised
    assert AlertKind.STICKY.value not in closed
    later = screening(4, STICKY, window=days[3])
    clean = screening(1, WELL, window=days[0])
    assert AlertKind.STICKY in kinds(later, mixed, clean)[0]
    assert AlertKind.STICKY not in kinds(later, mixed, clean, worked_at=[work])[0]


def foresight(weeks: float | None, *, rises: float = 1.0) -> TrendOverWeeks:
    """S that rises by 0.3 % a month and reaches 1.5 % in ``weeks``, or nobody knows when."""
    until = Estimate.unknown("S does not rise by more than its own scatter", "weeks")
    if weeks is not None:
        until = Estimate(value=weeks, low=0.5 * weeks, high=1.5 * weeks, unit="weeks")
    forecast = WearForecast(limit=1.5, until=until, probability_rises=rises)
    return TrendOverWeeks(per_month=0.3, low=0.2, high=0.4, days=80.0, forecast=forecast)


@pytest.mark.parametrize(
    ("weeks", "raised", "closed"),
    [
        (foresight(6.0), True, False),
        (foresight(8.0), True, False),
        (foresight(9.0), False, False),  # no alert that comes and goes with the day
        (foresight(17.0), False, True),
        (foresight(None), False, False),
        (foresight(None, rises=0.4), False, True),
        (None, False, True),
    ],
)
def test_what_is_foreseen_is_raised_at_once_and_closed_where_no_trend_stands(
    weeks: TrendOverWeeks | None, raised: bool, closed: bool
) -> None:
    """One run is enough, since the trend is of weeks; where nothing can be said nothing changes."""
    found = kinds(screening(9, S=percent(1.2)), weeks=weeks)
    assert (AlertKind.FORESEEN in found[0], "foreseen" in found[1]) == (raised, closed)


def test_the_foreseen_alert_says_when_and_gives_way_to_the_sticking_stem() -> None:
    """Its text has the rate and the weeks; once the stem sticks, that is the alert."""
    record = ValveRecord(
        valve=replace(VALVE, unit="200"),
        screenings=[screening(9, S=percent(1.2))],
        weeks=foresight(6.0),
    )
    (alert,), _ = apply_rules(record, RULES)
    assert alert.text.startswith("FIC-1 (Feed, unit 200): S +0.30 % a month (+0.20 to +0.40), ")
    assert "reaches 1.5 % in 3 to 9 weeks, where the stem counts as sticky." in alert.text
    assert alert.evidence["unit"] == "200"
    assert alert.severity is AlertSeverity.MEDIUM
    stuck = [screening(9 - n, STICKY) for n in range(3)]
    raised, closed = apply_rules(replace(record, screenings=stuck), RULES)
    assert [one.kind for one in raised] == [AlertKind.STICKY]
    assert "foreseen:FIC-1" not in closed
    ((sticky,), _) = one_per_cause(raised, {"foreseen:FIC-1"})
    assert sticky.formerly == ("foreseen:FIC-1",)
    none, _ = apply_rules(record, AlertRules(foreseen_within_weeks=0))
    assert none == []


def test_growth_is_evidence_of_what_is_foreseen() -> None:
    """One alert for a valve that wears, not two."""
    record = ValveRecord(
        valve=VALVE,
        screenings=[screening(9 - n, S=percent(1.2, 0.1)) for n in range(3)],
        at_baseline=percent(0.4, 0.1),
        weeks=foresight(6.0),
    )
    raised, _ = apply_rules(record, RULES)
    ((lead, *rest), joined) = one_per_cause(raised, ())
    assert lead.kind is AlertKind.FORESEEN
    assert rest == []
    assert "Also seen: S has grown from" in lead.text
    assert joined == ["grown:FIC-1"]


def test_an_effect_that_belongs_to_the_machine_is_no_defect_in_the_message_either() -> None:
    """A fitter who reads the mail alone would look for what the work order says needs no work."""
    found = named()
    inherent, defect = (replace(found.effects[0], inherent=flag) for flag in (True, False))
    texts = []
    for effect in (inherent, defect):
        newest = screening(
            2,
            STICKY,
            reason=f"The stem sticks. Beside friction: {effect.sentence}",
            mismatch=replace(found, effects=(effect,)),
        )
        record = ValveRecord(valve=VALVE, screenings=[newest, screening(1, STICKY)])
        raised, _ = apply_rules(record, RULES)
        texts.append(raised[0].text)
    assert texts[0].endswith(f"{inherent.sentence} {why_no_work([inherent])}")
    assert texts[1].endswith(defect.sentence)
