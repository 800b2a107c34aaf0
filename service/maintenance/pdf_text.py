"""``Writer``: words onto a page of a PDF, wrapped and cut to the room that there is.

Without a canvas nothing is drawn and only the room is measured, so that a page can be laid out
before it is drawn.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import Any

from stemwatch.service.maintenance.drawing import Drawing, DrawnArea, DrawnLine, DrawnText, hatching
from stemwatch.service.maintenance.pdf_fonts import runs, width_of
from stemwatch.service.presenter.wording import prose

LEADING = 1.24
CUT = " …"
LONGEST = 4000  # letters of one text that are looked at; no block has room for more


class Writer:
    """``size`` is the type's size in points; y runs downwards from the top of a page ``height``
    points high. ``lost`` says whether a text was cut."""

    def __init__(self, canvas: Any, height: float, size: float) -> None:
        self._canvas = canvas
        self._height = height
        self.size = size
        self.lost = False

    def text(
        self,
        text: str,
        x: float,
        y: float,
        width: float,
        *,
        most: int = 99,
        size: float = 1.0,
        bold: bool = False,
    ) -> float:
        """A paragraph from ``y`` downwards in at most ``most`` lines, ``size`` times the writer's;
        returns where it ends. What does not fit is cut, with a mark."""
        points = self.size * size
        lines = wrapped(text, width / points, bold=bold, most=most)
        self.lost = self.lost or bool(lines and lines[-1].endswith(CUT))
        for line in lines:
            y += points * LEADING
            self.line(line, x, y - 0.27 * points, points, bold=bold)
        return y

    def line(
        self, text: str, x: float, y: float, points: float, *, bold: bool = False, anchor: str = ""
    ) -> None:
        """One line of words whose baseline is at ``y``."""
        if self._canvas is None or not text:
            return
        if anchor:
            whole = width_of(text, bold) * points
            x -= whole if anchor == "end" else whole / 2 if anchor == "middle" else 0.0
        for font, letters in runs(text, bold):
            self._canvas.setFont(font, points)
            self._canvas.drawString(x, self._height - y, letters)
            x += width_of(letters, bold) * points

    def heading(self, text: str, x: float, y: float, width: float) -> float:
        """A small heading over a thin rule."""
        y = self.text(text.upper(), x, y + 0.45 * self.size, width, size=0.84, bold=True, most=1)
        self.rule(x, y + 1.2, width)
        return y + 2.2

    def rule(self, x: float, y: float, width: float, weight: float = 0.4) -> None:
        """A level line."""
        self.stroke(DrawnLine(((x, y), (x + width, y)), width=weight, grey=0.4))

    def box(
        self, x: float, y: float, width: float, height: float, weight: float, dash: Sequence[float]
    ) -> None:
        """A frame from its upper left corner."""
        corners = ((x, y), (x + width, y), (x + width, y + height), (x, y + height), (x, y))
        self.stroke(DrawnLine(corners, width=weight, dash=tuple(dash)))

    def stroke(self, line: DrawnLine) -> None:
        """A polyline."""
        if self._canvas is None:
            return
        self._canvas.setLineWidth(line.width)
        self._canvas.setStrokeGray(line.grey)
        self._canvas.setDash(list(line.dash) if line.dash else [])
        path = self._canvas.beginPath()
        for at, (x, y) in enumerate(line.points):
            (path.lineTo if at else path.moveTo)(x, self._height - y)
        self._canvas.drawPath(path)

    def picture(self, drawing: Drawing, x: float, y: float, width: float) -> float:
        """A drawing, ``width`` points wide; returns where it ends."""
        scale = width / drawing.width
        if self._canvas is not None:
            self._canvas.saveState()
            self._canvas.translate(x, self._height - y)
            self._canvas.scale(scale, scale)
            inside = Writer(self._canvas, 0.0, self.size)
            for mark in drawing.marks:
                inside.mark(mark)
            self._canvas.restoreState()
        return y + scale * drawing.height

    def mark(self, mark: DrawnLine | DrawnArea | DrawnText) -> None:
        """One mark of a drawing."""
        if isinstance(mark, DrawnLine):
            self.stroke(mark)
        elif isinstance(mark, DrawnText):
            x, y = mark.at
            self.line(mark.text, x, y, mark.size, bold=mark.bold, anchor=mark.anchor)
        else:
            for line in hatching(mark):
                self.stroke(line)


@lru_cache(maxsize=1_000)  # a page is laid out before it is drawn, each time with the same texts
def wrapped(text: str, width: float, *, bold: bool = False, most: int = 99) -> tuple[str, ...]:
    """``text`` in lines of at most ``width`` times the type's size, at most ``most`` of them.

    A word that is wider than a line is broken. Where lines are left out the last one ends in "…".
    """
    lines: list[str] = []
    blank, line, taken = width_of(" ", bold), "", 0.0
    for piece in _pieces(prose(text)[:LONGEST], width, bold):
        longer = taken + blank + width_of(piece, bold)
        if not line:
            line, taken = piece, width_of(piece, bold)
        elif longer <= width:
            line, taken = f"{line} {piece}", longer
        elif len(lines) == most - 1:
            return (*lines, _cut(line, width, bold))
        else:
            lines.append(line)
            line, taken = piece, width_of(piece, bold)
    return (*lines, line) if line else tuple(lines)


def _pieces(text: str, width: float, bold: bool) -> Iterator[str]:
    """The words of ``text``, those wider than a line in pieces that fit."""
    for word in text.split():
        while width_of(word, bold) > width:
            fits = _fitting(word, width, bold)
            yield word[:fits]
            word = word[fits:]
        yield word


def _fitting(word: str, width: float, bold: bool) -> int:
    """How many letters of ``word`` fit into ``width``; at least one."""
    low, high = 1, len(word)
    while low < high:
        middle = (low + high + 1) // 2
        if width_of(word[:middle], bold) <= width:
            low = middle
        else:
            high = middle - 1
    return low


def _cut(line: str, width: float, bold: bool) -> str:
    while line and width_of(line + CUT, bold) > width:
        line = line[:-1]
    return line.rstrip() + CUT
