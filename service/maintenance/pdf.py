"""The maintenance report as PDF, drawn directly: a list of the valves, then a page for each."""

from __future__ import annotations

import io
from typing import Any

from stemwatch.service.maintenance.pdf_fonts import REGULAR, fonts
from stemwatch.service.maintenance.pdf_sheet import FOOT, LEFT, PAGE, TOP, WIDTH, draw_sheet
from stemwatch.service.maintenance.pdf_text import Writer
from stemwatch.service.maintenance.work_list import ValveWithoutPage, WorkList
from stemwatch.service.maintenance.work_sheet import WorkSheet
from stemwatch.service.presenter.advice import HINT
from stemwatch.service.presenter.wording import NOTHING, VERDICT_SYMBOL, instant, printable

SIZE = 8.2
HEADINGS = ("Page", "Priority", "Valve", "Finding", "S", "Since", "By")
COLUMNS = (0.0, 0.055, 0.215, 0.54, 0.735, 0.805, 0.9)
LEGEND = (
    "Priority: severity x criticality x trend; 1 within a week, 2 within a month, 3 within three "
    "months, 4 at the next stop. Confirm with a stroke test before a valve is opened."
)


def book_pdf(book: WorkList, *, compress: bool = True) -> bytes:
    """The report as PDF, the same for the same book; uncompressed where a test reads it."""
    from reportlab.pdfgen.canvas import Canvas

    fonts()
    memory = io.BytesIO()
    canvas = Canvas(
        memory, pagesize=PAGE, pageCompression=int(compress), invariant=1, initialFontName=REGULAR
    )
    canvas.setTitle(printable(f"Maintenance report {book.context.plant}".strip()))
    canvas.setAuthor(book.context.software)
    lists = _Lists(canvas, book)
    lists.draw()
    for number, sheet in enumerate(book.sheets, start=1):
        draw_sheet(canvas, sheet, book.context)
        key = f"m{number}"
        canvas.bookmarkPage(key)
        canvas.addOutlineEntry(printable(sheet.screening.valve)[:80], key)
        _folio(Writer(canvas, PAGE[1], SIZE), book, str(number))
        canvas.showPage()
    canvas.save()
    return memory.getvalue()


class _Lists:
    """The front: what is in the report, the valves in their order, and those without a page."""

    def __init__(self, canvas: Any, book: WorkList) -> None:
        self._canvas, self._book = canvas, book
        self._w = Writer(canvas, PAGE[1], SIZE)
        self._y = TOP

    def draw(self) -> None:
        """All of it, on as many pages as it takes."""
        book, w = self._book, self._w
        self._y = w.text("Maintenance report", LEFT, TOP, WIDTH, size=2.2, bold=True)
        told = f"{instant(book.context.started, book.context.tz)} ({book.context.zone})"
        told += f", run {book.run}" if book.run is not None else ""
        plant = f"{book.context.plant}, " if book.context.plant else ""
        self._say(f"{plant}{told}. {book.context.software}.")
        self._say(book.counts, bold=True)
        self._say(book.discovered)
        self._heading() if book.sheets else self._say(
            "There is no page for a valve in this report."
        )
        for number, sheet in enumerate(book.sheets, start=1):
            self._row(number, sheet)
        self._rest()
        self._remarks()
        self._say(f"{LEGEND} {HINT}", size=0.86)
        self._close()

    def _heading(self) -> None:
        self._y += 4.0
        for title, share in zip(HEADINGS, COLUMNS, strict=True):
            self._w.text(title, LEFT + share * WIDTH, self._y, 200.0, bold=True, most=1)
        self._y += SIZE * 1.24
        self._w.rule(LEFT, self._y + 1.0, WIDTH, 0.8)
        self._y += 2.0

    def _row(self, number: int, sheet: WorkSheet) -> None:
        context, work = self._book.context, sheet.has_order
        begins = sheet.since.first.at if sheet.since.first else sheet.screening.window[1]
        cells = (
            str(number),
            f"{sheet.priority.code} {sheet.priority.words}" if work else NOTHING,
            sheet.screening.valve,
            sheet.title,
            sheet.sizes[0].percent if sheet.sizes[0].interval else NOTHING,
            NOTHING if begins is None else f"{begins.astimezone(context.tz):%Y-%m-%d}",
            str(sheet.priority.due(context.started, context.tz)) if work else NOTHING,
        )
        if self._full(2.0 * SIZE * 1.24 + 3.0):
            self._heading()
        ends = (*COLUMNS[1:], 1.0)
        end = self._y
        for at, (cell, share, stop) in enumerate(zip(cells, COLUMNS, ends, strict=True)):
            room = (stop - share) * WIDTH - 4.0
            x = LEFT + share * WIDTH
            size = 0.9 if at in (1, 5, 6) else 1.0
            most = 1 if at == 2 else 2
            foot = self._w.text(cell, x, self._y, room, most=most, size=size, bold=at == 2)
            if at == 2:
                service = sheet.valve.facts.description
                foot = self._w.text(service, x, foot, room, most=1, size=0.86)
            end = max(end, foot)
        self._canvas.linkRect(
            "", f"m{number}", (LEFT, PAGE[1] - end, LEFT + WIDTH, PAGE[1] - self._y)
        )
        self._w.rule(LEFT, end + 1.2, WIDTH, 0.3)
        self._y = end + 2.0

    def _rest(self) -> None:
        others = self._book.others
        if not others:
            return
        self._full(40.0)
        many = "valve" if len(others) == 1 else "valves"
        self._y = self._w.heading(
            f"{len(others)} {many} without a page", LEFT, self._y + 6.0, WIDTH
        )
        for one in others:
            self._brief(one)

    def _brief(self, one: ValveWithoutPage) -> None:
        self._full(SIZE * 1.24 * 2)
        verdict = f"{VERDICT_SYMBOL[one.verdict]} {one.verdict.value}"
        end = self._w.text(verdict, LEFT, self._y, 76.0, most=1, size=0.9)
        tag = self._w.text(one.valve, LEFT + 78.0, self._y, 112.0, most=2, bold=True, size=0.9)
        said = self._w.text(one.said, LEFT + 196.0, self._y, WIDTH - 196.0, most=2, size=0.9)
        self._y = max(end, tag, said)

    def _remarks(self) -> None:
        for at, one in enumerate(self._book.context.sources_not_read):
            if at == 0:
                self._full(40.0)
                self._y = self._w.heading("Remarks", LEFT, self._y + 6.0, WIDTH)
            self._full(SIZE * 1.24 * 2)
            self._say(f"{one.source}: {one.reason}", size=0.9, most=2)

    def _say(self, text: str, *, size: float = 1.0, bold: bool = False, most: int = 6) -> None:
        if text:
            self._full(SIZE * 1.24 * size)
            self._y = self._w.text(
                text, LEFT, self._y + 2.0, WIDTH, size=size, bold=bold, most=most
            )

    def _full(self, needed: float) -> bool:
        """Begin a new page where ``needed`` points are not left; returns whether it did."""
        if self._y + needed <= PAGE[1] - FOOT:
            return False
        self._close()
        self._y = TOP
        return True

    def _close(self) -> None:
        _folio(self._w, self._book, "")
        self._canvas.showPage()


def _folio(writer: Writer, book: WorkList, page: str) -> None:
    day = book.context.started.astimezone(book.context.tz)
    told = f"{book.context.plant or book.context.software} · {day:%Y-%m-%d}"
    text = f"{told} · page {page}" if page else told
    writer.line(text[:120], LEFT + WIDTH, PAGE[1] - 10.0, 6.5, anchor="end")
