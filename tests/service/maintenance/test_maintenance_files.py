"""The four files: pages for people, rows for a maintenance system."""

from __future__ import annotations

import io
import re
from dataclasses import replace
from datetime import UTC, datetime

import openpyxl
import pytest

from stemwatch.models.verdict import Verdict
from stemwatch.service.maintenance import write_maintenance
from stemwatch.service.maintenance.maintenance_html import work_list_html
from stemwatch.service.maintenance.paper import BOX, TypeSize, height_of, is_whole, runs
from stemwatch.service.maintenance.pdf import ROOM, SIZES, _fitting, _sheet, work_list_pdf
from stemwatch.service.maintenance.work_list import work_list_of
from stemwatch.service.maintenance.work_orders import (
    FIELDS,
    LONG_TEXT,
    SHORT_TEXT,
    orders_xlsx,
)
from stemwatch.service.whole_files import ReportNotWritten
from tests.service.maintenance.example_work_list import (
    BACKGROUND,
    HOSTILE,
    context,
    frozen,
    longest,
    mixed,
    order_rows,
    text_of_pdf,
    with_effects,
)
from tests.service.report.conftest import screening


def list_of(screenings, **how):
    """The work list of these valves, with a history."""
    return work_list_of(screenings, context(screenings), BACKGROUND, **how)


@pytest.fixture(scope="module")
def whole():
    """The work list of the mixed plant."""
    return list_of(mixed())


def pages(pdf: bytes) -> int:
    """How many pages a PDF has."""
    return len(re.findall(rb"/Type /Page\b(?!s)", pdf))


def test_valves_with_work_have_a_page_in_the_order_of_priority(whole):
    """The others have a line, and none is lost."""
    work = [sheet.screening.valve for sheet in whole.sheets]
    assert {"FV-100", "FV-109", "PIC-7", "FIC-9", HOSTILE} == set(work)
    codes = [
        (sheet.priority.code, not sheet.finding.decision.needs_work, -sheet.priority.score)
        for sheet in whole.sheets
    ]
    assert codes == sorted(codes)
    assert len(work) + len(whole.others) == len(mixed())
    assert whole.counts == (
        "4 of 15 valves need work; 1 to watch, 2 cannot be judged (1 with a work order to find out "
        "why), 8 without work."
    )


def test_with_all_every_valve_has_a_page_and_only_those_with_work_an_order():
    """Healthy ones come last and say that there is nothing to do."""
    every = list_of(mixed(), everything=True)
    assert len(every.sheets) == len(mixed())
    assert len(order_rows(every)) == 5
    assert not every.sheets[-1].has_order
    assert every.sheets[-1].title == "nothing to do" or "verdict" in every.sheets[-1].title


def test_the_pdf_has_a_page_for_each_valve_after_the_list(whole):
    """And its outline leads to them."""
    pdf = work_list_pdf(whole, compress=False)
    assert pages(pdf) == 1 + len(whole.sheets)
    text = text_of_pdf(pdf)
    for part in ("FV-100", "Check in this order".upper(), "packing set", "2.8 mm", "Priority"):
        assert part in text
    assert pdf.count(b"/Title") >= len(whole.sheets)


def test_the_pdf_is_the_same_for_the_same_work_list(whole):
    """Two reports of one run can be compared byte for byte."""
    assert work_list_pdf(whole) == work_list_pdf(whole)


def test_long_texts_flow_over_several_pages_and_nothing_is_cut():
    """Every kind of finding with every text far too long: nothing runs into the lines to sign, and
    the last word of each text is there."""
    screenings, created, background = longest()
    result = work_list_of(screenings, created, background)
    assert all(
        height_of(_sheet(TypeSize(SIZES[-1]), sheet, created)) > ROOM for sheet in result.sheets
    )
    pdf = work_list_pdf(result, compress=False)
    text = text_of_pdf(pdf)
    assert text.count("Done, parts used") == 2 * len(screenings)
    assert pages(pdf) > 2 * len(screenings)
    assert len(re.findall(r"long\s+reason", text)) == 150 * len(screenings)


def test_a_page_is_set_in_the_largest_type_that_fits(whole):
    """A usual finding fills one page in type that can be read at the valve."""
    for sheet in whole.sheets:
        story = _fitting(sheet, whole.context)
        assert height_of(story) <= ROOM
        assert height_of(story) == height_of(_sheet(TypeSize(SIZES[0]), sheet, whole.context))


@pytest.mark.long
def test_hundreds_of_valves_flow_over_several_pages_of_the_list():
    """No row is lost at a page's end."""
    several = [frozen(f"PIC-{k}") for k in range(90)]
    several += [screening(f"H-{k}", Verdict.HEALTHY, S=0.2, J=0.1, samples=60) for k in range(90)]
    result = list_of(several)
    pdf = work_list_pdf(result, compress=False)
    lists = pages(pdf) - 90
    assert lists >= 4
    for item in several:
        assert f"({item.valve})".encode() in pdf


def test_an_empty_run_is_a_report_that_says_so(tmp_path):
    """No valve, no page, no order, four files."""
    files = write_maintenance([], context([]), tmp_path / "new")
    assert files.work_list.counts == "No valve was screened."
    assert pages(files.pdf.read_bytes()) == 1
    assert "No valve was screened" in files.html.read_text("utf-8")
    assert list(openpyxl.load_workbook(files.xlsx)["Work orders"].values)[1:] == []
    assert len(files.csv.read_text("utf-8-sig").splitlines()) == 1


def test_one_file_that_cannot_be_written_does_not_cost_the_others(tmp_path):
    """A PDF locked by another program is named, and the other files are written."""
    (tmp_path / "maintenance.pdf").mkdir()
    with pytest.raises(ReportNotWritten, match=r"maintenance\.pdf"):
        write_maintenance(mixed(), context(mixed()), tmp_path)
    assert (tmp_path / "work-orders.csv").stat().st_size > 1000


def test_the_page_runs_nothing_and_loads_nothing(whole):
    """A hostile tag is shown as text; the page has no script and no address."""
    html = work_list_html(whole).decode()
    assert "<script" not in html
    assert "&lt;script&gt;alert" in html
    assert "default-src 'none'" in html
    assert not re.search(r'(src|href)="(?!#)', html)
    assert "\x00" not in html


def test_the_page_says_what_a_planner_asks(whole):
    """Finding, travel, since when, work, priority with its reason, and the warning."""
    html = work_list_html(whole).decode()
    for part in (
        "7.00 %",
        "2.8 mm",
        "Seen since 2026-02-16 07:00 (run 39), in 3 screenings in a row",
        "packing renewed",
        "Severity 84 of 100, criticality 3 of 3",
        "not a work permit",
        "Published false alarms",
        "position frozen or stuck",
    ):
        assert part in html, part


def test_travel_needs_a_stroke():
    """Without one the page says so rather than guess."""
    matching = [screening("FV-1")]
    report_context = context(matching)
    facts = {"FV-1": replace(report_context.facts("FV-1"), stroke="")}
    html = work_list_html(work_list_of(matching, replace(report_context, valves=facts))).decode()
    assert "The plant file gives no stroke" in html
    assert " mm<" not in html


def test_work_orders_have_the_fields_of_a_notification(whole):
    """The same rows in CSV and XLSX, with texts that fit."""
    result = order_rows(whole)
    assert [row["functional_location"] for row in result][-1]
    for row in result:
        assert 0 < len(row["short_text"]) <= SHORT_TEXT
        assert len(row["long_text"]) <= LONG_TEXT
        assert row["priority"] in "1234"
        assert datetime.fromisoformat(row["required_end"]) > datetime(2026, 3, 2)
        assert row["work_centre"] == ""
        assert row["reported_by"].startswith("stemwatch ")
        assert datetime.fromisoformat(row["reported_at"]).tzinfo is not None
    sticky = next(row for row in result if row["functional_location"] == "FV-100")
    assert sticky["damage_code"] == "FTR"
    assert sticky["cause_code"] == "1.6"
    assert sticky["object_part"] == "packing"
    assert sticky["short_text"] == "stem sticks and jumps, S 4.0 %"
    assert sticky["S_travel"] == "1.6 mm"
    sheet = openpyxl.load_workbook(io.BytesIO(orders_xlsx(whole)))["Work orders"]
    header, *values = sheet.values
    assert list(header) == [field.name for field in FIELDS]
    assert len(values) == len(result)
    answer = [dict(zip(header, value, strict=True))["short_text"] for value in values]
    assert answer == [row["short_text"] for row in result]


def test_no_cell_is_a_formula(whole):
    """A tag that begins with = stays a text in both."""
    tag = next(row for row in order_rows(whole) if "script" in row["functional_location"])
    assert tag["functional_location"].startswith("'=1+1")
    sheet = openpyxl.load_workbook(io.BytesIO(orders_xlsx(whole)))["Work orders"]
    assert {cell.data_type for row in sheet.iter_rows() for cell in row} <= {"s", "n", "d"}


def test_a_reference_stays_while_the_finding_goes_on():
    """The next run gives the same one; a new beginning, another valve or kind gives another."""
    result = screening("FV-1", samples=60)
    first = order_rows(list_of([result]))[0]["reference"]
    later = replace(
        result, recording=replace(result.recording, start=datetime(2026, 3, 9, tzinfo=UTC))
    )
    assert order_rows(list_of([later]))[0]["reference"] == first
    others = [replace(result, valve="FV-2"), with_effects("FV-1")]
    assert first not in {order_rows(list_of([other]))[0]["reference"] for other in others}
    new = work_list_of([result], context([result]), replace(BACKGROUND, earlier=lambda _: []))
    assert order_rows(new)[0]["reference"] != first


def test_the_documentation_names_every_column():
    """A plant maps them once."""
    from pathlib import Path

    page = (Path(__file__).parents[3] / "docs" / "maintenance-report.md").read_text("utf-8")
    for field in FIELDS:
        stem = field.name.replace("S_low", "_low").replace("S_high", "_high")
        stem = stem.replace("J_low", "_low").replace("J_high", "_high")
        assert f"`{stem}`" in page, field.name


def test_letters_that_no_font_has_become_a_box():
    """Han and Hangul are drawn by the reader's fonts; marks without width are left out."""
    assert is_whole("ÄÖŁЖΩ 弁 밸브 ≥ ■▲✓")
    assert not is_whole("🙂")
    fonts = [font for font, _ in runs("A弁밸\u202eB")]
    assert len(fonts) == 4
    assert runs("🙂")[0][1] == BOX


@pytest.mark.parametrize(
    "text", ["a " * 400, "x" * 9000, "wide WWWW " * 600, "弁" * 3000, "", " ", "<b>&</para>"]
)
def test_any_text_is_laid_out(text):
    """A tag, a service and a finding of any length and spelling cost no other page."""
    changed = replace(screening(text or "FV-1", S=7.0), reason=text)
    blind = replace(frozen(f"{text} 2"), reason=f"Cannot tell: {text}")
    report_context = context([changed, blind])
    facts = {
        valve: replace(item, description=text) for valve, item in report_context.valves.items()
    }
    list_of = work_list_of([changed, blind], replace(report_context, valves=facts), BACKGROUND)
    assert pages(work_list_pdf(list_of, compress=False)) >= 2


def test_the_line_under_a_valve_begins_with_what_is_known_of_it():
    """A plant file as ``inspect`` proposes it describes no valve."""
    valves = [screening("FV-1", S=5.0)]
    plain = context(valves)
    facts = {valve: replace(item, description="") for valve, item in plain.valves.items()}
    html = work_list_html(work_list_of(valves, replace(plain, valves=facts))).decode()
    (line,) = re.findall(r'<p class="quiet clamp c2">(.*?)</p>', html)
    assert re.sub("<[^>]+>", "", line) == "Area 100 · criticality 3 · stroke 40 mm"
