"""``StrokeCurve``: the curve from OP to stroke, and a recording read through it.

::

    OP --curve f--> command, percent of travel --actuator--> --stick-slip--> MV

S and J are read from the distance between command and position, so both must be in the same
percent. On many valves they are not: a split range strokes the whole valve with half of OP, an
air-to-close valve moves the other way, a positioner's characteristic or a cam bends the curve.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.recording import Floats, Recording, Role, Signal

# By how much J may be wrong either way where the slope is not known.
SLOPE_UNKNOWN = 2.0
# S does not depend on the slope, but lag and friction that the slope hides change it by a tenth.
S_BY_SLOPE = 1.1
NEARLY_LINEAR_PERCENT = 1.5  # of travel, off the chord
LEAST_TRAVEL_PERCENT = 0.5  # less is no curve
USED = (0.5, 99.5)  # percentiles between which OP counts as used
STRAIGHT_PERCENT = 0.01  # of travel, off the chord: a curve that was fitted as a straight line
# Degree of the polynomial that describes the error of a bent curve: that of the richest correction
# which a curve is found with.
BENT_DEGREE = 5
POINTS_OFF_PERCENT = 0.5  # of travel, by which points on a line are left out
# A position in another unit begins at 0 with OP, percent off it at most, and has such a slope.
FROM_ZERO_PERCENT, OTHER_UNIT = 3.0, (0.05, 0.95)
# Ranges are set to round numbers, in multiples of ROUND_PERCENT of OP, which lie within
# NOT_TOLD_PERCENT of the estimate.
ROUND_PERCENT, NOT_TOLD_PERCENT = 5.0, 1.0
REVERSED = (
    "The position falls as OP rises (air to close, or a reading that counts the other way), and is "
    "read the other way round."
)


@dataclass(frozen=True)
class StrokeCurve:
    """``travel`` (k,) percent of travel at ``op`` (k,) percent of OP, rising in ``op``.

    Linear between the knots, constant beyond them. ``used`` are the ends of the part of OP that a
    recording used, over which the slope is meant; all of the curve where it is ``None``.
    ``slope_known`` is False where the valve went to and fro between two places only: S in percent
    of OP is then known, but not the J and the slope separately. ``given``: the plant file gives the
    curve. ``remark`` says that it changed, or that it is an earlier one.
    """

    op: tuple[float, ...]
    travel: tuple[float, ...]
    slope_known: bool = True
    used: tuple[float, float] | None = None
    given: bool = False
    remark: str = ""

    def command(self, op: Floats) -> Floats:
        """(n,) OP as percent of travel; NaN stays NaN."""
        return np.asarray(np.interp(op, self.op, self.travel), dtype=np.float64)

    def in_op(self, estimate: Estimate, *, is_jump: bool = False) -> Estimate:
        """An estimate in percent of travel as one in percent of OP."""
        if estimate.value is None and estimate.at_least is None:
            return estimate
        scale = 1.0 / abs(self.slope)
        wider = 1.0
        if not self.slope_known:
            wider = SLOPE_UNKNOWN if is_jump else S_BY_SLOPE
        low, high = estimate.low, estimate.high
        return replace(
            estimate,
            value=None if estimate.value is None else scale * estimate.value,
            low=None if low is None else scale * low / wider,
            high=None if high is None else scale * high * wider,
        )

    def reaching(self, low: float, high: float) -> StrokeCurve:
        """The curve extended in a straight line to OP ``low`` and ``high`` where it ends before."""
        op, travel = np.array(self.op), np.array(self.travel)
        new_ends = np.array([end for end in (low, high) if not op[0] <= end <= op[-1]])
        if not new_ends.size:
            return self
        slopes = np.diff(travel)[[0, -1]] / np.diff(op)[[0, -1]]
        further = np.where(
            new_ends < op[0],
            travel[0] + slopes[0] * (new_ends - op[0]),
            travel[-1] + slopes[1] * (new_ends - op[-1]),
        )
        order = np.argsort(knots := np.concatenate((op, new_ends)))
        moved = np.concatenate((travel, further))[order]
        return replace(self, op=tuple(knots[order].tolist()), travel=tuple(moved.tolist()))

    @property
    def ends(self) -> tuple[float, float, float, float]:
        """OP and travel where the part of OP that was used begins, and where it ends, percent."""
        if self.used is not None:
            begin, end = self.command(np.array(self.used)).tolist()
            if abs(end - begin) >= LEAST_TRAVEL_PERCENT:
                return self.used[0], begin, self.used[1], end
        return self.op[0], self.travel[0], self.op[-1], self.travel[-1]

    @property
    def slope(self) -> float:
        """Percent of travel for a percent of OP, over the part of OP that was used; signed."""
        begin, low, end, high = self.ends
        return (high - low) / (end - begin)

    @property
    def zero(self) -> float:
        """Where the chord meets OP 0 %, percent of travel."""
        begin, low, _, _ = self.ends
        return low - self.slope * begin

    @property
    def bend_percent(self) -> float:
        """How far the curve lies off its chord at most, percent of travel."""
        begin, _, end, _ = self.ends
        knots = np.array(self.op)
        knots = np.concatenate(([begin, end], knots[(knots > begin) & (knots < end)]))
        return float(np.max(np.abs(self.command(knots) - self.zero - self.slope * knots)))

    @property
    def unsure_degree(self) -> int:
        """Degree of the polynomial by which the curve may be off: 0 where a person gave the curve,
        or where its slope is not known.
        """
        if self.given or not self.slope_known:
            return 0
        return 1 if self.bend_percent < STRAIGHT_PERCENT else BENT_DEGREE

    def sentence(self) -> str:
        """The curve in words: ends, bend, way, who gave it, and the remark."""
        turned = REVERSED if self.slope < 0.0 else ""
        source = "The plant file gives this curve." if self.given else ""
        return " ".join(filter(None, (self._shape(), turned, source, self.remark)))

    def proposal(self) -> str:
        """The line of the plant file that gives this curve, or nothing where it is given already,
        is not known well enough, or is none that a valve has (``curve_of_points``)."""
        if self.given or not self.slope_known:
            return ""
        points = points_of(self)
        try:
            curve_of_points(points)
        except ValueError:  # one such line, and a plant file is not read at all
            return ""
        return f'stroke_curve = "{points}"'

    def _shape(self) -> str:
        begin, low, end, high = self.ends
        sentence = (
            f"OP {begin:.0f} to {end:.0f} % brings the position from {low:.0f} to {high:.0f} %"
        )
        if self.bend_percent > NEARLY_LINEAR_PERCENT:
            return f"{sentence}, bent by up to {self.bend_percent:.1f} % of travel."
        if not self.slope_known:
            return (
                f"{sentence}; it moved between so few places that the curve's slope is not known."
            )
        if abs(self.zero) <= FROM_ZERO_PERCENT and OTHER_UNIT[0] < self.slope < OTHER_UNIT[1]:
            return (
                f"{sentence}, nearly linear, and so to {100.0 * self.slope:.0f} at 100 %: as a "
                "position in degrees or mm reads that is taken as percent (give its values at 0 % "
                "and 100 %, low and high, in the plant file), or one of a valve that is set to a "
                "part of its stroke."
            )
        first = begin - low / self.slope
        first, last = _round(first), _round(first + 100.0 / self.slope)
        return (
            f"{sentence}, nearly linear: as if OP {first:.0f} to {last:.0f} % stroked 0 to 100 %."
        )


@dataclass(frozen=True)
class KnownCurve:
    """The curve from OP to stroke that is known before a recording is analysed.

    ``curve`` is ``None`` where OP is percent for percent of travel. ``given`` by a person; else it
    was found in an earlier window of the valve.
    """

    curve: StrokeCurve | None
    given: bool = False


POINTS_EXPECTED = (
    'points "OP:travel" in percent with spaces between them, such as "50:0 75:42 100:100": '
    "OP rising, travel only rising or only falling"
)
_POINT = re.compile(r"(-?\d+(?:[.,]\d+)?):(-?\d+(?:[.,]\d+)?)")
WITHIN_PERCENT = (-20.0, 120.0)


def curve_of_points(text: str) -> StrokeCurve | None:
    """The curve through points such as ``50:0 75:42 100:100``, OP and travel in percent.

    ``None`` where OP is percent for percent of travel by these points. Raises ``ValueError`` with a
    sentence on what is wrong.
    """
    points: list[tuple[float, float]] = []
    for word in text.split():
        match = _POINT.fullmatch(word)
        if match is None:
            raise ValueError(f"{word!r} is no point")
        points.append((float(match[1].replace(",", ".")), float(match[2].replace(",", "."))))
    if len(points) < 2:
        raise ValueError(f"{len(points)} points; a curve has two at least")
    for (before, travel_reached), (after, further) in pairwise(points):
        if after <= before:
            raise ValueError(f"OP {after:g} after OP {before:g}")
        if (further - travel_reached) * (points[-1][1] - points[0][1]) < 0.0:
            raise ValueError(f"travel {further:g} after {travel_reached:g}, so that it turns round")
    for number in (number for point in points for number in point):
        if not WITHIN_PERCENT[0] <= number <= WITHIN_PERCENT[1]:
            raise ValueError(f"{number:g}, which is no percent")
    op, travel = tuple(point[0] for point in points), tuple(point[1] for point in points)
    if abs(travel[-1] - travel[0]) < LEAST_TRAVEL_PERCENT:
        raise ValueError("a curve that does not move the valve")
    return None if op == travel else StrokeCurve(op=op, travel=travel)


def points_of(curve: StrokeCurve) -> str:
    """The curve as a person writes it, ``50:0 75:42 100:100``, within ``POINTS_OFF_PERCENT``.

    Beyond the part that was used it is extended in a straight line to the end of OP or travel.
    """
    if curve.used is not None:
        curve = curve.reaching(_travel_at_end(curve, 0), _travel_at_end(curve, -1))
    op, travel = np.array(curve.op), np.array(curve.travel)
    chosen = {0, op.size - 1}
    while len(chosen) < op.size:
        places = sorted(chosen)
        deviation = np.abs(travel - np.interp(op, op[places], travel[places]))
        if deviation.max() <= POINTS_OFF_PERCENT:
            break
        chosen.add(int(np.argmax(deviation)))
    return " ".join(f"{_tenth(op[index])}:{_tenth(travel[index])}" for index in sorted(chosen))


def _tenth(percent: float) -> str:
    return f"{round(percent, 1) + 0.0:g}"


def _travel_at_end(curve: StrokeCurve, edge: int) -> float:
    """OP, 0 to 100 %, at which the line beyond an edge (0 or -1) of the curve meets 0 or 100 % of
    travel."""
    op, travel, inner = curve.op[edge], curve.travel[edge], 1 if edge == 0 else -2
    slope = (travel - curve.travel[inner]) / (op - curve.op[inner])
    if slope == 0.0:
        return op
    end = 100.0 if (slope > 0.0) == (edge == -1) else 0.0
    return min(max(op + (end - travel) / slope, 0.0), 100.0)


def _round(op: float) -> float:
    """``op``, or the nearest multiple of 5 % where that is within 1 %."""
    rounded = ROUND_PERCENT * round(op / ROUND_PERCENT)
    return rounded if abs(op - rounded) <= NOT_TOLD_PERCENT else op


def shapes_of(op: Floats, knots: Floats, degree: int) -> Floats:
    """(n, degree + 1) Legendre polynomials of ``op`` (n,) over the part of it that was used, by
    the percentiles of ``knots``; straight beyond."""
    low, high = np.percentile(knots, USED)
    scaled = 2.0 * (op - low) / max(high - low, 1e-9) - 1.0
    clipped = np.clip(scaled, -1.0, 1.0)
    order = np.arange(degree + 1)
    # P_n'(1) = n (n + 1) / 2, and (-1)^(n - 1) times as much at -1.
    steep = order * (order + 1) / 2.0 * np.where(clipped[:, None] < 0.0, (-1.0) ** (order - 1), 1.0)
    excess = np.where(np.isfinite(scaled), scaled - clipped, 0.0)
    return np.asarray(np.polynomial.legendre.legvander(clipped, degree) + excess[:, None] * steep)


def with_command(recording: Recording, command: Floats, mv_unit: str | None = None) -> Recording:
    """``recording`` with ``command`` (n,) in place of OP's values."""
    signals = dict(recording.signals)
    op = signals[Role.OP]
    signals[Role.OP] = Signal(
        command, op.quality, op.tag, op.unit, op.interval_s, deviation=op.deviation
    )
    if mv_unit is not None:
        signals[Role.MV] = replace(signals[Role.MV], unit=mv_unit)
    return replace(recording, signals=signals)


def in_travel(recording: Recording, curve: StrokeCurve | None) -> Recording:
    """``recording`` with OP replaced by the command in percent of travel; unchanged where there is
    no curve.
    """
    if curve is None:
        return recording
    return with_command(recording, curve.command(recording.op.values))
