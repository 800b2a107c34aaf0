"""The courses that a stem may have taken, side by side: where each stands, what may become of it in
a sample, and which of them are kept.

A course that has stuck rests until it lets go, with a probability of its own at each sample; a
moving one goes on or sticks (``breakaway_filter`` has the formulas). So one course becomes up to
three in a sample. Those that have become alike are joined, and the most probable are kept.
"""

from __future__ import annotations

from typing import cast

import numpy as np

from stemwatch.models.mismatch.stem_model import stem as stem_number
from stemwatch.models.mismatch.stem_model.by_place import share_and_least, table_slope, table_value
from stemwatch.models.mismatch.stem_model.inner_friction import (
    anchor_at,
    held_back,
    way_through,
)
from stemwatch.models.mismatch.stem_model.lanes import never_raises
from stemwatch.models.mismatch.stem_model.presliding import given_way
from stemwatch.models.recording import Floats

CHILDREN = 4  # places for those of a course in a sample: it goes on, rests, lets go
LEAST_SHARE = 2e-6  # of the most probable course; less is let go
_LEAST_CHANCE = 1e-4  # at which a stem is let go or stuck
SOONEST = 8.0  # scatters below its level, up to which a stem lets go
_LEAST_LEVEL = 1e-3  # percent
# Places are unsigned, so that compiled code need not look for negative ones.
U = cast("type[int]", np.uint64)
INT = cast("type[int]", np.int64)  # a plain 0 that is handed on is compiled for twice
ONE = U(1)
MOST_COURSES = 48  # that can be kept
# Places of a row: two halves, each with what may become of all courses, and a vector. Rows that lie
# a whole page apart would push each other out of the processor's cache.
_WIDTH = 408
# Courses that the processor takes at once, or in two parts: what is left over of the widest vectors
# would run one by one.
_VECTOR = 8
# Rows of the courses: place, place that is read, side of its motion or 0 at rest, samples that it
# has rested, the largest shares of its levels that were asked for, how probably a stem holds there,
# its probability.
#
# From tables: friction and force at its place, what its rest adds to the levels, the share of its
# gap that it covers in a sample, the fourth power of the gap at which it sticks.
#
# What may become of it: the probability that it goes on, and to where; that it lets go, and to
# where; the share of its breakaway level that the force reaches; the probability that a stem holds
# there, and how far it creeps if it rests.
(
    X,
    Z,
    GOING,
    RESTED,
    ASKED_UP,
    ASKED_DOWN,
    HELD_UP,
    HELD_DOWN,
    WEIGHT,
    FRICTION,
    PUSHED,
    RISE,
    SHARE,
    LEAST4,
    GOES_ON,
    ON_TO,
    LETS_GO,
    OFF_TO,
    ASKED,
    HOLDS,
    CREEPS,
) = (U(row * _WIDTH) for row in range(21))
_ROWS = 21
_STATE = (X, Z, GOING, RESTED, ASKED_UP, ASKED_DOWN, HELD_UP, HELD_DOWN)


@never_raises
def above(z: float) -> float:
    """The probability that Student's variable of four degrees of freedom is above ``z``:
    ``(1 - u)^2 (2 + u)/4``, ``u = z/sqrt(z^2 + 4)``, written so that small ones keep their digits.
    """
    root = np.sqrt(z * z + 4.0)
    rest = 4.0 / (root * (root + abs(z)))  # 1 - |u|
    rest = rest if z >= 0.0 else 2.0 - rest
    tail: float = 0.25 * rest * rest * (3.0 - rest)
    return tail


@never_raises
def goes_on(gap: float, least4: float) -> float:
    """The probability that a moving stem does not stick at this ``gap``, percent; ``least4`` is the
    fourth power of the gap at which the model's sticks."""
    fourth = gap * gap * gap * gap
    chance = fourth / (fourth + least4)
    chance = 0.0 if gap <= 0.0 or chance < _LEAST_CHANCE else chance
    return chance if chance < 1.0 - _LEAST_CHANCE else 1.0


@never_raises
def _add(
    s: Floats,
    m: int,
    q: Floats,
    state: tuple[float, float, float, float],
    weight: float,
) -> int:
    """Add a course that has just stuck or let go at a new place, within the stops; returns how many
    there are. ``state``: its place, the place that was read, motion and rest.
    """
    place, read, going, rested = state
    half = 0.5 * q[stem_number.PLAY]
    place = min(max(place, q[stem_number.STOP_LOW]), q[stem_number.STOP_HIGH])
    s[X + m], s[Z + m] = place, min(max(read, place - half), place + half)
    s[GOING + m], s[RESTED + m] = going, rested
    s[ASKED_UP + m], s[ASKED_DOWN + m] = 0.0, 0.0
    s[HELD_UP + m], s[HELD_DOWN + m] = 1.0, 1.0
    s[WEIGHT + m] = weight
    return m + ONE


@never_raises
def _share_and_least(dt: float, q: Floats, slope: float) -> tuple[float, float]:
    """``share_and_least`` of a stem where its force rises by ``slope`` over a percent of travel."""
    return share_and_least(dt, q[stem_number.DRAG_S], q[stem_number.RESTICK], slope)


@never_raises
def no_courses(dt: float, q: Floats) -> tuple[Floats, tuple[float, float]]:
    """Rows without courses, and of a stem without tables the share of its gap that it covers in a
    sample and the fourth power of the gap at which it sticks."""
    s, (share, least) = np.zeros(_ROWS * _WIDTH), _share_and_least(dt, q, 0.0)
    for place in range(U(_WIDTH)):
        s[SHARE + place], s[LEAST4 + place] = share, least * least * least * least
    return s, (share, least * least * least * least)


@never_raises
def begin(s: Floats, c: int, q: Floats, place: float, force: float, grown: float) -> int:
    """One course ``c`` at rest at the ``place`` that was read, within the band that its force
    allows.
    """
    band = 0.5 * abs(q[stem_number.S] + q[stem_number.J]) * grown + 0.5 * q[stem_number.PLAY]
    place = min(max(place, force - band), force + band)
    return _add(s, c, q, (place, place, 0.0, 0.0), 1.0)


@never_raises
def begin_spring(s: Floats, c: int, q: Floats, force: float, grown: float, spring: Floats) -> None:
    """Anchor the spring's elements of course ``c``, which has just begun at its place."""
    hysteresis, way, place = q[stem_number.HYSTERESIS], q[stem_number.WAY], s[X + c]
    band = 0.5 * abs(q[stem_number.S] + q[stem_number.J]) * grown + 0.5 * q[stem_number.PLAY]
    share = min(max((force - place) / (band + hysteresis + _LEAST_LEVEL), -1.0), 1.0)
    anchor_at(spring, place, way, share)
    s[X + c] += hysteresis * share
    s[Z + c] += hysteresis * share


@never_raises
def held_by_spring(s: Floats, span: tuple[int, int], q: Floats, spring: Floats) -> int:
    """Write where the courses of a ``span`` stand with what the spring's inner friction holds back
    after the readings so far, and return the row.

    A course is that of ``x + H h``, which is what the command moves; ``spring`` (4,) are the
    anchors of the elements and the last place.
    """
    hysteresis, way, last = q[stem_number.HYSTERESIS], q[stem_number.WAY], spring[3]
    anchors = spring[0], spring[1], spring[2]
    moved = last + hysteresis * held_back(anchors, last, way)
    for j in range(span[0], span[1]):
        gap = s[Z + j] - moved
        side = 1.0 if gap > 0.0 else -1.0
        s[OFF_TO + j] = last + side * way_through(anchors, last, side, abs(gap), hysteresis, way)
    return OFF_TO


@never_raises
def look_up_levels(
    s: Floats,
    span: tuple[int, int],
    q: Floats,
    friction: Floats,
    pushing: Floats,
    breakaway: Floats,
) -> None:
    """Write what the tables say of the force on the courses of a ``span``, and of their levels."""
    if q[stem_number.BY_PLACE] != 0.0:
        for i in range(span[0], span[1]):
            x, lane = s[X + i], INT(0)
            s[FRICTION + i] = table_value(friction, lane, x)
            s[PUSHED + i] = table_value(pushing, lane, x)
    if q[stem_number.BY_REST] != 0.0:
        for i in range(span[0], span[1]):
            s[RISE + i] = breakaway[0, int(s[RESTED + i])]


@never_raises
def look_up_slides(s: Floats, span: tuple[int, int], q: Floats, pushing: Floats, dt: float) -> None:
    """Write how the courses of a ``span`` slide where a force depends on their place."""
    if q[stem_number.BY_PLACE] != 0.0:
        for i in range(span[0], span[1]):
            share, least = _share_and_least(dt, q, table_slope(pushing, INT(0), s[X + i]))
            s[SHARE + i], s[LEAST4 + i] = share, least * least * least * least


@never_raises
def weigh_chances(
    s: Floats,
    span: tuple[int, int],
    q: Floats,
    moved: tuple[float, float, float, float],
) -> None:
    """Write how probably the courses of a ``span`` go on and let go in a sample, and where to.

    ``moved``: the command, how far friction has grown, the scatter, and how far below its level a
    stem lets go at the speed of the command, percent, but no lower than the kinetic one. Courses
    side by side, for the vectors of the processor; what is beyond the span in the last vector means
    nothing.
    """
    command, grown, scatter, sooner = moved
    usual, jump = 0.5 * q[stem_number.S] * grown, 0.5 * q[stem_number.J] * grown
    jump_up = jump * (1.0 + q[stem_number.ASYMMETRY])
    jump_down = jump * (1.0 - q[stem_number.ASYMMETRY])
    surely, per_scatter = 1.0 - SOONEST * scatter, 1.0 / scatter
    for i in range(span[0], span[0] + whole_vectors(span)):
        up, down, held_up = s[ASKED_UP + i], s[ASKED_DOWN + i], s[HELD_UP + i]
        x, going, share = s[X + i], s[GOING + i], s[SHARE + i]
        level, f = usual + s[FRICTION + i], command - x - s[PUSHED + i]
        gap = going * f - (level - (jump_up if going > 0.0 else jump_down))
        s[GOES_ON + i] = goes_on(gap, s[LEAST4 + i]) if going != 0.0 else 0.0
        s[ON_TO + i] = x + share * going * gap
        # At rest only the level on the side of the force can be reached.
        rises = f >= 0.0
        side, jumps = 1.0 if rises else -1.0, jump_up if rises else jump_down
        before, held = up if rises else down, held_up if rises else s[HELD_DOWN + i]
        highest = level + jumps - min(sooner, 2.0 * jumps) + s[RISE + i]
        highest = max(highest, _LEAST_LEVEL)
        asked = side * f / highest
        holds = above((asked - 1.0) * per_scatter)
        farther = asked > max(before, surely)
        holds = holds if farther else held
        s[LETS_GO + i], s[HOLDS + i] = 1.0 - holds / held, holds
        s[ASKED + i] = asked if farther else before
        s[OFF_TO + i] = x + share * side * max(side * f - (level - jumps), 0.0)


@never_raises
def give_way(
    s: Floats, span: tuple[int, int], q: Floats, forces: tuple[float, float, float], crept: float
) -> None:
    """Write how far the courses of a ``span`` creep in a sample if they rest: by what they give way
    to the change of the force, and by what they have ``crept`` anyhow. ``forces``: the command of
    the sample before and of this one, and how far friction has grown.
    """
    before, command, grown = forces
    usual = 0.5 * (q[stem_number.S] + q[stem_number.J]) * grown
    for i in range(span[0], span[1] if q[stem_number.GIVES] > 0.0 else span[0]):
        place, level = s[X + i] + s[PUSHED + i], usual + s[FRICTION + i]
        way = given_way(before - place, command - place, level, q[stem_number.GIVES])
        s[CREEPS + i] = crept + way


@never_raises
def whole_vectors(span: tuple[int, int]) -> int:
    """Places of the whole vectors that hold a ``span``."""
    return (span[1] - span[0] + U(_VECTOR - 1)) >> U(3) << U(3)


@never_raises
def branch(
    s: Floats,
    span: tuple[int, int],
    m: int,
    q: Floats,
    command: float,
    crept: float,
) -> int:
    """Write what may become in a sample of the courses of a ``span`` to places from ``m`` on;
    returns where that ended. ``crept``: how far a stem at rest creeps in a sample, unless it gives
    way to the force (``give_way``).
    """
    gives = q[stem_number.GIVES] > 0.0
    for i in range(span[0], span[1]):
        weight, goes_on, read = s[WEIGHT + i], s[GOES_ON + i], s[Z + i]
        if goes_on > 0.0:
            m = _add(s, m, q, (s[ON_TO + i], read, s[GOING + i], 0.0), weight * goes_on)
        if goes_on == 1.0:
            continue
        weight, lets_go = weight * (1.0 - goes_on), s[LETS_GO + i]
        rises = command - s[X + i] - s[PUSHED + i] >= 0.0
        if 1.0 - lets_go > _LEAST_CHANCE**2:
            rested = s[RESTED + i] + 1.0
            place = s[X + i] + (s[CREEPS + i] if gives else crept)
            m = _add(s, m, q, (place, read, 0.0, rested), weight * (1.0 - lets_go))
            c, asked, holds = m - ONE, s[ASKED + i], s[HOLDS + i]
            s[ASKED_UP + c] = asked if rises else s[ASKED_UP + i]
            s[ASKED_DOWN + c] = s[ASKED_DOWN + i] if rises else asked
            s[HELD_UP + c] = holds if rises else s[HELD_UP + i]
            s[HELD_DOWN + c] = s[HELD_DOWN + i] if rises else holds
        if lets_go > _LEAST_CHANCE:
            side = 1.0 if rises else -1.0
            m = _add(s, m, q, (s[OFF_TO + i], read, side, 0.0), weight * lets_go)
    return m


@never_raises
def levels(q: Floats, friction: float) -> tuple[float, float, float, float]:
    """The breakaway and the sliding levels, rising and falling, of a stem whose levels do not grow,
    neither over the record nor while it rests; ``friction`` is what its place adds."""
    level, jump = 0.5 * q[stem_number.S] + friction, 0.5 * q[stem_number.J]
    jump_up = jump * (1.0 + q[stem_number.ASYMMETRY])
    jump_down = jump * (1.0 - q[stem_number.ASYMMETRY])
    fs_up, fs_down = max(level + jump_up, _LEAST_LEVEL), max(level + jump_down, _LEAST_LEVEL)
    return fs_up, fs_down, level - jump_up, level - jump_down


@never_raises
def surely_held(
    s: Floats, c: int, levels: tuple[float, float], surely: float
) -> tuple[float, float]:
    """The forces up and down to which course ``c``, at rest, holds as it has held before, or below
    the share of its ``levels`` up to which it ``surely`` does."""
    up, down = max(s[ASKED_UP + c], surely), max(s[ASKED_DOWN + c], surely)
    return levels[0] * up, levels[1] * down


@never_raises
def _same(s: Floats, c: int, j: int, place: float, share: float) -> bool:
    """Whether two courses have become one: within a ``place`` and a ``share`` of each other."""
    if abs(s[X + c] - s[X + j]) >= place:
        return False
    if s[GOING + c] != s[GOING + j]:
        return False
    if abs(s[Z + c] - s[Z + j]) >= place:
        return False
    if s[GOING + c] != 0.0:
        return True
    up = abs(s[ASKED_UP + c] - s[ASKED_UP + j])
    return bool(max(up, abs(s[ASKED_DOWN + c] - s[ASKED_DOWN + j])) < share)


@never_raises
def _put(s: Floats, c: int, j: int, weight: float) -> None:
    """Copy course ``j`` to place ``c``, with another weight."""
    if c != j:
        for row in _STATE:
            s[row + c] = s[row + j]
    s[WEIGHT + c] = weight


@never_raises
def keep(
    s: Floats, span: tuple[int, int], place: float, share: float, most: int
) -> tuple[int, bool]:
    """Join those courses of a ``span`` that are alike, to the more probable one, and keep the most
    probable, at its beginning; returns where they end, and whether any were joined.
    """
    (begin, end), least, joined = span, 0.0, False
    for j in range(begin, end):
        least = max(least, s[WEIGHT + j])
    least, count = LEAST_SHARE * least, begin
    for j in range(begin, end):
        weight, c = s[WEIGHT + j], begin
        if weight <= least:
            continue
        while c < count and not _same(s, c, j, place, share):
            c += ONE
        if c == count:
            _put(s, c, j, weight)
            count += ONE
            continue
        joined = True
        if weight > s[WEIGHT + c]:
            _put(s, c, j, weight + s[WEIGHT + c])
        else:
            s[WEIGHT + c] += weight
    while count > begin + most:
        lightest = begin
        for c in range(begin + ONE, count):
            lightest = c if s[WEIGHT + c] < s[WEIGHT + lightest] else lightest
        count -= ONE
        _put(s, lightest, count, s[WEIGHT + count])
    return count, joined


@never_raises
def made_one(s: Floats, span: tuple[int, int]) -> float:
    """Make the probabilities of a ``span`` sum to one; returns the logarithm of their sum, 0 of
    none.
    """
    total = 0.0
    for c in range(span[0], span[1]):
        total += s[WEIGHT + c]
    for c in range(span[0], span[1]):
        s[WEIGHT + c] /= total
    logarithm: float = np.log(total) if total > 0.0 else 0.0
    return logarithm
