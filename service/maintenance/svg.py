"""A ``Drawing`` as SVG inside a page, sharp at any size."""

from __future__ import annotations

from markupsafe import Markup, escape

from stemwatch.service.maintenance.drawing import Area, Drawing, Label, Line, Mark, hatching
from stemwatch.service.report.words import printable


def svg_of(drawing: Drawing) -> Markup:
    """The picture as an element; every text is escaped."""
    inside = Markup("").join(_mark(mark) for mark in drawing.marks)
    return Markup(
        '<svg viewBox="0 0 {width:g} {height:g}" role="img" aria-label="{says}">{inside}</svg>'
    ).format(
        width=drawing.width, height=drawing.height, says=printable(drawing.says), inside=inside
    )


def _mark(mark: Mark) -> Markup:
    if isinstance(mark, Line):
        return _line(mark)
    if isinstance(mark, Area):
        return (
            Markup("").join(_line(line) for line in hatching(mark)) if mark.hatch else _area(mark)
        )
    return _label(mark)


def _points(mark: Line | Area) -> str:
    return " ".join(f"{x:.1f},{y:.1f}" for x, y in mark.points)


def _line(line: Line) -> Markup:
    dash = f' stroke-dasharray="{" ".join(f"{one:g}" for one in line.dash)}"' if line.dash else ""
    return Markup(
        f'<polyline points="{_points(line)}" fill="none" stroke="{_grey(line.grey)}" '
        f'stroke-width="{line.width:g}"{dash}/>'
    )


def _area(area: Area) -> Markup:
    return Markup(f'<polygon points="{_points(area)}" fill="{_grey(area.grey)}"/>')


def _label(label: Label) -> Markup:
    weight = ' font-weight="700"' if label.bold else ""
    start = (
        f'<text x="{label.at[0]:.1f}" y="{label.at[1]:.1f}" font-size="{label.size:g}" '
        f'text-anchor="{label.anchor}"{weight}>'
    )
    return Markup(start) + escape(printable(label.text)) + Markup("</text>")


def _grey(grey: float) -> str:
    level = round(255 * grey)
    return f"#{level:02x}{level:02x}{level:02x}"
