"""Work orders as CSV and XLSX: the fields that a maintenance system asks for, a row for each valve.

Names and codes are neutral; docs/maintenance-report.md maps them to SAP PM and to Maximo. No cell
is ever taken for a formula.
"""

from __future__ import annotations

import csv
import hashlib
import io
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from xlsxwriter import Workbook

from stemwatch.service.maintenance.work_list import WorkList
from stemwatch.service.maintenance.work_sheet import WorkSheet
from stemwatch.service.presenter.advice import HINT, LEVEL_NAME
from stemwatch.service.presenter.finding import MOST_STILL_SEEN
from stemwatch.service.presenter.wording import finite, printable
from stemwatch.service.report.csv_file import harmless
from stemwatch.service.report.report_context import ReportContext
from stemwatch.service.report.spreadsheet_columns import Cell, clean_cell
from stemwatch.service.report.xlsx_file import write_cell

SHORT_TEXT = 40  # letters of the short text of an SAP PM notification
# Long enough for every page, short enough for one cell of a spreadsheet (32,767).
LONG_TEXT = 8000


@dataclass(frozen=True)
class OrderField:
    """One column: its heading, what it means, how it is read, and how wide a sheet shows it."""

    name: str
    meaning: str
    read: Callable[[WorkSheet, ReportContext], Cell]
    width: int = 14


def rows_of(work_list: WorkList) -> list[list[Cell]]:
    """One row for each valve with work, in the order of the report, every text printable."""
    return [
        [clean_cell(field.read(sheet, work_list.context)) for field in FIELDS]
        for sheet in work_list.to_work_on
    ]


def short_text(sheet: WorkSheet) -> str:
    """The finding and, where it is stiction, S; at most 40 letters and without the tag, which
    has a field of its own."""
    S = finite(sheet.screening.S.value)
    text = sheet.title
    if sheet.kinds[0].startswith("stiction") and S is not None:
        text = f"{text}, S {S:.1f} %"
    return text[:SHORT_TEXT]


def long_text(sheet: WorkSheet) -> str:
    """The page in plain lines."""
    lines = [
        *sheet.finding.found,
        *sheet.finding.still_seen[:MOST_STILL_SEEN],
        *(_measured(sheet)),
        *sheet.since_said,
        f"Priority {sheet.priority.code} ({sheet.priority.words}): {sheet.priority.reason}.",
        "What to check, in this order:",
        *[
            f"{number}. [{LEVEL_NAME[step.level]}] {step.text}"
            for number, step in enumerate(sheet.steps, start=1)
        ],
        f"Have at hand: {'; '.join(sheet.parts)}.",
        "Isolation:",
        *[f"- {LEVEL_NAME[level]}: {text}" for level, text in sheet.isolation],
        HINT,
        *[f"What else it could be: {text}" for text in sheet.finding.otherwise],
        *sheet.sure,
    ]
    text = "\n".join(lines)
    return text if len(text) <= LONG_TEXT else text[: LONG_TEXT - 1] + "…"


def reference(sheet: WorkSheet) -> str:
    """An identifier that stays the same while the same finding continues, so that an import system
    can recognise a repeated order: valve, kind, and since when."""
    first = sheet.since.first
    begin = first.at if first is not None else sheet.screening.window[1]
    # Without this, a finding older than the records read would get a new identifier with each run.
    begin_text = "" if begin is None or sheet.since.at_least else f"{begin:%Y-%m-%dT%H:%M}"
    text = f"{sheet.screening.valve}|{sheet.kinds[0]}|{begin_text}"
    digest = hashlib.sha256(text.encode("utf-8", errors="replace")).hexdigest()
    return f"SW-{digest[:10].upper()}"


def _measured(sheet: WorkSheet) -> list[str]:
    clauses = []
    for size in sheet.sizes:
        size_clauses = [
            size.interval and f"95 %: {size.interval}",
            size.travel and f"{size.travel} travel",
        ]
        tail = "; ".join(text for text in size_clauses if text)
        clauses.append(f"{size.name}: {size.percent}{f' ({tail})' if tail else ''}")
    return clauses


def _seen_from(sheet: WorkSheet, context: ReportContext) -> datetime | None:
    first = sheet.since.first
    begin = first.at if first is not None else sheet.screening.window[1]
    return None if begin is None else begin.astimezone(context.tz)


def _number(name: str, part: str) -> Callable[[WorkSheet, ReportContext], Cell]:
    def read(sheet: WorkSheet, context: ReportContext) -> Cell:
        cell: Cell = getattr(getattr(sheet.screening, name), part)
        return cell

    return read


def _travel(index: int) -> Callable[[WorkSheet, ReportContext], Cell]:
    return lambda sheet, _: sheet.sizes[index].travel


FIELDS = (
    OrderField(
        "reference", "the same as long as the finding goes on", lambda s, _: reference(s), 16
    ),
    OrderField("functional_location", "the valve's tag", lambda s, _: s.screening.valve, 20),
    OrderField("short_text", "at most 40 letters", lambda s, _: short_text(s), 40),
    OrderField("priority", "1 most urgent to 4", lambda s, _: s.priority.code, 8),
    OrderField("priority_text", "what the code stands for", lambda s, _: s.priority.words, 18),
    OrderField(
        "required_end",
        "a proposal, from the priority",
        lambda s, c: s.priority.due(c.started, c.tz).isoformat(),
        12,
    ),
    OrderField("work_centre", "empty: the plant's own", lambda *_: "", 12),
    OrderField("object_part", "suspected first", lambda s, _: s.advice.part, 18),
    OrderField("damage_code", "failure mode, ISO 14224", lambda s, _: s.advice.damage, 12),
    OrderField("cause_code", "failure mechanism, ISO 14224", lambda s, _: s.advice.cause, 11),
    OrderField("finding", "kind, a stable word", lambda s, _: s.kinds[0], 22),
    OrderField("more_findings", "further kinds", lambda s, _: ", ".join(s.kinds[1:]), 22),
    OrderField("long_text", "the page in plain lines", lambda s, _: long_text(s), 80),
    OrderField("description", "what the valve does", lambda s, _: s.valve.facts.description, 28),
    OrderField("area", "plant area", lambda s, _: s.valve.facts.area, 14),
    OrderField("unit", "ISA-95 unit", lambda s, _: s.valve.facts.unit, 12),
    OrderField("path", "site/area/unit/loop, ISA-95", lambda s, _: s.valve.facts.path, 28),
    OrderField("criticality", "as the plant states it", lambda s, _: s.valve.facts.criticality, 10),
    OrderField("stroke", "full travel", lambda s, _: s.valve.facts.stroke, 10),
    OrderField("S_percent", "of OP span", _number("S", "value"), 10),
    OrderField("S_low_percent", "95 % interval", _number("S", "low"), 10),
    OrderField("S_high_percent", "95 % interval", _number("S", "high"), 10),
    OrderField("S_travel", "in the stroke's unit", _travel(0), 10),
    OrderField("J_percent", "of OP span", _number("J", "value"), 10),
    OrderField("J_low_percent", "95 % interval", _number("J", "low"), 10),
    OrderField("J_high_percent", "95 % interval", _number("J", "high"), 10),
    OrderField("J_travel", "in the stroke's unit", _travel(1), 10),
    OrderField("verdict", "of the screening", lambda s, _: s.valve.verdict.value, 13),
    OrderField("ne107", "state by NAMUR NE 107", lambda s, _: s.finding.decision.ne107 or "", 20),
    OrderField("confidence", "0 to 1", lambda s, _: s.finding.decision.confidence, 10),
    OrderField("seen_since", "first screening in a row that shows it", _seen_from, 20),
    OrderField("screenings_in_a_row", "that show it", lambda s, _: s.since.count, 10),
    OrderField("isolation", "furthest level of the steps", lambda s, _: _level(s), 22),
    OrderField("parts", "to have at hand", lambda s, _: "; ".join(s.parts), 50),
    OrderField("reported_by", "who says so", lambda _, c: c.software, 18),
    OrderField("reported_at", "when", lambda _, c: c.started.astimezone(c.tz), 20),
    OrderField("run", "number of the run", lambda s, _: s.run, 8),
)


def _level(sheet: WorkSheet) -> str:
    return LEVEL_NAME[sheet.isolation[-1][0]]


def orders_csv(work_list: WorkList) -> bytes:
    """UTF-8 with a byte order mark, commas; one header row, one row per work order, numbers
    unrounded, times ISO 8601 with their offset."""
    sheet = io.StringIO(newline="")
    writer = csv.writer(sheet)
    writer.writerow([field.name for field in FIELDS])
    writer.writerows([[harmless(cell) for cell in row] for row in rows_of(work_list)])
    return sheet.getvalue().encode("utf-8-sig")


def orders_xlsx(work_list: WorkList) -> bytes:
    """The same in a workbook, with a second sheet that says what each column means."""
    memory = io.BytesIO()
    with Workbook(memory, {"in_memory": True, "remove_timezone": True}) as workbook:
        started = work_list.context.started.astimezone(UTC).replace(tzinfo=None)
        title = printable(f"Work orders {work_list.context.plant}".strip())
        workbook.set_properties({"title": title, "created": started})
        _orders(workbook, work_list)
        _meanings(workbook, work_list)
    return memory.getvalue()


def _orders(workbook: Any, work_list: WorkList) -> None:
    sheet = workbook.add_worksheet("Work orders")
    bold = workbook.add_format({"bold": True, "bottom": 1, "text_wrap": True, "valign": "top"})
    styles = {
        str: workbook.add_format({"valign": "top", "text_wrap": True}),
        int: workbook.add_format({"valign": "top", "num_format": "0"}),
        float: workbook.add_format({"valign": "top", "num_format": "0.00"}),
        datetime: workbook.add_format({"valign": "top", "num_format": "yyyy-mm-dd hh:mm"}),
    }
    rows = rows_of(work_list)
    for index, field in enumerate(FIELDS):
        sheet.set_column(index, index, field.width)
        sheet.write_string(0, index, field.name, bold)
    for line, row in enumerate(rows, start=1):
        sheet.set_row(line, 60)
        for index, cell in enumerate(row):
            write_cell(sheet, line, index, cell, styles)
    sheet.freeze_panes(1, 2)
    sheet.autofilter(0, 0, len(rows), len(FIELDS) - 1)
    sheet.set_landscape()
    sheet.set_paper(9)  # A4
    sheet.repeat_rows(0)


def _meanings(workbook: Any, work_list: WorkList) -> None:
    sheet = workbook.add_worksheet("Columns")
    sheet.set_column(0, 0, 24)
    sheet.set_column(1, 1, 90)
    wrap = workbook.add_format({"text_wrap": True, "valign": "top"})
    meanings = [(field.name, field.meaning) for field in FIELDS]
    meanings.append(("times", f"in {work_list.context.zone}"))
    for line, (name, meaning) in enumerate([*meanings, ("", HINT), ("", work_list.counts)]):
        sheet.write_string(line, 0, name, wrap)
        sheet.write_string(line, 1, meaning, wrap)
