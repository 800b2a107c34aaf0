"""The maintenance report as PDF: a list of the valves, then a page for each, laid out by reportlab.

A valve's page is set in the largest type in which it fits one page. What does not fit even in the
smallest flows onto a second one: nothing is cut.
"""

from __future__ import annotations

import io
from datetime import datetime
from typing import Any

from reportlab.lib.pagesizes import A4
from reportlab.lib.styles import ParagraphStyle
from reportlab.platypus import (
    BaseDocTemplate,
    Flowable,
    Frame,
    LongTable,
    NextPageTemplate,
    PageBreak,
    PageTemplate,
    Paragraph,
    Spacer,
    Table,
)

from stemwatch.models.verdict import Verdict
from stemwatch.models.words import capitalised
from stemwatch.service.maintenance.paper import (
    BARE,
    FOOT,
    GAP,
    MARGIN,
    PLAIN,
    REGULAR,
    TOP,
    WIDTH,
    PaperPicture,
    TypeSize,
    cut,
    folio,
    fonts,
    height_of,
    is_whole,
    write,
)
from stemwatch.service.maintenance.work_compared import WorkCompared
from stemwatch.service.maintenance.work_list import ValveWithoutPage, WorkList
from stemwatch.service.maintenance.work_sheet import WorkSheet
from stemwatch.service.presenter.advice import HINT, LEVEL_NAME
from stemwatch.service.presenter.urgency import CLASSES_IN_WORDS
from stemwatch.service.presenter.wording import (
    NOTHING,
    VERDICT_SYMBOL,
    instant,
    printable,
    span_percent,
    window,
)
from stemwatch.service.presenter.work_decision import verdict_before
from stemwatch.service.report.report_context import ReportContext

SIGN_HEIGHT = 34.0
ROOM = A4[1] - TOP - FOOT - SIGN_HEIGHT  # of a valve's page, above the lines to sign on
LIST_SIZE = 8.2
SIZES = (8.6, 7.9, 7.2, 6.6)  # points; smaller is not read at a valve
SHORT = {Verdict.UNDETERMINED: "no verdict"}
FRAME = {1: (3.0, None), 2: (1.8, None), 3: (0.8, None), 4: (0.8, (3.0, 2.0))}
SEE_LETTERS = "□ stands for a letter that this PDF's font lacks: maintenance.html shows it."
HEADINGS = ("No.", "Priority", "Valve", "Finding", "S", "Since", "By")
SHARES = (0.055, 0.16, 0.325, 0.195, 0.07, 0.095, 0.1)
LEGEND = (
    f"Priority, from severity and criticality: {CLASSES_IN_WORDS}. Valves stand in the order of "
    "the report. Confirm with a stroke test before a valve is opened."
)
# The most letters of a table cell, which has to fit one page, and of a name.
LONGEST_CELL, LONGEST_NAME = 1200, 200


def work_list_pdf(work_list: WorkList, *, compress: bool = True) -> bytes:
    """The report as PDF, the same for the same work list; uncompressed where a test reads it."""
    fonts()
    memory = io.BytesIO()
    document = _Document(work_list, memory, compress)
    flowables: list[Any] = [*_front(work_list)]
    for number, sheet in enumerate(work_list.sheets, start=1):
        flowables += [NextPageTemplate("sheet"), PageBreak(), _Bookmark(number, sheet)]
        flowables += _fitting(sheet, work_list.context)
    document.build(flowables)
    return memory.getvalue()


class _Document(BaseDocTemplate):  # type: ignore[misc]  # reportlab has no types
    """A4 with a folio on every page, and lines to sign on below a valve's page."""

    def __init__(self, work_list: WorkList, file: io.BytesIO, compress: bool) -> None:
        super().__init__(
            file,
            pagesize=A4,
            title=printable(f"Maintenance report {work_list.context.plant}".strip()),
            author=work_list.context.software,
            pageCompression=int(compress),
            invariant=1,
            initialFontName=REGULAR,
        )
        self._context = work_list.context
        page_frame = Frame(MARGIN, FOOT, WIDTH, A4[1] - TOP - FOOT, **PLAIN)
        sheet_frame = Frame(MARGIN, FOOT + SIGN_HEIGHT, WIDTH, ROOM, **PLAIN)
        self.addPageTemplates(
            [
                PageTemplate("list", [page_frame], onPage=self._folio),
                PageTemplate("sheet", [sheet_frame], onPage=self._signed),
            ]
        )

    def _folio(self, canvas: Any, _: Any) -> None:
        folio(canvas, self._context)

    def _signed(self, canvas: Any, document: Any) -> None:
        """Lines to write on: what the technician notes at the valve comes back with the page."""
        self._folio(canvas, document)
        shares = (0.0, 0.34, 0.68, 0.85, 1.0)
        titles = ("Found", "Done, parts used", "Name", "Date")
        canvas.setLineWidth(0.6)
        for title, begin, end in zip(titles, shares, shares[1:], strict=False):
            x = MARGIN + begin * WIDTH
            canvas.line(x, FOOT, x + (end - begin) * WIDTH - 8.0, FOOT)
            write(canvas, title, x, FOOT - 8.0)


class _Bookmark(Flowable):  # type: ignore[misc]  # reportlab has no types
    """The target of a row of the list and of the outline."""

    def __init__(self, number: int, sheet: WorkSheet) -> None:
        super().__init__()
        self._key, self._title = f"m{number}", printable(sheet.screening.valve)[:80]

    def wrap(self, *_: float) -> tuple[float, float]:
        return 0.0, 0.0

    def draw(self) -> None:
        self.canv.bookmarkPage(self._key)
        self.canv.addOutlineEntry(self._title, self._key)


_LIST = [
    *BARE,
    ("RIGHTPADDING", (0, 0), (-1, -1), 4),
    ("TOPPADDING", (0, 0), (-1, -1), 1.5),
    ("BOTTOMPADDING", (0, 0), (-1, -1), 2.0),
    ("LINEBELOW", (0, 0), (-1, -1), 0.3, "#666666"),
]


def _front(work_list: WorkList) -> list[Any]:
    """What is in the report, the valves in their order, and those without a page."""
    t, context = TypeSize(LIST_SIZE), work_list.context
    date_line = f"{instant(context.started, context.tz)} ({context.zone})"
    date_line += f", run {work_list.run}" if work_list.run is not None else ""
    plant = f"{context.plant}, " if context.plant else ""
    flowables: list[Any] = [
        t.text("Maintenance report", 2.2, bold=True, spaceAfter=4.0),
        t.text(f"{plant}{date_line}. {context.software}."),
        t.text(work_list.counts, bold=True, spaceBefore=2.0),
    ]
    if work_list.discovered:
        flowables.append(t.text(work_list.discovered, spaceBefore=2.0))
    flowables.append(Spacer(1, 6.0))
    if work_list.sheets:
        rows = [[t.text(name, bold=True) for name in HEADINGS]]
        rows += [
            _row(t, number, sheet, context)
            for number, sheet in enumerate(work_list.sheets, start=1)
        ]
        widths = [share * WIDTH for share in SHARES]
        flowables.append(LongTable(rows, colWidths=widths, repeatRows=1, style=_LIST))
    else:
        flowables.append(t.text("There is no page for a valve in this report."))
    if work_list.others:
        noun = "valve" if len(work_list.others) == 1 else "valves"
        flowables.append(t.heading(f"{len(work_list.others)} {noun} without a page"))
        other_lines = [_brief(t, other) for other in work_list.others]
        flowables.append(LongTable(other_lines, colWidths=[78.0, 118.0, WIDTH - 196.0], style=BARE))
    if work_list.done:
        flowables.append(t.heading(work_list.done_title))
        for index, compared in enumerate(work_list.done):
            flowables += _work_done(t, compared, context, explain=index == 0)
    if context.sources_not_read:
        flowables.append(t.heading("Remarks"))
        flowables += [
            t.text(f"{unread.source}: {unread.reason}", 0.9) for unread in context.sources_not_read
        ]
    return [*flowables, t.text(f"{LEGEND} {HINT}", 0.86, spaceBefore=6.0)]


def _row(t: TypeSize, number: int, sheet: WorkSheet, context: ReportContext) -> list[Any]:
    begins = sheet.since.first.at if sheet.since.first else sheet.screening.window[1]
    order, priority = sheet.has_order, sheet.priority
    tag = t.text(cut(sheet.screening.valve, LONGEST_NAME), bold=True)
    service = cut(sheet.valve.facts.description or sheet.valve.recording, LONGEST_NAME)
    link = ParagraphStyle("link", fontName=REGULAR, fontSize=t.size, leading=1.24 * t.size)
    return [
        Paragraph(f'<a href="#m{number}">{number}</a>', link),
        t.text(f"{priority.code} {priority.words}" if order else NOTHING, 0.9),
        [tag, t.text(service, 0.86)] if service else tag,
        t.text(sheet.title),
        t.text(sheet.sizes[0].percent if sheet.sizes[0].interval else NOTHING),
        t.text(NOTHING if begins is None else _day(begins, context), 0.9),
        t.text(str(priority.due(context.started, context.tz)) if order else NOTHING, 0.9),
    ]


def _brief(t: TypeSize, valve: ValveWithoutPage) -> list[Any]:
    verdict = f"{VERDICT_SYMBOL[valve.verdict]} {valve.verdict.value}"
    return [
        t.text(verdict, 0.9),
        t.text(cut(valve.valve, LONGEST_NAME), 0.9, bold=True),
        t.text(cut(valve.line, LONGEST_CELL), 0.9),
    ]


def _work_done(
    t: TypeSize, compared: WorkCompared, context: ReportContext, *, explain: bool
) -> list[Any]:
    """What was done at a valve, S and J before and after it, and both loops on the same axes."""
    work, drawing = compared.around.work, compared.drawing
    ends = [
        instant(recorded.end, context.tz)
        for recorded in (compared.around.before, compared.around.after)
    ]
    windows = f"The window until {ends[0]}, and the latest one, until {ends[1]}."
    sentences = [
        t.text(cut(work.valve, LONGEST_NAME), bold=True, spaceBefore=3.0),
        t.text(f"{instant(work.at, context.tz)}: {cut(work.note, LONGEST_CELL)}"),
        t.text(f"S {compared.sizes[0]}, J {compared.sizes[1]}", bold=True),
        t.text(f"{windows} {compared.caption}" if explain and drawing else windows, 0.86),
    ]
    if drawing is None:
        return sentences
    return [t.columns(sentences, [PaperPicture(drawing, (WIDTH - GAP) / 2)])]


def _fitting(sheet: WorkSheet, context: ReportContext) -> list[Any]:
    """The page of ``sheet`` in the largest type that fits; else in one column over several."""
    for size in SIZES:
        flowables = _sheet(TypeSize(size), sheet, context)
        if height_of(flowables) <= ROOM:
            return flowables
    return _sheet(TypeSize(SIZES[-1]), sheet, context, side_by_side=False)


def _sheet(
    t: TypeSize, sheet: WorkSheet, context: ReportContext, *, side_by_side: bool = True
) -> list[Any]:
    """Everything on the page of one valve."""
    seen = f"Window: {window(*sheet.screening.window, context.tz, context.zone)}"
    seen += f" · run {sheet.run}" if sheet.run is not None else ""
    picture = sheet.picture
    note = sheet.picture_note + (" OP dashed, MV solid." if picture is not None else "")
    flowables = [
        *_head(t, sheet, context),
        t.heading("What was found"),
        t.text(sheet.finding.in_full),
        t.text(seen, 0.86),
        *([] if picture is None else [Spacer(1, 3.0), PaperPicture(picture)]),
        t.text(note, 0.86),
    ]
    width = (WIDTH - GAP) / 2 if side_by_side else WIDTH
    first = _sizes(t, sheet, width), _since(t, sheet, context, width)
    second = _hand(t, sheet), _doubt(t, sheet)
    if side_by_side:
        return [
            *flowables,
            t.columns(*first),
            *_steps(t, sheet),
            t.columns(*second),
            *_isolation(t, sheet),
        ]
    return [
        *[*flowables, *first[0], *first[1], *_steps(t, sheet)],
        *[*second[0], *second[1], *_isolation(t, sheet)],
    ]


def _head(t: TypeSize, sheet: WorkSheet, context: ReportContext) -> list[Any]:
    facts, screening = sheet.valve.facts, sheet.screening
    details = [facts.description, facts.path, sheet.recording]
    details += [f"criticality {facts.criticality}"] if facts.criticality else []
    details += [f"stroke {facts.stroke}"] if facts.stroke else []
    title = f"{VERDICT_SYMBOL[sheet.valve.verdict]} {sheet.title} ({sheet.valve.verdict.value})"
    left_column = [
        t.text(cut(screening.valve, LONGEST_NAME), 1.75, bold=True),
        t.text(cut(" · ".join(text for text in details if text), LONGEST_CELL), 0.92),
        t.text(title, 1.25, bold=True, spaceBefore=1.0),
    ]
    if not is_whole(screening.valve + facts.description):
        left_column.append(t.text(SEE_LETTERS, 0.8))
    middle: dict[str, Any] = {"alignment": 1}
    weight, dash = FRAME[sheet.priority.code if sheet.has_order else 4]
    if sheet.has_order:
        priority = sheet.priority
        due = f"by {priority.due(context.started, context.tz)}"
        box = [
            t.text("Priority", 0.9, **middle),
            t.text(str(priority.code), 2.1, bold=True, **middle),
            *[t.text(text, 0.9, **middle) for text in (priority.words, due)],
        ]
    else:
        box = [t.text("no order", **middle)]
    inner = Table(
        [[box]], colWidths=[92.0], style=[("BOX", (0, 0), (-1, -1), weight, "black", 0, dash)]
    )
    style = [
        *BARE,
        ("LINEBELOW", (0, 0), (-1, -1), 1.0, "black"),
        ("BOTTOMPADDING", (0, 0), (-1, -1), 3),
    ]
    return [Table([[left_column, inner]], colWidths=[WIDTH - 102.0, 102.0], style=style)]


def _sizes(t: TypeSize, sheet: WorkSheet, width: float) -> list[Any]:
    rows = [("", "of OP span", "95 %", "travel")]
    rows += [
        (size.name, size.percent, size.interval or NOTHING, size.travel or NOTHING)
        for size in sheet.sizes
    ]
    meaning = " ".join(f"{size.name}: {size.meaning}." for size in sheet.sizes)
    return [
        t.heading("Size"),
        t.grid(rows, [share * width for share in (0.09, 0.23, 0.34, 0.34)]),
        t.text(f"{meaning} {sheet.stroke_note}", 0.86, spaceBefore=1.0),
    ]


def _since(t: TypeSize, sheet: WorkSheet, context: ReportContext, width: float) -> list[Any]:
    parts = [t.heading("Since when"), t.text(" ".join(sheet.since_said))]
    if not sheet.past:
        return parts
    rows = [
        ["Before", *[_day(past.at, context) for past in sheet.past]],
        ["", *[_verdict(verdict_before(past)) for past in sheet.past]],
        ["S, %", *[span_percent(past.S) for past in sheet.past]],
    ]
    step = (width - 28.0) / max(len(sheet.past), 4)
    small = TypeSize(0.76 * t.size)
    cells = [
        [small.text(cell, bold=column == 0) for column, cell in enumerate(row)] for row in rows
    ]
    widths = [28.0, *[step] * len(sheet.past)]
    return [*parts, Table(cells, colWidths=widths, style=BARE, hAlign="LEFT")]


def _verdict(verdict: Verdict) -> str:
    return f"{VERDICT_SYMBOL[verdict]} {SHORT.get(verdict, verdict.value)}"


def _day(moment: datetime | None, context: ReportContext) -> str:
    return NOTHING if moment is None else f"{moment.astimezone(context.tz):%Y-%m-%d}"


def _steps(t: TypeSize, sheet: WorkSheet) -> list[Any]:
    hanging: dict[str, Any] = {"leftIndent": 12.0, "firstLineIndent": -12.0}
    return [
        t.heading("Check in this order"),
        *[
            t.text(f"{number}. [{LEVEL_NAME[step.level]}] {step.text}", **hanging)
            for number, step in enumerate(sheet.steps, start=1)
        ],
    ]


def _hand(t: TypeSize, sheet: WorkSheet) -> list[Any]:
    parts = t.text(f"{'; '.join(sheet.parts)}.")
    return [t.heading("Have at hand"), parts, t.heading("How sure"), t.text(" ".join(sheet.sure))]


def _doubt(t: TypeSize, sheet: WorkSheet) -> list[Any]:
    doubts = " ".join(sheet.finding.otherwise) or "Nothing that this recording would show."
    reason = t.text(f"{capitalised(sheet.priority.reason)}.")
    return [
        *[t.heading("What else it could be"), t.text(doubts)],
        *[t.heading("Why this priority"), reason],
    ]


def _isolation(t: TypeSize, sheet: WorkSheet) -> list[Any]:
    levels = [t.text(f"[{LEVEL_NAME[level]}] {text}") for level, text in sheet.isolation]
    return [t.heading("Isolation"), *levels, t.text(HINT, 0.86)]
