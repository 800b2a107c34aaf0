"""The operator's sheet: the same words and numbers as text, JSON, page and PDF."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from datetime import UTC, datetime
from itertools import pairwise

import pytest

from stemwatch.models.field_test.programme import TestLimits
from stemwatch.models.mismatch.findings import Finding
from stemwatch.service.field_test.plan_from_screening import plan_of
from stemwatch.service.field_test.sheet import LAST_WORD, clock, op_moves_of, sheet_of, to_object
from stemwatch.service.field_test.sheet_files import html_of, pdf_of, write_sheet
from stemwatch.service.maintenance.paper import markup
from stemwatch.service.report import ReportContext
from tests.service.example_mismatches import of_every_kind
from tests.service.field_test.planned_tests import (
    plan_of_a_bump,
    plan_of_nothing,
    plan_that_tells,
    plan_without_room,
)

HOSTILE = "</script><b>FIC-1\x07"
CONTEXT = ReportContext(
    started=datetime(2026, 3, 2, 12, 30, tzinfo=UTC), plant="Unit 7", zone="UTC"
)
PLANS = (plan_that_tells, plan_without_room, plan_of_nothing, plan_of_a_bump)


def test_sheet_says_what_is_told_apart_how_surely_and_that_a_person_sets_op():
    """The golden words of a sheet for lag against dead time."""
    sheet = sheet_of(plan_that_tells(), "FIC-1")
    assert sheet.title == "FIC-1: the test that tells actuator lag and dead time apart"
    assert re.fullmatch(
        r"The right one of actuator lag and dead time is found with a probability of more than "
        r"92 %, in \d minutes with OP between 4\d\.\d and 5\d\.\d %; each is taken to be as "
        r"likely as the others\.",
        sheet.headline,
    )
    assert sheet.remarks[-1] == LAST_WORD
    assert any(
        re.search(r"PV is expected to change by at most .* t/h", remark) for remark in sheet.remarks
    )
    assert "OP was last at 47.0 %." in " ".join(sheet.remarks)
    assert sheet.stop[-1] == "To stop: OP back to 47.0 %, and the controller to automatic."
    assert sheet.stop[0] == "PV has changed by more than 20 t/h from where it was."
    assert [outcome.name for outcome in sheet.outcomes] == ["actuator lag", "dead time"]
    assert all(outcome.means and outcome.then for outcome in sheet.outcomes)


@pytest.mark.parametrize("plan", [plan_that_tells, plan_of_a_bump])
def test_op_moves_hold_every_value_in_order_and_end_where_op_began(plan):
    """Moves group the values of OP and lose none."""
    programme = plan().test.programme
    legs = op_moves_of(programme, plan().op)
    assert sum(leg.values for leg in legs) == sum(len(move.changes) for move in programme.moves)
    assert all(b.at_s > a.at_s for a, b in pairwise(legs))
    assert legs[-1].change == 0.0
    assert legs[-1].to == plan().op
    starts = {value.at_s for value in programme.values()}
    assert all(leg.at_s in starts for leg in legs)


def test_readings_are_where_the_rivals_differ():
    """Every instant that the operator watches tells the rivals apart by a multiple of the noise."""
    sheet = sheet_of(plan_that_tells(), "FIC-1")
    assert sheet.readings
    for look in sheet.readings:
        assert abs(look.mv[0] - look.mv[1]) > 5.0 * sheet.plan.question.sigma
    assert all(b.at_s > a.at_s for a, b in pairwise(sheet.readings))


def test_plan_without_a_test_says_why_and_has_nothing_to_do():
    """No room for PV: the limits that would do stand in the remarks, or that there are none."""
    sheet = sheet_of(plan_without_room(), "FIC-1")
    assert sheet.moves == ()
    assert "upsets PV by more than 0.05" in sheet.headline
    nothing = sheet_of(plan_of_nothing(), "FIC-1")
    assert nothing.headline.startswith("Nothing is left to be told apart")


def test_what_is_left_open_is_not_said_to_be_settled():
    """Where the valve's page says that it cannot be told whether something is left out, so does the
    plan, though no two explanations compete."""
    (unknown, *_) = [one for one in of_every_kind() if one.finding is Finding.UNKNOWN]
    sheet = sheet_of(plan_of(replace(unknown, open_question=None), TestLimits()), "FIC-1")
    assert sheet.headline.startswith("No test can be planned: the last recording leaves open")


def test_bump_test_of_an_unknown_op_is_given_in_changes():
    """Where neither OP nor PV is known the sheet says so."""
    sheet = sheet_of(plan_of_a_bump(), "LIC-2")
    assert sheet.title == "LIC-2: the bump test that would give a verdict"
    text = " ".join(sheet.remarks)
    assert "take the changes from where OP is" in text
    assert "How PV answers OP is not known" in text


def test_bump_test_says_what_a_position_that_stands_still_means():
    """The valve may have got no verdict because its reading is frozen: then MV follows neither
    column, and neither explanation of the other tests is true."""
    text = sheet_of(plan_of_a_bump(), "FIC-110").passes
    assert "stands still all the time is a reading that is frozen or a stem that is stuck" in text
    assert "watches the stem itself" in text
    assert "frozen" not in sheet_of(plan_that_tells(), "FIC-110").passes


@pytest.mark.parametrize("plan", PLANS)
def test_json_has_no_number_that_json_lacks_and_the_limits_hold(plan):
    """Every value of OP in the JSON lies within the limits beside it."""
    as_object = to_object(sheet_of(plan(), "FIC-1"))
    json.loads(json.dumps(as_object, allow_nan=False))
    limits = as_object["limits"]
    for value in as_object["values"]:
        assert abs(value["change"]) <= limits["amplitude_percent"]
        assert limits["op_low_percent"] <= value["op_percent"] <= limits["op_high_percent"]
    assert bool(as_object["values"]) == (as_object["probability"] is not None)


@pytest.mark.parametrize("plan", PLANS)
def test_page_loads_nothing_and_escapes_the_tag(plan):
    """No script, no address, and a tag stays a tag."""
    text = html_of(sheet_of(plan(), HOSTILE), CONTEXT).decode()
    assert "<script" not in text
    assert "<b>FIC-1" not in text
    assert not re.search(r"(?:src|href)\s*=", text)
    assert "default-src 'none'" in text
    assert "Unit 7" in text


@pytest.mark.parametrize("plan", PLANS)
def test_commands_are_set_as_code_and_no_mark_of_it_is_left(plan):
    """A sentence marks its commands by backticks, for a terminal. On the page they are code, on
    paper they stand between quotation marks."""
    sheet = sheet_of(plan(), "FIC-1")
    text = html_of(sheet, CONTEXT).decode()
    assert "`" not in text
    assert ("<code>stemwatch explain" in text) == ("`stemwatch explain" in sheet.passes)
    paper = markup(f"{sheet.passes} {sheet.after}", bold=False)
    assert "`" not in paper
    assert paper.count("“stemwatch ") == f"{sheet.passes} {sheet.after}".count("`stemwatch ")


@pytest.mark.parametrize("plan", PLANS)
def test_pdf_is_one_page_and_the_same_for_the_same_plan(plan):
    """A4, one page, byte for byte."""
    sheet = sheet_of(plan(), "FIC-1")
    first, second = (pdf_of(sheet, CONTEXT, compress=False) for _ in range(2))
    assert first == second
    assert first.startswith(b"%PDF")
    assert len(re.findall(rb"/Type /Page\b", first)) == 1


def test_files_are_written_beside_each_other(tmp_path):
    """The folder is made where there is none."""
    page, paper = write_sheet(sheet_of(plan_that_tells(), "FIC-1"), CONTEXT, tmp_path / "a" / "b")
    assert page.name == "test-plan.html"
    assert paper.read_bytes().startswith(b"%PDF")


@pytest.mark.parametrize(("seconds", "text"), [(0.0, "0:00"), (65.4, "1:05"), (600.0, "10:00")])
def test_times_are_minutes_and_seconds(seconds, text):
    """Seconds are written as minutes and seconds."""
    assert clock(seconds) == text


def test_what_only_a_test_by_hand_tells_is_not_said_to_be_settled():
    """Where the valve's page names two effects that this recording cannot tell apart, and no test
    between them can be designed, the plan says which, and what to do by hand."""
    (named,) = [one for one in of_every_kind() if one.finding is Finding.NAMED]
    (first, *_) = named.effects
    pair = replace(first, members=(first.slug, "low_speed_restick"), decide="Ramp OP slowly.")
    left_open = replace(named, effects=(pair,), open_question=None)
    headline = sheet_of(plan_of(left_open, TestLimits()), "FIC-1").headline
    assert headline.endswith("or low speed restick is left open, and only a test by hand tells: "
                             "Ramp OP slowly.")  # fmt: skip
    alone = replace(named, effects=(replace(first, members=(first.slug,)),), open_question=None)
    assert "Nothing is left to be told" in sheet_of(plan_of(alone, TestLimits()), "FIC-1").headline
