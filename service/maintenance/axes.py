"""Axes of a panel: ticks at round numbers, and the way from data to points on paper."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from stemwatch.models.recording import Floats
from stemwatch.service.maintenance.drawing import Label, Line, Mark, Point

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
    ) -> list[Line]:
        """Polylines through ``x`` and ``y`` (n,), broken where either is not known."""
        known = np.isfinite(x) & np.isfinite(y)
        edges = np.flatnonzero(np.diff(np.concatenate(([0], known.astype(np.int8), [0]))))
        return [
            Line(
                tuple(self.at(float(a), float(b)) for a, b in zip(x[i:j], y[i:j], strict=True)),
                width=width,
                dash=dash,
                grey=grey,
            )
            for i, j in edges.reshape(-1, 2)
            if j - i > 1
        ]

    def frame(self, x_title: str, y_title: str) -> list[Mark]:
        """Frame, ticks and titles."""
        right, foot = self.left + self.width, self.top + self.height
        box = ((self.left, self.top), (right, self.top), (right, foot), (self.left, foot))
        marks: list[Mark] = [Line((*box, box[0]), width=0.5, grey=0.3)]
        for value in ticks(self.x0, self.x1):
            x = self.x(value)
            marks.append(Line(((x, foot), (x, foot + 2.5)), width=0.5, grey=0.3))
            marks.append(Label((x, foot + 9.5), said(value), TICK_SIZE, "middle"))
        for value in ticks(self.y0, self.y1, most=5):
            y = self.y(value)
            marks.append(Line(((self.left - 2.5, y), (self.left, y)), width=0.5, grey=0.3))
            marks.append(Label((self.left - 4.0, y + 2.3), said(value), TICK_SIZE, "end"))
        marks.append(Label((self.left + self.width / 2, foot + 18.0), x_title, TICK_SIZE, "middle"))
        marks.append(Label((self.left - 22.0, self.top - 4.0), y_title, TICK_SIZE))
        return marks


def span(*traces: Floats) -> tuple[float, float]:
    """The range of all finite values with a twentieth to spare; something to draw on where it is
    a point or nothing."""
    known = np.concatenate([one[np.isfinite(one)] for one in traces]) if traces else np.zeros(0)
    if not known.size:
        return 0.0, 1.0
    low, high = float(known.min()), float(known.max())
    spare = max(0.05 * (high - low), 0.5 if high - low < 0.5 else 0.0, 1e-6 * abs(high))
    return low - spare, high + spare


def ticks(low: float, high: float, most: int = 6) -> list[float]:
    """At most ``most`` round numbers between ``low`` and ``high``, evenly apart."""
    rough = (high - low) / most
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(power * k for k in (1, 2, 2.5, 5, 10) if power * k >= rough)
    first = math.ceil(low / step)
    last = math.floor(high / step)
    return [k * step for k in range(first, last + 1)]


def said(value: float) -> str:
    """A tick's number."""
    return f"{value:.6g}".replace("-", "−")
