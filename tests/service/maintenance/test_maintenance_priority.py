"""Priority and history: how urgent, and since when."""

from __future__ import annotations

import re
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from zoneinfo import ZoneInfo

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stemwatch.models.screening_result import PreviousFinding
from stemwatch.models.verdict import NoVerdict, Verdict
from stemwatch.service.maintenance.first_seen import first_seen, seen_sentence, work_sentence
from stemwatch.service.maintenance.valve_history import LOOK_BACK
from stemwatch.service.maintenance.work_sheet import (
    FALSE_EFFECT,
    FALSE_EFFECT_SCATTERED,
    FALSE_STICKY,
)
from stemwatch.service.presenter import work_decision as k
from stemwatch.service.presenter.urgency import CLASSES, DAYS, WEIGHT_OF_CRITICALITY, priority
from stemwatch.service.presenter.work_decision import (
    OTHER_SEVERITY,
    SEVERITY_OF,
    SUSPECTED_SEVERITY,
    decide,
)
from stemwatch.service.store.screenings.records import Remark
from tests.service.report.conftest import screening

REPOSITORY = Path(__file__).parents[3]
DAY = datetime(2026, 3, 1, 6, 0, tzinfo=UTC)
BASE = screening("FV-1", samples=60)


def code(severity=80.0, criticality="3") -> int:
    """The class of a finding."""
    return priority(severity, criticality).code


def test_the_classes_are_those_that_are_published():
    """A finding at each limit."""
    assert [code(severity) for severity in (80.0, 79.0, 55.0, 54.0, 30.0, 29.0)] == [
        *(1, 2, 2, 3, 3, 4)
    ]


@given(
    severities=st.tuples(st.floats(0, 100), st.floats(0, 100)),
    criticality=st.sampled_from(["1", "2", "3", "", "A"]),
)
def test_worse_is_never_less_urgent(severities, criticality):
    """More severity or more criticality never moves a valve back."""
    mild, grave = sorted(severities)
    assert code(grave, criticality) <= code(mild, criticality)
    assert code(mild, "3") <= code(mild, criticality) <= code(mild, "1")


def test_a_stem_that_may_be_stuck_fast_stands_beside_the_worst_sticky_ones():
    """The screening ranks it low because it could measure nothing; somebody has to look."""
    blind = replace(
        BASE,
        verdict=Verdict.UNDETERMINED,
        no_verdict=NoVerdict.POSITION_FROZEN,
        severity=15.0,
        shape=None,
    )
    decided = decide(blind, stands=None)
    assert decided.kinds == (k.FROZEN,)
    assert [code(decided.severity, criticality=item) for item in "321"] == [1, 2, 3]


def test_the_reason_names_both_factors_and_what_the_plant_left_out():
    """A planner can disagree with a factor, not with a number."""
    reason = priority(80.0, "A").reason
    assert reason == "severity 80 of 100, criticality 2 of 3 (plant says 'A')"
    assert "(none is given)" in priority(50.0, "").reason


def test_the_end_date_is_a_day_of_the_plant():
    """Shortly before midnight in UTC it is tomorrow in Berlin."""
    late = datetime(2026, 3, 1, 23, 30, tzinfo=UTC)
    result = priority(90.0, "3")
    assert result.due(late, ZoneInfo("Europe/Berlin")).isoformat() == "2026-03-09"
    assert result.due(late, UTC).isoformat() == "2026-03-08"


def test_the_documentation_has_these_numbers():
    """Limits, days, weights and own severities."""
    page = (REPOSITORY / "docs" / "maintenance-report.md").read_text("utf-8")
    for least, number in CLASSES:
        days = DAYS[number]
        assert re.search(rf"\| {number} \| {least:.2f} \| [^|]+ \| {days} \|", page), number
    for weight in WEIGHT_OF_CRITICALITY.values():
        assert f"{weight:g}" in page
    for severity in (*SEVERITY_OF.values(), OTHER_SEVERITY, SUSPECTED_SEVERITY):
        assert f"{severity:.0f}" in page


def test_the_false_alarms_are_those_that_were_counted():
    """What a page publishes was counted; docs/ has the count, the README its gist."""
    docs = REPOSITORY / "docs"
    trial, proof = ((docs / name).read_text("utf-8") for name in ("trial.md", "proof.md"))
    count, of, interval = FALSE_STICKY
    assert re.search(
        rf"\*\*{of} healthy valves:\*\* called sticky \| \*\*{count}, .*\({interval}\)", trial
    )
    assert f"{count} of {of} healthy valves" in (REPOSITORY / "README.md").read_text("utf-8")
    for row, (count, of, interval) in (
        ("false alarm", FALSE_EFFECT),
        ("the same with 12 % scatter", FALSE_EFFECT_SCATTERED),
    ):
        result = interval.removesuffix(" %")
        assert re.search(rf"{row} \| {count} of {of}, .*\({result}\)", proof)


def past(*verdicts: Verdict, **of_each) -> list[PreviousFinding]:
    """Weekly screenings, newest first."""
    return [
        PreviousFinding(
            at=DAY - timedelta(days=7 * week), run=50 - week, verdict=verdict, **of_each
        )
        for week, verdict in enumerate(verdicts, start=1)
    ]


S, W, H, U = Verdict.STICKY, Verdict.WATCH, Verdict.HEALTHY, Verdict.UNDETERMINED


@pytest.mark.parametrize(
    ("earlier", "count", "first", "before"),
    [
        ((), 1, None, None),
        ((H,), 1, None, 49),
        ((S, S, H), 3, 48, 47),
        ((S, U, S, W), 3, 47, 46),
        ((U, U), 1, None, None),
        ((S, S), 3, 48, None),
    ],
)
def test_a_finding_goes_back_as_far_as_no_verdict_denies_it(earlier, count, first, before):
    """Screenings without a verdict neither confirm nor break it."""
    result = first_seen("stiction_undershoot", past(*earlier))
    assert result.count == count
    assert (result.first and result.first.run) == first
    assert (result.before and result.before.run) == before


def test_an_effect_goes_back_by_its_name():
    """Another effect, or the same valve without one, ends it."""
    earlier = [*past(W, W, effects=("lost_motion",)), *past(W, W, W, effects=())[2:]]
    assert first_seen("lost_motion", earlier).count == 3
    assert first_seen("zero_shift", earlier).count == 1


def test_a_dead_transmitter_goes_back_over_screenings_without_a_verdict():
    """They are what it makes."""
    assert first_seen(k.FROZEN, past(U, U, H)).count == 3


def test_the_sentence_says_when_how_often_and_what_was_before():
    """In the plant's own time."""
    text = seen_sentence(
        first_seen("stiction_undershoot", past(S, S, H)), ZoneInfo("Europe/Berlin")
    )
    assert text == (
        "Seen since 2026-02-15 07:00 (run 48), in 3 screenings in a row; the one before, of "
        "2026-02-08 07:00, said healthy and did not show it."
    )
    assert seen_sentence(first_seen("watch", []), UTC).startswith("First screening")
    assert seen_sentence(first_seen("watch", past(H)), UTC).startswith("New in this screening")


def test_a_record_that_was_not_read_to_its_end_says_at_least():
    """Nobody is told a date that is only where reading stopped."""
    assert "at least since" in seen_sentence(first_seen("watch", past(*[S] * LOOK_BACK)), UTC)


def test_work_is_set_against_the_finding():
    """A finding from before the work is told from one that came after it, and nothing is said of
    the work where only windows from before it are known."""
    work = [Remark(valve="FV-1", at=DAY - timedelta(days=10), note="packing renewed", who="")]
    after = work_sentence(work, DAY, DAY, UTC)
    assert after == "Last work: 2026-02-19 06:00, packing renewed. It came 10 days after that work."
    before = DAY - timedelta(days=20)
    assert "still there" in work_sentence(work, before, DAY, UTC)
    for newest in (before, work[0].at - timedelta(hours=1), None):
        told = work_sentence(work, before, newest, UTC)
        assert told.endswith("not known: no window after it was screened.")
    assert work_sentence([], DAY, DAY, UTC) == ""


@given(severity=st.floats(0, 100), criticality=st.sampled_from(["1", "2", "3"]))
def test_a_reader_comes_to_the_printed_class(severity: float, criticality: str) -> None:
    """The documented rule, applied to the numbers that are printed, gives the class beside them."""
    result = priority(severity, criticality)
    printed = re.search(r"severity (\d+) of 100, criticality (\d) of 3", result.reason)
    assert printed is not None
    by_hand = int(printed[1]) * WEIGHT_OF_CRITICALITY[printed[2]]
    assert result.code == next(code for least, code in CLASSES if by_hand >= 100 * least - 1e-6)
