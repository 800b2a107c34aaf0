"""One valve's page of the PDF: the largest type in which everything has room, then the drawing."""

from __future__ import annotations

from datetime import datetime
from typing import Any

from stemwatch.models.verdict import Verdict
from stemwatch.service.maintenance.pdf_fonts import is_whole
from stemwatch.service.maintenance.pdf_text import Writer
from stemwatch.service.maintenance.work_sheet import WorkSheet
from stemwatch.service.presenter.advice import HINT, LEVEL_NAME
from stemwatch.service.presenter.wording import NOTHING, VERDICT_SYMBOL, span_percent, window
from stemwatch.service.report.report_context import ReportContext

PAGE = (595.28, 841.89)  # A4 in points
LEFT, TOP, FOOT = 40.0, 30.0, 34.0
WIDTH = PAGE[0] - 2 * LEFT
GAP, INDENT = 16.0, 12.0
SIZES = (8.6, 8.2, 7.8, 7.4, 7.0, 6.6)
SIGN_HEIGHT = 34.0
FRAME = {1: (3.0, ()), 2: (1.8, ()), 3: (0.8, ()), 4: (0.8, (3.0, 2.0))}
BOX_WIDTH, BOX_HEIGHT = 92.0, 54.0
SHORT = {Verdict.UNDETERMINED: "no verdict"}
SEE_HTML = "Shortened to fit the page: maintenance.html has all of it."
SEE_LETTERS = "□ stands for a letter that this PDF's font lacks: maintenance.html shows it."


def draw_sheet(canvas: Any, sheet: WorkSheet, context: ReportContext) -> None:
    """Draw ``sheet`` onto the present page of ``canvas``."""
    room = PAGE[1] - FOOT - SIGN_HEIGHT
    size = next(
        (size for size in SIZES if _page(Writer(None, PAGE[1], size), sheet, context) <= room),
        SIZES[-1],
    )
    writer = Writer(canvas, PAGE[1], size)
    _page(writer, sheet, context)
    _sign(writer)
    notes = [SEE_HTML] if writer.lost else []
    if not is_whole(sheet.screening.valve + sheet.valve.facts.description):
        notes.append(SEE_LETTERS)
    writer.line(" ".join(notes), LEFT, PAGE[1] - 18.0, 6.5)


def _page(w: Writer, sheet: WorkSheet, context: ReportContext) -> float:
    """Everything but the lines to sign on; returns where it ends."""
    y = _head(w, sheet, context)
    y = w.heading("What was found", LEFT, y, WIDTH)
    y = w.text(sheet.said.in_full, LEFT, y, WIDTH, most=6)
    seen = f"Window: {window(*sheet.screening.window, context.tz, context.zone)}"
    seen += f" · run {sheet.run}" if sheet.run is not None else ""
    y = w.text(seen, LEFT, y, WIDTH, most=1, size=0.86)
    if sheet.picture is not None:
        y = w.picture(sheet.picture, LEFT, y + 3.0, WIDTH)
    note = sheet.picture_note + (" OP dashed, MV solid." if sheet.picture is not None else "")
    y = w.text(note, LEFT, y, WIDTH, most=1, size=0.86)
    half, right = (WIDTH - GAP) / 2, LEFT + (WIDTH + GAP) / 2
    y = max(_sizes(w, sheet, y, half), _since(w, sheet, context, right, y, half))
    y = _steps(w, sheet, y)
    y = max(_hand(w, sheet, y, half), _doubt(w, sheet, right, y, half))
    return _isolation(w, sheet, y)


def _head(w: Writer, sheet: WorkSheet, context: ReportContext) -> float:
    facts, screening = sheet.valve.facts, sheet.screening
    width = WIDTH - BOX_WIDTH - 10.0
    y = w.text(screening.valve, LEFT, TOP, width, most=2, size=1.75, bold=True)
    said = [facts.description, facts.area]
    said += [f"criticality {facts.criticality}"] if facts.criticality else []
    said += [f"stroke {facts.stroke}"] if facts.stroke else []
    y = w.text(" · ".join(one for one in said if one), LEFT, y, width, most=2, size=0.92)
    title = f"{VERDICT_SYMBOL[screening.verdict]} {sheet.title} ({screening.verdict.value})"
    y = w.text(title, LEFT, y + 1.0, width, most=1, size=1.25, bold=True)
    _priority(w, sheet, context)
    y = max(y, TOP + BOX_HEIGHT) + 3.0
    w.rule(LEFT, y, WIDTH, 1.0)
    return y


def _priority(w: Writer, sheet: WorkSheet, context: ReportContext) -> None:
    priority, left = sheet.priority, LEFT + WIDTH - BOX_WIDTH
    weight, dash = FRAME[priority.code] if sheet.has_order else FRAME[4]
    w.box(left, TOP, BOX_WIDTH, BOX_HEIGHT, weight, dash)
    middle = left + BOX_WIDTH / 2
    if not sheet.has_order:
        w.line("no order", middle, TOP + 31.0, 9.0, anchor="middle")
        return
    w.line("Priority", middle, TOP + 12.0, 7.5, anchor="middle")
    w.line(str(priority.code), middle, TOP + 31.0, 18.0, bold=True, anchor="middle")
    w.line(priority.words, middle, TOP + 40.5, 7.5, anchor="middle")
    due = f"by {priority.due(context.started, context.tz)}"
    w.line(due, middle, TOP + 49.5, 7.5, anchor="middle")


def _sizes(w: Writer, sheet: WorkSheet, y: float, width: float) -> float:
    y = w.heading("Size", LEFT, y, width)
    columns = (0.0, 0.09, 0.32, 0.66)
    rows = [("", "of OP span", "95 %", "travel")]
    rows += [
        (size.name, size.percent, size.interval or NOTHING, size.travel or NOTHING)
        for size in sheet.sizes
    ]
    for at, row in enumerate(rows):
        end = y
        for share, cell in zip(columns, row, strict=True):
            bold = at == 0 or share == 0.0
            room = 0.32 * width
            end = max(end, w.text(cell, LEFT + share * width, y, room, most=1, bold=bold))
        y = end
    meaning = " ".join(f"{size.name}: {size.meaning}." for size in sheet.sizes)
    return w.text(f"{meaning} {sheet.stroke_note}", LEFT, y + 1.0, width, most=5, size=0.86)


def _since(
    w: Writer, sheet: WorkSheet, context: ReportContext, x: float, y: float, width: float
) -> float:
    y = w.heading("Since when", x, y, width)
    y = w.text(" ".join(sheet.since_said), x, y, width, most=4)
    if not sheet.past:
        return y
    names = ("Before", "", "S, %")
    rows: list[list[str]] = [[], [], []]
    for past in sheet.past:
        rows[0].append(_day(past.at, context))
        rows[1].append(f"{VERDICT_SYMBOL[past.verdict]} {SHORT.get(past.verdict, past.verdict)}")
        rows[2].append(span_percent(past.S))
    step = (width - 26.0) / max(len(sheet.past), 4)
    for name, row in zip(names, rows, strict=True):
        y = max(y, w.text(name, x, y, 26.0, most=1, size=0.8, bold=True) if name else y)
        base = y if not name else y - 0.8 * w.size * 1.24
        for at, cell in enumerate(row):
            y = max(y, w.text(cell, x + 26.0 + at * step, base, step + 4.0, most=1, size=0.72))
    return y


def _day(when: datetime, context: ReportContext) -> str:
    return f"{when.astimezone(context.tz):%Y-%m-%d}"


def _steps(w: Writer, sheet: WorkSheet, y: float) -> float:
    y = w.heading("Check in this order", LEFT, y, WIDTH)
    for number, step in enumerate(sheet.steps, start=1):
        w.text(f"{number}.", LEFT, y, INDENT, most=1, bold=True)
        text = f"[{LEVEL_NAME[step.level]}] {step.text}"
        y = w.text(text, LEFT + INDENT, y, WIDTH - INDENT, most=3)
    return y


def _hand(w: Writer, sheet: WorkSheet, y: float, width: float) -> float:
    y = w.heading("Have at hand", LEFT, y, width)
    y = w.text(f"{'; '.join(sheet.parts)}.", LEFT, y, width, most=4)
    y = w.heading("How sure", LEFT, y, width)
    return w.text(" ".join(sheet.sure), LEFT, y, width, most=7)


def _doubt(w: Writer, sheet: WorkSheet, x: float, y: float, width: float) -> float:
    y = w.heading("What else it could be", x, y, width)
    said = " ".join(sheet.said.otherwise) or "Nothing that this recording would show."
    y = w.text(said, x, y, width, most=7)
    y = w.heading("Why this priority", x, y, width)
    return w.text(f"{sheet.priority.reason}.", x, y, width, most=3)


def _isolation(w: Writer, sheet: WorkSheet, y: float) -> float:
    y = w.heading("Isolation", LEFT, y, WIDTH)
    for level, text in sheet.isolation:
        y = w.text(f"[{LEVEL_NAME[level]}] {text}", LEFT, y, WIDTH, most=5)
    return w.text(HINT, LEFT, y, WIDTH, most=2, size=0.86)


def _sign(w: Writer) -> None:
    """Lines for the hand: a page that comes back from the valve is worth two that went."""
    y = PAGE[1] - FOOT
    shares = (0.0, 0.34, 0.68, 0.85)
    ends = (*shares[1:], 1.0)
    for title, begin, end in zip(
        ("Found", "Done, parts used", "Name", "Date"), shares, ends, strict=True
    ):
        w.rule(LEFT + begin * WIDTH, y, (end - begin) * WIDTH - 8.0, 0.6)
        w.line(title, LEFT + begin * WIDTH, y + 8.0, 7.0)
