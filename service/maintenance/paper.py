"""The parts of every PDF: fonts, replacements for missing letters, paragraphs, pictures, pages."""

from __future__ import annotations

import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.resources import files
from typing import Any, BinaryIO
from xml.sax.saxutils import escape

from reportlab.lib.pagesizes import A4
from reportlab.lib.styles import ParagraphStyle
from reportlab.platypus import (
    BaseDocTemplate,
    Flowable,
    Frame,
    PageTemplate,
    Paragraph,
    Table,
)

from stemwatch.service.maintenance.drawing import Drawing, DrawnLine, DrawnText, Mark, hatching
from stemwatch.service.presenter.wording import commands_quoted, printable, prose
from stemwatch.service.report.report_context import ReportContext

REGULAR, BOLD = "DejaVuSansCondensed", "DejaVuSansCondensed-Bold"
# Adobe's names for fonts that readers of PDF supply; embedding them would take megabytes.
HAN, HANGUL = "STSong-Light", "HYSMyeongJo-Medium"
BOX = "□"
_INVISIBLE = frozenset({"Cc", "Cf", "Mn", "Me"})
MARGIN, TOP, FOOT = 40.0, 30.0, 34.0
WIDTH = A4[0] - 2 * MARGIN
GAP = 16.0
LONGEST = 6000  # letters of a paragraph, which flows over pages
PLAIN = {"leftPadding": 0, "rightPadding": 0, "topPadding": 0, "bottomPadding": 0}


@cache
def fonts() -> dict[str, Any]:
    """The embedded fonts by name, registered with reportlab."""
    from reportlab import rl_config
    from reportlab.pdfbase import pdfmetrics
    from reportlab.pdfbase.cidfonts import UnicodeCIDFont
    from reportlab.pdfbase.ttfonts import TTFont

    rl_config.useA85 = 0  # the ASCII form would be larger and take longer
    folder = files("stemwatch.service.maintenance").joinpath("fonts")
    faces = {name: TTFont(name, str(folder.joinpath(f"{name}.ttf"))) for name in (REGULAR, BOLD)}
    for font in faces.values():
        # Reportlab adds up the letters of every word anew, and the words of the pages are the same.
        font.stringWidth = lru_cache(maxsize=100_000)(font.stringWidth)
    for font in (*faces.values(), UnicodeCIDFont(HAN), UnicodeCIDFont(HANGUL)):
        pdfmetrics.registerFont(font)
    return faces


@lru_cache(maxsize=20_000)
def font_of(letter: str, bold: bool = False) -> str:
    """The name of the font that has ``letter``; empty where none has it."""
    name = BOLD if bold else REGULAR
    if ord(letter) in fonts()[name].face.charToGlyph:
        return name
    if "HANGUL" in unicodedata.name(letter, ""):
        return HANGUL
    kinds = ("CJK", "HIRAGANA", "KATAKANA", "FULLWIDTH", "IDEOGRAPHIC")
    return HAN if unicodedata.name(letter, "").startswith(kinds) else ""


@lru_cache(maxsize=50_000)
def runs(text: str, bold: bool = False) -> tuple[tuple[str, str], ...]:
    """``text`` as pieces of (font, letters). What no font has is a box; what has no width, such as
    a mark that turns the direction of writing, is left out."""
    pieces: list[tuple[str, str]] = []
    for letter in text:
        font = font_of(letter, bold)
        if not font:
            if unicodedata.category(letter) in _INVISIBLE:
                continue
            font, letter = font_of(BOX, bold), BOX
        if pieces and pieces[-1][0] == font:
            pieces[-1] = (font, pieces[-1][1] + letter)
        else:
            pieces.append((font, letter))
    return tuple(pieces)


@lru_cache(maxsize=50_000)
def width_of(text: str, bold: bool = False) -> float:
    """The width of ``text`` in a size of 1 point."""
    from reportlab.pdfbase.pdfmetrics import stringWidth

    fonts()
    return float(sum(stringWidth(letters, font, 1.0) for font, letters in runs(text, bold)))


def is_whole(text: str) -> bool:
    """Whether every visible letter of ``text`` can be drawn."""
    return all(
        font_of(letter) or unicodedata.category(letter) in _INVISIBLE for letter in set(text)
    )


class PlainDocument(BaseDocTemplate):  # type: ignore[misc]  # reportlab has no types
    """A4 pages with a folio and lines to sign on below."""

    room = A4[1] - TOP - FOOT - 30.0

    def __init__(
        self,
        file: BinaryIO,
        title: str,
        context: ReportContext,
        signs: Sequence[str],
        *,
        compress: bool = True,
    ) -> None:
        fonts()
        super().__init__(
            file,
            pagesize=A4,
            title=printable(title),
            author=context.software,
            pageCompression=int(compress),
            invariant=1,
            initialFontName=REGULAR,
        )
        self._context, self._signs = context, signs
        frame = Frame(MARGIN, FOOT + 30.0, WIDTH, self.room, **PLAIN)
        self.addPageTemplates([PageTemplate("page", [frame], onPage=self._page)])

    def _page(self, canvas: Any, _: Any) -> None:
        folio(canvas, self._context)
        width = WIDTH / max(len(self._signs), 1)
        canvas.setLineWidth(0.6)
        for index, title in enumerate(self._signs):
            x = MARGIN + index * width
            canvas.line(x, FOOT, x + width - 8.0, FOOT)
            write(canvas, title, x, FOOT - 8.0)


def folio(canvas: Any, context: ReportContext) -> None:
    """Plant, day and page at the foot of a page."""
    day = context.started.astimezone(context.tz)
    footer = f"{context.plant or context.software} · {day:%Y-%m-%d}"
    write(canvas, footer[:120] + f" · page {canvas.getPageNumber()}", A4[0] - MARGIN, 10.0, "end")


class PaperPicture(Flowable):  # type: ignore[misc]  # reportlab has no types
    """A drawing as wide as the page, or ``width`` points wide."""

    def __init__(self, drawing: Drawing, width: float = WIDTH) -> None:
        super().__init__()
        self._drawing, self._width, self._scale = drawing, width, width / drawing.width

    def wrap(self, *_: float) -> tuple[float, float]:
        return self._width, self._scale * self._drawing.height

    def draw(self) -> None:
        self.canv.scale(self._scale, self._scale)
        for mark in self._drawing.marks:
            self._mark(mark)

    def _mark(self, mark: Mark) -> None:
        height = self._drawing.height
        if isinstance(mark, DrawnText):
            x, y = mark.at
            write(self.canv, mark.text, x, height - y, mark.anchor, mark.size, bold=mark.bold)
            return
        for line in [mark] if isinstance(mark, DrawnLine) else hatching(mark):
            self.canv.setLineWidth(line.width)
            self.canv.setStrokeGray(line.grey)
            self.canv.setDash(list(line.dash) if line.dash else [])
            path = self.canv.beginPath()
            for index, (x, y) in enumerate(line.points):
                (path.lineTo if index else path.moveTo)(x, height - y)
            self.canv.drawPath(path)


@dataclass(frozen=True)
class TypeSize:
    """Paragraphs in type of ``size`` points."""

    size: float

    def text(self, text: str, share: float = 1.0, *, bold: bool = False, **style: Any) -> Paragraph:
        """A paragraph in ``share`` of the size; every letter in a font that has it."""
        points = self.size * share
        paragraph_style = ParagraphStyle(
            "text", fontName=BOLD if bold else REGULAR, fontSize=points, leading=1.24 * points
        )
        return Paragraph(markup(text, bold), ParagraphStyle("text", paragraph_style, **style))

    def heading(self, text: str) -> Flowable:
        """A small heading over a thin rule."""
        style: dict[str, Any] = {"spaceBefore": 0.5 * self.size, "spaceAfter": 0.25 * self.size}
        return Ruled(self.text(text.upper(), 0.84, bold=True, **style), 0.4)

    def columns(self, *cells: Sequence[Any]) -> Table:
        """Flowables side by side."""
        width = (WIDTH - GAP * (len(cells) - 1)) / len(cells)
        widths = [width + (GAP if column < len(cells) - 1 else 0.0) for column in range(len(cells))]
        style = [*BARE, ("RIGHTPADDING", (0, 0), (-2, -1), GAP)]
        # The space before the first flowable of a cell is dropped, so the table has it.
        before = 0.5 * self.size
        return Table(
            [[list(cell) for cell in cells]], colWidths=widths, style=style, spaceBefore=before
        )

    def grid(self, rows: Sequence[Sequence[Any]], widths: Sequence[float]) -> Table:
        """A table of texts without rules; the first row and column are bold."""
        cells = [
            [self.text(cell, bold=line == 0 or column == 0) for column, cell in enumerate(row)]
            for line, row in enumerate(rows)
        ]
        return Table(cells, colWidths=list(widths), style=BARE, hAlign="LEFT")


class Ruled(Flowable):  # type: ignore[misc]  # reportlab has no types
    """A paragraph with a rule below it."""

    def __init__(self, paragraph: Paragraph, weight: float) -> None:
        super().__init__()
        self._inside, self._weight = paragraph, weight
        self.keepWithNext = 1

    def getSpaceBefore(self) -> float:  # reportlab's name
        return float(self._inside.getSpaceBefore())

    def getSpaceAfter(self) -> float:  # reportlab's name
        return float(self._inside.getSpaceAfter())

    def wrap(self, width: float, height: float) -> tuple[float, float]:
        self._width, tall = self._inside.wrap(width, height)
        return width, tall + 1.2

    def draw(self) -> None:
        self._inside.drawOn(self.canv, 0.0, 1.2)
        self.canv.setLineWidth(self._weight)
        self.canv.setStrokeGray(0.4)
        self.canv.line(0.0, 0.0, self._width, 0.0)


BARE = [
    ("VALIGN", (0, 0), (-1, -1), "TOP"),
    ("LEFTPADDING", (0, 0), (-1, -1), 0),
    ("RIGHTPADDING", (0, 0), (-1, -1), 0),
    ("TOPPADDING", (0, 0), (-1, -1), 0),
    ("BOTTOMPADDING", (0, 0), (-1, -1), 0),
]


def markup(text: str, bold: bool) -> str:
    """``text`` as reportlab's markup: runs of letters that the page's font lacks name theirs."""
    font_name = BOLD if bold else REGULAR
    return "".join(
        escape(letters) if font == font_name else f'<font name="{font}">{escape(letters)}</font>'
        for font, letters in runs(prose(commands_quoted(cut(text, LONGEST))), bold)
    )


def cut(text: str, longest: int) -> str:
    """``text`` of at most so many letters."""
    return text if len(text) <= longest else f"{text[: longest - 1]}…"


def write(
    canvas: Any,
    text: str,
    x: float,
    y: float,
    anchor: str = "start",
    points: float = 6.5,
    *,
    bold: bool = False,
) -> None:
    """One line of words whose baseline is ``y`` above the foot."""
    width = width_of(printable(text), bold) * points
    x -= width if anchor == "end" else width / 2 if anchor == "middle" else 0.0
    for font, letters in runs(printable(text), bold):
        canvas.setFont(font, points)
        canvas.drawString(x, y, letters)
        x += width_of(letters, bold) * points


def height_of(flowables: Sequence[Any]) -> float:
    """How much room ``flowables`` takes."""
    tall, after = 0.0, 0.0
    for index, part in enumerate(flowables):
        before = part.getSpaceBefore() if index else 0.0
        tall += max(before, after) + part.wrap(WIDTH, 10_000.0)[1]
        after = part.getSpaceAfter()
    return tall
