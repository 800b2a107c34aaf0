"""The inner friction of a spring or diaphragm: elements that give way one after the other.

Layers that rub on each other, or rubber and cloth, hold back a turn like elastic elements in
parallel, each of which slips at its limit (Iwan 1966, doi:10.1115/1.3625199). An element of reach
``r`` is anchored at ``a``, which the stem drags along: ``a = min(max(a, x - r), x + r)``. At the
place ``x`` the three of them hold back

    H/3 * sum of (x - a_i)/r_i,   r_i = w/4, w/2 and w,

from ``-H`` to ``H`` percent of span. After a turn the first slips once the stem has gone back by
``w/2``, the last by ``2 w``. What noise does to ``x`` inside of an element's reach leaves no trace,
and small loops close.
"""

from __future__ import annotations

import numpy as np

from stemwatch.models.mismatch.stem_model.lanes import never_raises
from stemwatch.models.recording import Floats

REACHES = 0.25, 0.5, 1.0  # of the elements, in ways ``w``
Anchors = tuple[float, float, float]  # of the elements, percent of travel


@never_raises
def dragged(anchor: float, x: float, way: float, reach: float) -> float:
    """Where the ``anchor`` of an element is with the stem at ``x``; ``reach`` in ways."""
    return min(max(anchor, x - reach * way), x + reach * way)


@never_raises
def first_anchor(x: float, way: float, reach: float, share: float) -> float:
    """Where an element is anchored that holds back a ``share`` of what it can, -1 to 1, with the
    stem at ``x``. What a stem at rest was doing before a record begins shows in the force on it: it
    lags behind the command by friction and spring together, and each has its share."""
    return x - share * reach * way


@never_raises
def anchor_at(spring: Floats, place: float, way: float, share: float) -> None:
    """Write the anchors of elements that hold back a ``share`` at a ``place``, and the place, to
    ``spring`` (4,)."""
    for i in range(3):
        spring[i] = first_anchor(place, way, REACHES[i], share)
    spring[3] = place


@never_raises
def drag_to(spring: Floats, place: float, way: float) -> None:
    """Drag the anchors of ``spring`` (4,) to a new ``place``, unless that is NaN."""
    if not np.isnan(place):
        for i in range(3):
            spring[i] = dragged(spring[i], place, way, REACHES[i])
        spring[3] = place


@never_raises
def held_back(anchors: Anchors, x: float, way: float) -> float:
    """The share of ``H`` that is held back at ``x``, -1 to 1, by elements whose anchors were
    dragged along."""
    short, middle, long = anchors
    shares = (x - short) / REACHES[0] + (x - middle) / REACHES[1] + (x - long) / REACHES[2]
    return shares / (3.0 * way)


@never_raises
def way_through(
    anchors: Anchors, x: float, side: float, gap: float, hysteresis: float, way: float
) -> float:
    """How far a stem at ``x`` goes to one ``side`` until spring and inner friction have closed a
    ``gap``, percent: ``u + H/3 * sum of min(u, r_i - side (x - a_i))/r_i = gap``.

    By Newton's method from below, which ends after at most one step for each element.
    """
    u, each = 0.0, hysteresis / (3.0 * way)
    for _ in range(4):
        slope, closed = 1.0, 0.0
        for i in range(3):
            room = REACHES[i] * way - side * (x - anchors[i])
            if room > u:
                slope += each / REACHES[i]
            else:
                closed += each / REACHES[i] * max(room, 0.0)
        before, u = u, (gap - closed) / slope
        if u == before:
            break
    return u
