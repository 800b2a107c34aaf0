"""``Drawing``: lines, areas and words in points, which HTML and PDF draw alike.

Everything is black or grey. What tells two things apart is the width and the dash of a line, a
hatch, a mark or a word, so that a copy of a copy still reads.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Point = tuple[float, float]  # points, y downwards from the top
Anchor = Literal["start", "middle", "end"]


@dataclass(frozen=True)
class Line:
    """A polyline. ``dash`` is lengths of strokes and gaps; empty is solid. ``grey`` 0 is black."""

    points: tuple[Point, ...]
    width: float = 0.6
    dash: tuple[float, ...] = ()
    grey: float = 0.0


@dataclass(frozen=True)
class Area:
    """A polygon filled with thin parallel lines ``hatch`` points apart, or with grey without."""

    points: tuple[Point, ...]
    hatch: float = 0.0
    grey: float = 0.9


@dataclass(frozen=True)
class Label:
    """One line of words whose baseline is at ``at``."""

    at: Point
    text: str
    size: float = 7.0
    anchor: Anchor = "start"
    bold: bool = False


Mark = Line | Area | Label


@dataclass(frozen=True, kw_only=True)
class Drawing:
    """``marks`` in the order in which they are drawn; ``says`` is for those who do not see it."""

    width: float
    height: float
    marks: tuple[Mark, ...]
    says: str


def hatching(area: Area) -> tuple[Line, ...]:
    """The lines of a hatched area, from lower left to upper right, clipped to its polygon.

    A line of slope -1 meets the edges in an even number of points; every other piece is inside.
    """
    sums = [x + y for x, y in area.points]
    lines = []
    level = min(sums) + area.hatch
    while area.hatch > 0.0 and level < max(sums):
        crossings = sorted(_crossings(area.points, level))
        lines += [
            Line(points=((a, level - a), (b, level - b)), width=0.35, grey=0.45)
            for a, b in zip(crossings[::2], crossings[1::2], strict=False)
        ]
        level += area.hatch
    return tuple(lines)


def _crossings(points: tuple[Point, ...], level: float) -> list[float]:
    """Abscissae at which the polygon's edges cross the line x + y = ``level``."""
    found = []
    for (x0, y0), (x1, y1) in zip(points, (*points[1:], points[0]), strict=True):
        here, there = x0 + y0 - level, x1 + y1 - level
        if (here < 0.0) != (there < 0.0):
            found.append(x0 + (x1 - x0) * here / (here - there))
    return found
