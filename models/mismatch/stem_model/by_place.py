"""What depends on the place of a stem: friction and force by tables over the travel, the inner
friction of a spring that it drags along, and how far it slides against them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.mismatch.stem_model import lane_rows as row
from stemwatch.models.mismatch.stem_model import stem as stem_number
from stemwatch.models.mismatch.stem_model.inner_friction import (
    REACHES,
    dragged,
    first_anchor,
    held_back,
    way_through,
)
from stemwatch.models.mismatch.stem_model.lanes import never_raises
from stemwatch.models.recording import Floats

_ROUNDING = 1e-9  # percent; a smaller step of the force is a held command
# A stem that drags towards its end of travel never quite arrives; below this speed it stands.
_STANDS_BELOW = 0.01  # percent per second
_HYSTERESIS, _WAY = stem_number.HYSTERESIS, stem_number.WAY
_ALMOST = 0.99  # of a level: rounding does not let a stem go below it
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
def share_and_least(dt: float, drag_s: float, restick: float, slope: float) -> tuple[float, float]:
    """The share of the gap that a stem covers in a sample, and the gap below which it sticks; with
    a negative speed of sticking again only a turn stops it. Drag and speed as in ``stem``.

    A force that rises by ``slope`` over a percent of travel closes the gap on the way, as a stiffer
    spring would: it comes to rest after ``gap / (1 + slope)``.
    """
    stiffness = max(1.0 + slope, _SOFTEST)
    drags = drag_s > 1e-3
    share = 1.0 - np.exp(-dt * stiffness / drag_s) if drags else 1.0
    share /= stiffness
    if restick < 0.0:
        return share, -_ROUNDING
    speed = max(restick, _STANDS_BELOW if drags else 0.0)
    return share, max(speed * dt / share, _ROUNDING)


@never_raises
def look_up(
    s: Floats,
    numbers: Floats,
    placed: NDArray[np.int64],
    friction: Floats,
    force: Floats,
    sample: tuple[float, int, np.uint64],
    at_rest: np.uint64,
    least_share: float,
    forces: Floats,
) -> None:
    """Friction and force by place, of those lanes ``placed`` that moved, and how far they slide.

    ``sample``: the interval, its number, and where the ``forces`` at it begin. Stems rest where the
    row ``at_rest`` is 0, and hold there up to ``least_share`` of their levels at least: how far
    those slide that hold, on a spring with inner friction, is not asked.
    """
    dt, k, o = sample
    # By index and number by number: an iterator, and a view of a row, would be counted as a
    # reference at every sample.
    for place in range(placed.size):
        lane, slope = placed[place], 0.0
        i, spring = np.uint64(lane), (numbers[lane, _HYSTERESIS], numbers[lane, _WAY])
        x = s[row.X + i]
        moved = x != s[row.LOOKED_UP_AT + i]
        if moved:
            s[row.LOOKED_UP_AT + i] = x
            s[row.FRICTION + i] = table_value(friction, lane, x)
            s[row.FORCE + i] = table_value(force, lane, x)
        asked = moved
        if spring[0] != 0.0:
            if moved:
                s[row.FORCE + i] += _drag_anchors(s, i, spring, x)
            f = forces[o + i] - x - s[row.FORCE + i]
            least = least_share * _lower_level(s, i, k)
            rest_tells = numbers[lane, stem_number.BY_REST] != 0.0
            asked = s[at_rest + i] != 0.0 or rest_tells or abs(f) >= _ALMOST * least
            slope = _stiffened(s, i, spring, f) if asked else 0.0
        if asked:
            slope += table_slope(force, lane, x)
            drag_s, restick = numbers[lane, stem_number.DRAG_S], numbers[lane, stem_number.RESTICK]
            s[row.SHARE + i], s[row.LEAST_GAP + i] = share_and_least(dt, drag_s, restick, slope)


@never_raises
def _lower_level(s: Floats, i: np.uint64, k: int) -> float:
    """The lower of the two levels at which lane ``i`` lets go at sample ``k``, but for what its
    rest adds, percent."""
    jump = s[row.HALF_J + i] * (1.0 - abs(s[row.ASYMMETRY + i]))
    level: float = (s[row.HALF_S + i] + jump) * (1.0 + s[row.GROWTH + i] * k) + s[row.FRICTION + i]
    return level


@never_raises
def anchor(s: Floats, i: np.uint64, way: float, x: float, share: float) -> None:
    """Anchor the spring's elements of lane ``i``, set to its place ``x``, so that they hold back a
    ``share`` of what they can, -1 to 1."""
    s[row.SHORT_ANCHOR + i] = first_anchor(x, way, REACHES[0], share)
    s[row.MIDDLE_ANCHOR + i] = first_anchor(x, way, REACHES[1], share)
    s[row.LONG_ANCHOR + i] = first_anchor(x, way, REACHES[2], share)
    s[row.LOOKED_UP_AT + i] = np.nan


@never_raises
def _drag_anchors(s: Floats, i: np.uint64, spring: tuple[float, float], x: float) -> float:
    """Move the anchors of lane ``i`` to its place ``x``; returns the force of its spring's inner
    friction there. ``spring``: hysteresis and way."""
    hysteresis, way = spring
    short = dragged(s[row.SHORT_ANCHOR + i], x, way, REACHES[0])
    middle = dragged(s[row.MIDDLE_ANCHOR + i], x, way, REACHES[1])
    long = dragged(s[row.LONG_ANCHOR + i], x, way, REACHES[2])
    s[row.SHORT_ANCHOR + i], s[row.MIDDLE_ANCHOR + i] = short, middle
    s[row.LONG_ANCHOR + i] = long
    force: float = hysteresis * held_back((short, middle, long), x, way)
    return force


@never_raises
def _stiffened(s: Floats, i: np.uint64, spring: tuple[float, float], f: float) -> float:
    """The mean rise of the inner friction of lane ``i`` over a percent of the travel by which the
    force ``f`` on the stem slides it; 0 where it does not."""
    gap = abs(f) - (s[row.HALF_S + i] - s[row.HALF_J + i])
    if gap <= 0.0:
        return 0.0
    anchors = s[row.SHORT_ANCHOR + i], s[row.MIDDLE_ANCHOR + i], s[row.LONG_ANCHOR + i]
    side, (hysteresis, way) = 1.0 if f > 0.0 else -1.0, spring
    slides = way_through(anchors, s[row.X + i], side, gap, hysteresis, way)
    rise: float = gap / slides - 1.0
    return rise
