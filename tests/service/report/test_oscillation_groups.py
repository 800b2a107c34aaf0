"""What report and contract say of loops that oscillate together."""

from __future__ import annotations

import json
from dataclasses import replace
from datetime import UTC, datetime
from zoneinfo import ZoneInfo

import pytest

from stemwatch.models.estimate import Estimate
from stemwatch.models.oscillation_groups.plant_groups import GroupMember, OscillationGroup
from stemwatch.models.verdict import NoVerdict, Verdict
from stemwatch.models.without_position.suspicion import Suspicion, WithoutPosition
from stemwatch.service.maintenance.work_list import work_list_of
from stemwatch.service.presenter import oscillation_words as said
from stemwatch.service.report.group_pictures import MOST_ROWS, spectra_map, strength_bars
from stemwatch.service.report.html_page import html_bytes
from stemwatch.service.report.json_contract import to_contract
from stemwatch.service.report.ranking import rank_valves
from stemwatch.service.report.report_context import ReportContext

STARTED = datetime(2026, 3, 2, 6, tzinfo=UTC)
GROUP = OscillationGroup(
    period_s=229.0,
    members=(
        GroupMember(loop="FIC-104", share=0.8, probability=0.6, evidence=("it leads",)),
        GroupMember(loop="TIC-2", share=0.5, probability=0.2),
        GroupMember(loop="<b>LIC", share=0.2, probability=0.1),
    ),
    outside=0.1,
    regularity=5.0,
    start=STARTED,
    duration_s=86400.0,
    since=datetime(2026, 3, 2, 18, tzinfo=UTC),
    strength=(0.1, 1.4),
    periods_s=(40.0, 229.0, 900.0),
    spectra=((0.0, 1.0, 0.3), (0.1, 1.0, 0.3), (0.0, 1.0, 0.9)),
)


def test_source_and_victims_are_told_apart() -> None:
    """The source names whom it moves; a victim names the source and that tuning does not help."""
    zone = ZoneInfo("Europe/Berlin")
    assert said.headline(GROUP) == (
        "3 loops oscillate together every 3.8 min: it likely begins in FIC-104 (60 %), else in "
        "TIC-2 (20 %)"
    )
    first = said.loop_sentence(GROUP, "FIC-104", zone)
    assert "Oscillates since 2026-03-02 19:00 with TIC-2, <b>LIC (80 % of its PV" in first
    assert "likeliest source (60 %): it leads." in first
    victim = said.loop_sentence(GROUP, "TIC-2", zone)
    assert "with FIC-104 (50 % of its PV's variance" in victim
    assert "retuning this loop would not help" in victim
    assert "50 % of the variance of these 3 loops on average, and up to 80 %" in said.cost_sentence(
        GROUP
    )
    assert said.loop_sentences([GROUP], "other", zone) == []


def test_a_second_loop_that_hardly_comes_into_question_is_not_named() -> None:
    """Nobody looks next at a loop with 2 %."""
    members = (replace(GROUP.members[0], probability=0.97), *GROUP.members[1:])
    certain = replace(GROUP, members=(members[0], replace(members[1], probability=0.02)))
    assert said.headline(certain).endswith("it likely begins in FIC-104 (97 %)")


def test_periods_are_said_in_the_unit_that_fits() -> None:
    """To two digits, without decimals that nobody measured."""
    said_of = {42.0: "42 s", 229.0: "3.8 min", 1080.0: "18 min", 9000.0: "2.5 h"}
    assert {period: said.period_in_words(period) for period in said_of} == said_of


@pytest.mark.parametrize(
    ("moved", "answer", "shows_from", "unit", "has_order"),
    [
        (False, Suspicion.CANNOT_TELL, None, "%", True),
        (False, Suspicion.SUSPECTED, None, "%", True),
        (False, Suspicion.NO_SIGN, 2.0, "%", False),
        (False, Suspicion.NO_SIGN, 2.1, "%", True),
        (False, Suspicion.NO_SIGN, 2.0, "m3/h", True),
        (True, Suspicion.CANNOT_TELL, None, "%", False),
        (True, Suspicion.NO_SIGN, 2.1, "%", False),
    ],
)
def test_a_loop_without_position_that_another_moves_makes_no_order(
    make_screening, moved, answer, shows_from, unit, has_order
) -> None:
    """Nor one without any sign of sticking where 2 % of OP would have shown. What to do at the
    others, OP and PV say."""
    suspicion = WithoutPosition(
        verdict=answer,
        reason="r",
        advice="Do a bump test.",
        apparent_S=Estimate.unknown("r", unit=unit),
        shows_from=shows_from,
    )
    screening = replace(
        make_screening(valve="TIC-2", verdict=Verdict.UNDETERMINED),
        no_verdict=NoVerdict.NO_POSITION,
        advice="Record the position.",
        without_position=suspicion,
    )
    context = ReportContext(started=STARTED, groups=(GROUP,) if moved else ())
    ranked = rank_valves([screening], context)
    assert ranked[0].decision.has_order is has_order
    assert ranked.counts.orders == int(has_order)
    assert ranked[0].finding.next_step == (
        "Look at FIC-104 first, where its oscillation likely begins. Retuning this loop would not "
        "help. After that: Do a bump test."
        if moved
        else "Do a bump test."
    )
    assert len(work_list_of([screening], context).to_work_on) == int(has_order)


def test_no_source_among_them_is_an_answer() -> None:
    """Where a cause outside is likelier than any loop, no loop is blamed."""
    outside = replace(GROUP, outside=0.7)
    assert outside.source == ""
    assert "none of them is the source (70 %)" in said.headline(outside)
    assert "none of them is the source" in said.loop_sentence(outside, "FIC-104", UTC)
    assert "with 2 other loops (80 %" in said.loop_sentence(outside, "FIC-104", UTC)
    of_two = replace(outside, members=outside.members[:2])
    assert "with TIC-2 (80 %" in said.loop_sentence(of_two, "FIC-104", UTC)


def test_pictures_escape_names_and_hold_many_loops() -> None:
    """A tag's spelling cannot change the page; a hundred loops have the first rows."""
    drawn = spectra_map(GROUP)
    assert "&lt;b&gt;LIC" in drawn
    assert drawn.count("v16h-9z") == 7  # cells
    changed = replace(GROUP, members=GROUP.members * 40, spectra=GROUP.spectra * 40)
    assert spectra_map(changed).count('text-anchor="end"') == MOST_ROWS
    bars = strength_bars(GROUP, UTC)
    assert bars.count("<rect") == 2
    assert "2026-03-02 06:00" in bars
    assert "2026-03-03 06:00" in bars
    assert "<text" not in strength_bars(replace(GROUP, start=None), UTC)


def test_the_report_has_a_section_and_each_member_its_sentence(make_screening) -> None:
    """Without groups neither is there."""
    screening = make_screening(valve="TIC-2")
    for groups in ((), (GROUP,)):
        context = ReportContext(started=STARTED, groups=groups)
        page = html_bytes(rank_valves([screening], context), context).decode()
        assert ("Loops that oscillate together" in page) == bool(groups)
        assert ("where it more likely begins" in page) == bool(groups)
    assert "<b>LIC" not in page


def test_the_contract_has_the_groups_of_a_loop(make_screening) -> None:
    """An additive field; empty for loops of no group."""
    oscillates_with = to_contract(make_screening(valve="TIC-2"), groups=[GROUP])["oscillates_with"]
    assert json.loads(json.dumps(oscillates_with)) == [
        {
            "period_s": 229.0,
            "loops": ["FIC-104", "TIC-2", "<b>LIC"],
            "share": 0.5,
            "source": "FIC-104",
            "source_probability": 0.6,
            "outside_probability": 0.1,
            "since": "2026-03-02T18:00:00+00:00",
            "first_found": "2026-03-02T06:00:00+00:00",
            "windows": 1,
        }
    ]
    assert to_contract(make_screening(valve="X"), groups=[GROUP])["oscillates_with"] == []
