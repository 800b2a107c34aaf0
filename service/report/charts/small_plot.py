"""A small plot as SVG, drawn where there are no scripts: on paper, on a phone, in a mail.

Colours come from the style sheet by the class of each line, so that they fit both themes and paper.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup

from stemwatch.models.recording import Floats
from stemwatch.service.presenter.wording import figure, printable
from stemwatch.service.report.charts.axes import equally_long, ticks
from stemwatch.service.report.svg_text import svg_text

WIDTH, HEIGHT = 360, 250
LEFT, RIGHT, TOP, BOTTOM = 52, 10, 10, 38
FARTHEST = 1e5  # pixels
TICKS = 5


@dataclass(frozen=True)
class PlottedLine:
    """One line or cloud: ``kind`` is its class in the style sheet; ``label`` stands in the legend
    unless it is empty. ``dots`` are points instead of a line."""

    kind: str
    label: str
    x: Floats
    y: Floats
    dots: bool = False
    dashed: bool = False


@dataclass(frozen=True)
class Note:
    """Words at a point of the plot."""

    x: float
    y: float
    text: str


@dataclass(frozen=True)
class SmallPlot:
    """Everything that one small plot shows; ``description`` is what a screen reader says."""

    x_label: str
    y_label: str
    description: str
    lines: Sequence[PlottedLine]
    notes: Sequence[Note] = ()
    equal: bool = False  # one percent is as long along both axes
    width: int = WIDTH
    height: int = HEIGHT
    limits: tuple[float, float, float, float] | None = None
    legend: bool = True

    def svg(self) -> Markup:
        """The plot; its legend is a list of its own below the picture."""
        x_low, x_high, y_low, y_high = self.limits or self._limits()
        inner_x, inner_y = self.width - LEFT - RIGHT, self.height - TOP - BOTTOM
        if self.equal:
            (x_low, x_high), (y_low, y_high) = equally_long(
                (x_low, x_high), (y_low, y_high), inner_x / inner_y
            )

        def at(x: Floats, y: Floats) -> tuple[Floats, Floats]:
            return (
                LEFT + inner_x * (x - x_low) / (x_high - x_low),
                TOP + inner_y * (1.0 - (y - y_low) / (y_high - y_low)),
            )

        parts = [
            Markup(
                '<svg class="small-plot" viewBox="0 0 {} {}" width="{}" height="{}" role="img" '
                'aria-label="{}">'
            ).format(self.width, self.height, self.width, self.height, printable(self.description)),
            *self._axes(x_low, x_high, y_low, y_high),
            Markup('<svg x="{}" y="{}" width="{}" height="{}" viewBox="{} {} {} {}">').format(
                LEFT, TOP, inner_x, inner_y, LEFT, TOP, inner_x, inner_y
            ),
            *(_line(line, *at(line.x, line.y)) for line in self.lines),
            Markup("</svg>"),
        ]
        for note in self.notes:
            x, y = at(np.array(note.x), np.array(note.y))
            anchor = "end" if float(x) > LEFT + 0.6 * inner_x else "start"
            parts.append(svg_text(float(x), max(float(y), TOP + 10), note.text, "note", anchor))
        parts.append(Markup("</svg>"))
        if self.legend:
            parts.append(self._legend())
        return Markup("").join(parts)

    def _limits(self) -> tuple[float, float, float, float]:
        x = np.concatenate([line.x[np.isfinite(line.x)] for line in self.lines] or [np.zeros(1)])
        y = np.concatenate([line.y[np.isfinite(line.y)] for line in self.lines] or [np.zeros(1)])
        return (*_widened(x), *_widened(y))

    def _axes(self, x_low: float, x_high: float, y_low: float, y_high: float) -> list[Markup]:
        right, bottom = self.width - RIGHT, self.height - BOTTOM
        parts = []
        for value in ticks(x_low, x_high, TICKS):
            x = LEFT + (right - LEFT) * (value - x_low) / (x_high - x_low)
            parts.append(_rule(x, TOP, x, bottom))
            parts.append(svg_text(x, bottom + 14, _tick(value), "axis", "middle"))
        for value in ticks(y_low, y_high, TICKS):
            y = bottom - (bottom - TOP) * (value - y_low) / (y_high - y_low)
            parts.append(_rule(LEFT, y, right, y))
            parts.append(svg_text(LEFT - 5, y + 4, _tick(value), "axis", "end"))
        middle = (TOP + bottom) / 2
        parts.append(svg_text((LEFT + right) / 2, self.height - 6, self.x_label, "axis", "middle"))
        parts.append(
            Markup(
                '<text x="11" y="{0}" class="axis" text-anchor="middle" '
                'transform="rotate(-90 11 {0})">{1}</text>'
            ).format(round(middle, 1), printable(self.y_label))
        )
        return parts

    def _legend(self) -> Markup:
        order = dict.fromkeys(
            (line.kind, line.label, line.dots, line.dashed) for line in self.lines if line.label
        )
        items = [
            Markup(
                '<li><svg viewBox="0 0 22 8" width="22" height="8" aria-hidden="true">{}</svg>'
            ).format(
                Markup('<circle class="p {}" cx="11" cy="4" r="2.5"/>').format(kind)
                if dots
                else Markup('<path class="l {}{}" d="M1 4H21"/>').format(
                    kind, " dashed" if dashed else ""
                )
            )
            + Markup(" {}</li>").format(printable(label))
            for kind, label, dots, dashed in order
        ]
        return Markup('<ul class="small-legend">{}</ul>').format(Markup("").join(items))


@dataclass(frozen=True, kw_only=True)
class Picture:
    """One picture with its heading and what to see in it."""

    title: str
    plot: SmallPlot
    caption: str = ""

    @property
    def svg(self) -> Markup:
        """The picture as it stands in a page."""
        return self.plot.svg()


def _tick(value: float) -> str:
    text = figure(value, 6) if abs(value) > 1e-12 else "0"
    return text.rstrip("0").rstrip(".") if "." in text else text


def _widened(values: Floats) -> tuple[float, float]:
    if not values.size:
        return 0.0, 1.0
    low, high = float(values.min()), float(values.max())
    margin = 0.05 * (high - low) or max(abs(high), 1.0) * 0.05
    return low - margin, high + margin


def _line(line: PlottedLine, x: Floats, y: Floats) -> Markup:
    finite = np.isfinite(x) & np.isfinite(y)
    begins = np.diff(np.flatnonzero(finite), prepend=-2) > 1
    path = "".join(
        f"{'m' if line.dots or begun else ''}{_tenths(a)}{_tenths(b)}{'h0' if line.dots else ''}"
        for a, b, begun in zip(_moves(x[finite]), _moves(y[finite]), begins, strict=True)
    )
    if line.dots:
        return Markup('<path class="p {}" d="{}"/>').format(line.kind, path)
    dashed = " dashed" if line.dashed else ""
    return Markup('<path class="l {}{}" d="{}"/>').format(line.kind, dashed, path)


def _moves(places: Floats) -> list[int]:
    """Tenths of a pixel from each place to the next, the first from 0: half the letters of absolute
    places. What is far beyond the picture ends there."""
    tenths = np.rint(10.0 * np.clip(places, -FARTHEST, FARTHEST)).astype(np.int64)
    moves: list[int] = np.diff(np.concatenate([[0], tenths])).tolist()
    return moves


def _tenths(number: int) -> str:
    """A tenth of ``number``, as short as a path may have it, with the sign or blank before it."""
    text = f"{number / 10:g}".replace("0.", ".", 1) if abs(number) < 10 else f"{number / 10:.10g}"
    return text if number < 0 else f" {text}"


def _rule(x1: float, y1: float, x2: float, y2: float) -> Markup:
    return Markup('<path class="rule" d="M{:.1f} {:.1f}L{:.1f} {:.1f}"/>').format(x1, y1, x2, y2)
