"""``Drawing``: lines, areas and words in points, which HTML and PDF draw alike.

The axes of panels, and the drawing as SVG for a page, are here too. Everything is black or grey.
Lines differ by width and dash, areas by hatching, and all have a word beside them, so that even a
copy of a copy is readable.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from markupsafe import Markup, escape

from stemwatch.models.recording import Floats
from stemwatch.models.signals.runs_of_samples import runs_of
from stemwatch.service.presenter.wording import printable
from stemwatch.service.report.charts.axes import ticks

Point = tuple[float, float]  # points, y downwards from the top
Anchor = Literal["start", "middle", "end"]


@dataclass(frozen=True)
class DrawnLine:
    """A polyline. ``dash`` is lengths of strokes and gaps; empty is solid. ``grey`` 0 is black."""

    points: tuple[Point, ...]
    width: float = 0.6
    dash: tuple[float, ...] = ()
    grey: float = 0.0


@dataclass(frozen=True)
class DrawnArea:
    """A polygon filled with thin parallel lines ``hatch`` points apart, or with grey without."""

    points: tuple[Point, ...]
    hatch: float = 0.0
    grey: float = 0.9


@dataclass(frozen=True)
class DrawnText:
    """One line of words whose baseline is at ``at``."""

    at: Point
    text: str
    size: float = 7.0
    anchor: Anchor = "start"
    bold: bool = False


Mark = DrawnLine | DrawnArea | DrawnText


@dataclass(frozen=True, kw_only=True)
class Drawing:
    """``marks`` in the order of drawing; ``caption`` is for those who do not see it."""

    width: float
    height: float
    marks: tuple[Mark, ...]
    caption: str


def hatching(area: DrawnArea) -> tuple[DrawnLine, ...]:
    """The lines of a hatched area, from lower left to upper right, clipped to its polygon.

    A line of slope -1 meets the edges in an even number of points; every other piece is inside.
    """
    sums = [x + y for x, y in area.points]
    lines = []
    level = min(sums) + area.hatch
    while area.hatch > 0.0 and level < max(sums):
        crossings = sorted(_crossings(area.points, level))
        lines += [
            DrawnLine(points=((a, level - a), (b, level - b)), width=0.35, grey=0.45)
            for a, b in zip(crossings[::2], crossings[1::2], strict=False)
        ]
        level += area.hatch
    return tuple(lines)


def _crossings(points: tuple[Point, ...], level: float) -> list[float]:
    """Abscissae at which the polygon's edges cross the line x + y = ``level``."""
    crossings = []
    for (x0, y0), (x1, y1) in zip(points, (*points[1:], points[0]), strict=True):
        offset0, offset1 = x0 + y0 - level, x1 + y1 - level
        if (offset0 < 0.0) != (offset1 < 0.0):
            crossings.append(x0 + (x1 - x0) * offset0 / (offset0 - offset1))
    return crossings


def svg_of(drawing: Drawing) -> Markup:
    """The picture as an element; every text is escaped."""
    marks = Markup("").join(_mark(mark) for mark in drawing.marks)
    return Markup(
        '<svg viewBox="0 0 {width:g} {height:g}" role="img" aria-label="{says}">{inside}</svg>'
    ).format(
        width=drawing.width, height=drawing.height, says=printable(drawing.caption), inside=marks
    )


def _mark(mark: Mark) -> Markup:
    if isinstance(mark, DrawnLine):
        return _line(mark)
    if isinstance(mark, DrawnArea):
        return (
            Markup("").join(_line(line) for line in hatching(mark)) if mark.hatch else _area(mark)
        )
    return _label(mark)


def _points(mark: DrawnLine | DrawnArea) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in mark.points)


def _line(line: DrawnLine) -> Markup:
    dash = (
        f' stroke-dasharray="{" ".join(f"{length:g}" for length in line.dash)}"'
        if line.dash
        else ""
    )
    return Markup(
        f'<polyline points="{_points(line)}" fill="none" stroke="{_grey(line.grey)}" '
        f'stroke-width="{line.width:g}"{dash}/>'
    )


def _area(area: DrawnArea) -> Markup:
    return Markup(f'<polygon points="{_points(area)}" fill="{_grey(area.grey)}"/>')


def _label(label: DrawnText) -> Markup:
    weight = ' font-weight="700"' if label.bold else ""
    start = (
        f'<text x="{label.at[0]:.1f}" y="{label.at[1]:.1f}" font-size="{label.size:g}" '
        f'text-anchor="{label.anchor}"{weight}>'
    )
    return Markup(start) + escape(printable(label.text)) + Markup("</text>")


def _grey(grey: float) -> str:
    level = round(255 * grey)
    return f"#{level:02x}{level:02x}{level:02x}"


TICK_SIZE = 6.5


@dataclass(frozen=True, kw_only=True)
class Panel:
    """A frame from (``left``, ``top``) of ``width`` x ``height`` points that shows the data from
    (``x0``, ``y0``) to (``x1``, ``y1``)."""

    left: float
    top: float
    width: float
    height: float
    x0: float
    x1: float
    y0: float
    y1: float

    def x(self, value: float) -> float:
        """Where ``value`` lies across, in points."""
        return self.left + self.width * (value - self.x0) / (self.x1 - self.x0)

    def y(self, value: float) -> float:
        """Where ``value`` lies downwards, in points."""
        return self.top + self.height * (self.y1 - value) / (self.y1 - self.y0)

    def at(self, x: float, y: float) -> Point:
        """A point of the data on paper, no further out than the frame."""
        across = min(max(self.x(x), self.left), self.left + self.width)
        down = min(max(self.y(y), self.top), self.top + self.height)
        return round(across, 1), round(down, 1)

    def lines(
        self, x: Floats, y: Floats, width: float, dash: tuple[float, ...] = (), grey: float = 0.0
    ) -> list[DrawnLine]:
        """Polylines through ``x`` and ``y`` (n,), broken where either is not known."""
        finite = np.isfinite(x) & np.isfinite(y)
        return [
            DrawnLine(
                _corners(
                    [self.at(a, b) for a, b in zip(x[i:j].tolist(), y[i:j].tolist(), strict=True)]
                ),
                width=width,
                dash=dash,
                grey=grey,
            )
            for i, j in runs_of(finite)
            if j - i > 1
        ]

    def frame(self, x_title: str, y_title: str) -> list[Mark]:
        """Frame, ticks and titles."""
        right, foot = self.left + self.width, self.top + self.height
        box = ((self.left, self.top), (right, self.top), (right, foot), (self.left, foot))
        marks: list[Mark] = [DrawnLine((*box, box[0]), width=0.5, grey=0.3)]
        for value in ticks(self.x0, self.x1, about=6):
            x = self.x(value)
            marks.append(DrawnLine(((x, foot), (x, foot + 2.5)), width=0.5, grey=0.3))
            marks.append(DrawnText((x, foot + 9.5), tick_text(value), TICK_SIZE, "middle"))
        for value in ticks(self.y0, self.y1, about=5):
            y = self.y(value)
            marks.append(DrawnLine(((self.left - 2.5, y), (self.left, y)), width=0.5, grey=0.3))
            marks.append(DrawnText((self.left - 4.0, y + 2.3), tick_text(value), TICK_SIZE, "end"))
        marks.append(
            DrawnText((self.left + self.width / 2, foot + 18.0), x_title, TICK_SIZE, "middle")
        )
        marks.append(DrawnText((self.left - 22.0, self.top - 4.0), y_title, TICK_SIZE))
        return marks


def _corners(points: Sequence[Point]) -> tuple[Point, ...]:
    """The polyline through ``points`` (2 or more) without those in the middle of a level or upright
    stretch: a valve that rests, or a command that holds, is two of them."""
    kept = [points[0]]
    for point, after in pairwise(points[1:]):
        before = kept[-1]
        is_level = before[1] == point[1] == after[1] and _between(before[0], point[0], after[0])
        is_upright = before[0] == point[0] == after[0] and _between(before[1], point[1], after[1])
        if not (is_level or is_upright):
            kept.append(point)
    return (*kept, points[-1])


def _between(first: float, middle: float, last: float) -> bool:
    return first <= middle <= last or last <= middle <= first


def span(*traces: Floats) -> tuple[float, float]:
    """The range of all finite values with a margin of a twentieth; a default range where there is
    no value or only one."""
    finite = (
        np.concatenate([trace[np.isfinite(trace)] for trace in traces]) if traces else np.zeros(0)
    )
    if not finite.size:
        return 0.0, 1.0
    low, high = float(finite.min()), float(finite.max())
    spare = max(0.05 * (high - low), 0.5 if high - low < 0.5 else 0.0, 1e-6 * abs(high))
    return low - spare, high + spare


def tick_text(value: float) -> str:
    """A tick's number."""
    return f"{value:.6g}".replace("-", "−")
