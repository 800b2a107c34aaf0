"""What depends on the place of a stem: friction and force by tables over the travel, the inner
friction of a spring that it drags along, and how far it slides against them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.mismatch import lane_rows as row
from stemwatch.models.mismatch import stem as stem_number
from stemwatch.models.mismatch.inner_friction import (
    REACHES,
    dragged,
    first_anchor,
    held_back,
    way_through,
)
from stemwatch.models.mismatch.lanes import never_raises
from stemwatch.models.recording import Floats

_ROUNDING = 1e-9  # percent; a smaller step of the force is a held command
# A stem that drags towards its end of travel never quite arrives; below this speed it stands.
_STANDS_BELOW = 0.01  # percent per second
_SOFTEST = 0.5  # least rise of spring and force together over a percent of travel, percent


@never_raises
def table_value(tables: Floats, lane: int, x: float) -> float:
    """The table of ``lane`` at place ``x``, linear between its entries and constant beyond."""
    table_place = (x - stem_number.PLACE_LOW) * (
        (stem_number.PLACES - 1) / (stem_number.PLACE_HIGH - stem_number.PLACE_LOW)
    )
    table_place = min(max(table_place, 0.0), stem_number.PLACES - 1.000001)
    i = int(table_place)
    value_here, value_next = tables[lane, i], tables[lane, i + 1]
    value: float = value_here + (table_place - i) * (value_next - value_here)
    return value


@never_raises
def table_slope(tables: Floats, lane: int, x: float) -> float:
    """The rise of the table of ``lane`` over a percent of travel at place ``x``."""
    table_place = (x - stem_number.PLACE_LOW) * (
        (stem_number.PLACES - 1) / (stem_number.PLACE_HIGH - stem_number.PLACE_LOW)
    )
    i = int(min(max(table_place, 0.0), stem_number.PLACES - 1.000001))
    rise: float = tables[lane, i + 1] - tables[lane, i]
    return rise * ((stem_number.PLACES - 1) / (stem_number.PLACE_HIGH - stem_number.PLACE_LOW))


@never_raises
def share_and_least(dt: float, q: Floats, slope: float) -> tuple[float, float]:
    """The share of the gap that a stem covers in a sample, and the gap below which it sticks; with
    a negative one only a turn stops it.

    A force that rises by ``slope`` over a percent of travel closes the gap on the way, as a stiffer
    spring would: it comes to rest after ``gap / (1 + slope)``.
    """
    stiffness = max(1.0 + slope, _SOFTEST)
    drags = q[stem_number.DRAG_S] > 1e-3
    share = 1.0 - np.exp(-dt * stiffness / q[stem_number.DRAG_S]) if drags else 1.0
    share /= stiffness
    if q[stem_number.RESTICK] < 0.0:
        return share, -_ROUNDING
    speed = max(q[stem_number.RESTICK], _STANDS_BELOW if drags else 0.0)
    return share, max(speed * dt / share, _ROUNDING)


@never_raises
def look_up(
    s: Floats,
    numbers: Floats,
    placed: NDArray[np.int64],
    friction: Floats,
    force: Floats,
    dt: float,
    forces: Floats,
) -> None:
    """Friction and force by place, of those lanes ``placed`` that moved, and how far they slide.

    ``forces`` (lanes,) at this sample.
    """
    for lane in placed:
        i, q = np.uint64(lane), numbers[lane]
        x, springs = s[row.X + i], q[stem_number.HYSTERESIS] != 0.0
        moved = x != s[row.LOOKED_UP_AT + i]
        if moved:
            s[row.LOOKED_UP_AT + i] = x
            s[row.FRICTION + i] = table_value(friction, lane, x)
            s[row.FORCE + i] = table_value(force, lane, x)
            if springs:
                s[row.FORCE + i] += _drag_anchors(s, i, q, x)
        if moved or springs:
            slope = table_slope(force, lane, x)
            if springs:
                slope += _stiffened(s, i, q, forces[lane] - x - s[row.FORCE + i])
            s[row.SHARE + i], s[row.LEAST_GAP + i] = share_and_least(dt, q, slope)


@never_raises
def anchor(s: Floats, i: np.uint64, q: Floats, x: float, share: float) -> None:
    """Anchor the spring's elements of lane ``i``, set to its place ``x``, so that they hold back a
    ``share`` of what they can, -1 to 1."""
    way = q[stem_number.WAY]
    s[row.SHORT_ANCHOR + i] = first_anchor(x, way, REACHES[0], share)
    s[row.MIDDLE_ANCHOR + i] = first_anchor(x, way, REACHES[1], share)
    s[row.LONG_ANCHOR + i] = first_anchor(x, way, REACHES[2], share)
    s[row.LOOKED_UP_AT + i] = np.nan


@never_raises
def _drag_anchors(s: Floats, i: np.uint64, q: Floats, x: float) -> float:
    """Move the anchors of lane ``i`` to its place ``x``; returns the force of its spring's inner
    friction there."""
    way = q[stem_number.WAY]
    short = dragged(s[row.SHORT_ANCHOR + i], x, way, REACHES[0])
    middle = dragged(s[row.MIDDLE_ANCHOR + i], x, way, REACHES[1])
    long = dragged(s[row.LONG_ANCHOR + i], x, way, REACHES[2])
    s[row.SHORT_ANCHOR + i], s[row.MIDDLE_ANCHOR + i] = short, middle
    s[row.LONG_ANCHOR + i] = long
    force: float = q[stem_number.HYSTERESIS] * held_back((short, middle, long), x, way)
    return force


@never_raises
def _stiffened(s: Floats, i: np.uint64, q: Floats, f: float) -> float:
    """The mean rise of the inner friction of lane ``i`` over a percent of the travel by which the
    force ``f`` on the stem slides it; 0 where it does not."""
    gap = abs(f) - (s[row.HALF_S + i] - s[row.HALF_J + i])
    if gap <= 0.0:
        return 0.0
    anchors = s[row.SHORT_ANCHOR + i], s[row.MIDDLE_ANCHOR + i], s[row.LONG_ANCHOR + i]
    side, hysteresis = 1.0 if f > 0.0 else -1.0, q[stem_number.HYSTERESIS]
    slides = way_through(anchors, s[row.X + i], side, gap, hysteresis, q[stem_number.WAY])
    rise: float = gap / slides - 1.0
    return rise
