"""Work orders: the fields that a maintenance system asks for, one row for each valve with work.

Names and codes are neutral; docs/maintenance-report.md maps them to SAP PM and to Maximo.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime

from stemwatch.service.maintenance.advice import HINT, LEVEL_NAME
from stemwatch.service.maintenance.book import Book
from stemwatch.service.maintenance.sheet import Sheet
from stemwatch.service.report.columns import Cell
from stemwatch.service.report.context import ReportContext
from stemwatch.service.report.words import finite, printable

SHORT_TEXT = 40  # letters of the short text of a notification in SAP PM
# Long enough for every page, short enough for one cell of a spreadsheet (32,767).
LONG_TEXT = 8000


@dataclass(frozen=True)
class Field:
    """One column: its heading, what it means, how it is read, and how wide a sheet shows it."""

    name: str
    meaning: str
    read: Callable[[Sheet, ReportContext], Cell]
    width: int = 14


def rows_of(book: Book) -> list[list[Cell]]:
    """One row for each valve with work, in the order of the report, every text printable."""
    return [
        [_clean(field.read(sheet, book.context)) for field in FIELDS] for sheet in book.to_work_on
    ]


def short_text(sheet: Sheet) -> str:
    """The finding and, where it is stiction, S; at most 40 letters and without the tag, which
    has a field of its own."""
    S = finite(sheet.screening.S.value)
    text = sheet.title
    if sheet.advice.kind.startswith("stiction") and S is not None:
        text = f"{text}, S {S:.1f} %"
    return text[:SHORT_TEXT]


def long_text(sheet: Sheet) -> str:
    """The page in plain lines."""
    lines = [
        *sheet.finding,
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
        *[f"What else it could be: {text}" for text in sheet.otherwise],
        *sheet.sure,
    ]
    text = "\n".join(lines)
    return text if len(text) <= LONG_TEXT else text[: LONG_TEXT - 1] + "…"


def reference(sheet: Sheet) -> str:
    """A name that stays the same as long as the same finding goes on, so that a second import can
    be told from a new finding: valve, kind, and since when."""
    first = sheet.since.first
    began = first.at if first is not None else sheet.screening.window[1]
    # A finding that goes back beyond what was read would get a new name with each run.
    told = "" if began is None or sheet.since.at_least else f"{began:%Y-%m-%dT%H:%M}"
    text = f"{sheet.screening.valve}|{sheet.kinds[0]}|{told}"
    digest = hashlib.sha256(text.encode("utf-8", errors="replace")).hexdigest()
    return f"SW-{digest[:10].upper()}"


def _measured(sheet: Sheet) -> list[str]:
    said = []
    for size in sheet.sizes:
        more = [size.interval and f"95 %: {size.interval}", size.travel and f"{size.travel} travel"]
        tail = "; ".join(one for one in more if one)
        said.append(f"{size.name}: {size.percent}{f' ({tail})' if tail else ''}")
    return said


def _clean(cell: Cell) -> Cell:
    if isinstance(cell, str):
        return printable(cell)
    return finite(cell) if isinstance(cell, float) else cell


def _seen_from(sheet: Sheet, context: ReportContext) -> datetime | None:
    first = sheet.since.first
    began = first.at if first is not None else sheet.screening.window[1]
    return None if began is None else began.astimezone(context.tz)


def _number(name: str, part: str) -> Callable[[Sheet, ReportContext], Cell]:
    def read(sheet: Sheet, context: ReportContext) -> Cell:
        cell: Cell = getattr(getattr(sheet.screening, name), part)
        return cell

    return read


def _travel(at: int) -> Callable[[Sheet, ReportContext], Cell]:
    return lambda sheet, _: sheet.sizes[at].travel


FIELDS = (
    Field("reference", "the same as long as the finding goes on", lambda s, _: reference(s), 16),
    Field("functional_location", "the valve's tag", lambda s, _: s.screening.valve, 20),
    Field("short_text", "at most 40 letters", lambda s, _: short_text(s), 40),
    Field("priority", "1 most urgent to 4", lambda s, _: s.priority.code, 8),
    Field("priority_text", "what the code stands for", lambda s, _: s.priority.words, 18),
    Field(
        "required_end",
        "a proposal, from the priority",
        lambda s, c: s.priority.due(c.started, c.tz).isoformat(),
        12,
    ),
    Field("work_centre", "empty: the plant's own", lambda *_: "", 12),
    Field("object_part", "suspected first", lambda s, _: s.advice.part, 18),
    Field("damage_code", "failure mode, ISO 14224", lambda s, _: s.advice.damage, 12),
    Field("cause_code", "failure mechanism, ISO 14224", lambda s, _: s.advice.cause, 11),
    Field("finding", "kind, a stable word", lambda s, _: s.kinds[0], 22),
    Field("more_findings", "further kinds", lambda s, _: ", ".join(s.kinds[1:]), 22),
    Field("long_text", "the page in plain lines", lambda s, _: long_text(s), 80),
    Field("description", "what the valve does", lambda s, _: s.valve.facts.description, 28),
    Field("area", "plant area", lambda s, _: s.valve.facts.area, 14),
    Field("criticality", "as the plant states it", lambda s, _: s.valve.facts.criticality, 10),
    Field("stroke", "full travel", lambda s, _: s.valve.facts.stroke, 10),
    Field("S_percent", "of OP span", _number("S", "value"), 10),
    Field("S_low_percent", "95 % interval", _number("S", "low"), 10),
    Field("S_high_percent", "95 % interval", _number("S", "high"), 10),
    Field("S_travel", "in the stroke's unit", _travel(0), 10),
    Field("J_percent", "of OP span", _number("J", "value"), 10),
    Field("J_low_percent", "95 % interval", _number("J", "low"), 10),
    Field("J_high_percent", "95 % interval", _number("J", "high"), 10),
    Field("J_travel", "in the stroke's unit", _travel(1), 10),
    Field("verdict", "of the screening", lambda s, _: s.screening.verdict.value, 13),
    Field("confidence", "0 to 1", lambda s, _: s.screening.confidence, 10),
    Field("seen_since", "first screening in a row that shows it", _seen_from, 20),
    Field("screenings_in_a_row", "that show it", lambda s, _: s.since.count, 10),
    Field("isolation", "furthest level of the steps", lambda s, _: _level(s), 22),
    Field("parts", "to have at hand", lambda s, _: "; ".join(s.parts), 50),
    Field("reported_by", "who says so", lambda _, c: c.software, 18),
    Field("reported_at", "when", lambda _, c: c.started.astimezone(c.tz), 20),
    Field("run", "number of the run", lambda s, _: s.run, 8),
)


def _level(sheet: Sheet) -> str:
    return LEVEL_NAME[sheet.isolation[-1][0]]
