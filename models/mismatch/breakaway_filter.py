"""The likelihood of a recording by a stem whose breakaways scatter: a filter over the few courses
that the stem may have taken.

A run of the model lets go where the force has reached its level. A real stem lets go earlier or
later by chance, and behind noise, coarse steps or an archive nobody sees when: such a run is then
wrong for a whole rest, and what an effect changes is lost in that. Here every moment at which it
may have let go is a course of its own, with a probability, and the readings decide between them.

Of each rest the level is ``f_s (1 + s e)``, with ``e`` of Student's distribution of four degrees of
freedom. Where the largest share of ``f_s`` that the force has asked for grows from ``r0`` to ``r``,
the stem holds with the probability ``Q((r - 1)/s) / Q((r0 - 1)/s)``, ``Q(z) = P(e > z)``. A moving
stem whose gap (``stem``) is ``g`` sticks with the probability ``1/(1 + (g/g0)^4)``, ``g0`` the gap
at which the model's sticks. A reading lies about that of the course by the same distribution, of
scale ``sigma`` (Lange, Little and Taylor, 1989, doi:10.1080/01621459.1989.10478852); one in coarse
steps has the probability of its step.

Courses that have become alike are joined, and the most probable are kept, as in the filter of
sums of Alspach and Sorenson (1972, doi:10.1109/TAC.1972.1100034).
"""

from __future__ import annotations

from typing import cast

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.mismatch import stem as stem_number
from stemwatch.models.mismatch.inner_friction import (
    anchor_at,
    drag_to,
    held_back,
    way_through,
)
from stemwatch.models.mismatch.kernel import Record, share_and_least, table_slope, table_value
from stemwatch.models.mismatch.lanes import never_raises
from stemwatch.models.mismatch.stem import Tables
from stemwatch.models.recording import Floats

GIVEN_UP = -1e6  # of a block that was not followed
_CHILDREN = 4  # places for those of a course in a sample: it goes on, rests, lets go
_LEAST_SHARE = 2e-6  # of the most probable course; less is let go
_LEAST_CHANCE = 1e-4  # at which a stem is let go or stuck
_ALIKE_PLACE, _ALIKE_FORCE = 0.3, 0.25  # of sigma and of the scatter: courses that are one
_SOONEST = 8.0  # scatters below its level, up to which a stem lets go
_LEAST_LEVEL = 1e-3  # percent
_LEAST_DENSITY = 1e-200
_SMALL, _LARGE = 1e-90, 1e90  # products beyond these are replaced by their logarithms
_START = 1
# Places are unsigned, so that compiled code need not look for negative ones.
_U = cast("type[int]", np.uint64)
_ONE = _U(1)
MOST_COURSES = 48  # that can be kept
# Places of a row: two halves, each with what may become of all courses, and a vector. Rows that lie
# a whole page apart would push each other out of the processor's cache.
_WIDTH = 408
_VECTOR = 4  # courses that the processor takes at once
# Rows of the courses: place, place that is read, side of its motion or 0 at rest, samples that it
# has rested, the largest shares of its levels that were asked for, how probably a stem holds there,
# its probability.
#
# What tables say of it: friction and force at its place, what its rest adds to the levels, the
# share of its gap that it covers in a sample, the fourth power of the gap at which it sticks.
#
# What may become of it: how probably it goes on and to where, how probably it lets go and to where,
# the share of its level that is asked for, how probably a stem holds there.
(
    _X,
    _Z,
    _GOING,
    _RESTED,
    _ASKED_UP,
    _ASKED_DOWN,
    _HELD_UP,
    _HELD_DOWN,
    _WEIGHT,
    _FRICTION,
    _PUSHED,
    _RISE,
    _SHARE,
    _LEAST4,
    _GOES_ON,
    _ON_TO,
    _LETS_GO,
    _OFF_TO,
    _ASKED,
    _HOLDS,
) = (_U(row * _WIDTH) for row in range(20))
_ROWS = 20
_STATE = (_X, _Z, _GOING, _RESTED, _ASKED_UP, _ASKED_DOWN, _HELD_UP, _HELD_DOWN)
_VARYING = (
    stem_number.BY_PLACE,
    stem_number.BY_REST,
    stem_number.BY_TIME,
    stem_number.GROWTH,
    stem_number.DRIFT,
)


@never_raises
def above(z: float) -> float:
    """The probability that Student's variable of four degrees of freedom is above ``z``."""
    b = 1.0 / (1.0 + 0.25 * z * z)
    tail: float = 0.5 - 0.375 * z * np.sqrt(b) * (1.0 - z * z * b / 12.0)
    return tail


@never_raises
def _in_step(residual: float, step: float, per_sigma: float) -> float:
    """The probability of a reading in a coarse ``step`` that is ``residual`` off."""
    near, far = residual - 0.5 * step, residual + 0.5 * step
    return above(near * per_sigma) - above(far * per_sigma) + _LEAST_DENSITY


@never_raises
def _about(residual: float, per_sigma: float) -> float:
    """The density of a reading that is ``residual`` off."""
    u = residual * per_sigma
    b = 1.0 / (1.0 + 0.25 * u * u)
    density: float = 0.375 * b * b * np.sqrt(b) * per_sigma
    return density


@never_raises
def _density(residual: float, step: float, per_sigma: float) -> float:
    """Of a reading that is ``residual`` off; its probability where readings come in a ``step``."""
    if step > 0.0:
        return _in_step(residual, step, per_sigma)
    return _about(residual, per_sigma)


@never_raises
def _goes_on(gap: float, least4: float) -> float:
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
    s[_X + m], s[_Z + m] = place, min(max(read, place - half), place + half)
    s[_GOING + m], s[_RESTED + m] = going, rested
    s[_ASKED_UP + m], s[_ASKED_DOWN + m] = 0.0, 0.0
    s[_HELD_UP + m], s[_HELD_DOWN + m] = 1.0, 1.0
    s[_WEIGHT + m] = weight
    return m + _ONE


@never_raises
def _no_courses(dt: float, q: Floats) -> tuple[Floats, tuple[float, float]]:
    """Rows without courses, and of a stem without tables the share of its gap that it covers in a
    sample and the fourth power of the gap at which it sticks."""
    s, (share, least) = np.zeros(_ROWS * _WIDTH), share_and_least(dt, q, 0.0)
    for place in range(_U(_WIDTH)):
        s[_SHARE + place], s[_LEAST4 + place] = share, least * least * least * least
    return s, (share, least * least * least * least)


@never_raises
def _begin(s: Floats, c: int, q: Floats, place: float, force: float, grown: float) -> int:
    """One course ``c`` at rest at the ``place`` that was read, within the band that its force
    allows.
    """
    band = 0.5 * abs(q[stem_number.S] + q[stem_number.J]) * grown + 0.5 * q[stem_number.PLAY]
    place = min(max(place, force - band), force + band)
    return _add(s, c, q, (place, place, 0.0, 0.0), 1.0)


@never_raises
def _look_up(
    s: Floats,
    span: tuple[int, int],
    q: Floats,
    friction: Floats,
    pushing: Floats,
    breakaway: Floats,
    dt: float,
) -> None:
    """Write what the tables say of the courses of a ``span``."""
    if q[stem_number.BY_PLACE] != 0.0:
        for i in range(span[0], span[1]):
            x = s[_X + i]
            s[_FRICTION + i] = table_value(friction, 0, x)
            s[_PUSHED + i] = table_value(pushing, 0, x)
            share, least = share_and_least(dt, q, table_slope(pushing, 0, x))
            s[_SHARE + i], s[_LEAST4 + i] = share, least * least * least * least
    if q[stem_number.BY_REST] != 0.0:
        for i in range(span[0], span[1]):
            s[_RISE + i] = breakaway[0, int(s[_RESTED + i])]


@never_raises
def _weigh_chances(
    s: Floats,
    span: tuple[int, int],
    q: Floats,
    moved: tuple[float, float, float],
) -> None:
    """Write how probably the courses of a ``span`` go on and let go in a sample, and where to.

    ``moved``: the command, how far friction has grown, and the scatter. Courses side by side, for
    the vectors of the processor; what is beyond the span in the last vector means nothing.
    """
    command, grown, scatter = moved
    usual, jump = 0.5 * q[stem_number.S] * grown, 0.5 * q[stem_number.J] * grown
    jump_up = jump * (1.0 + q[stem_number.ASYMMETRY])
    jump_down = jump * (1.0 - q[stem_number.ASYMMETRY])
    surely, per_scatter = 1.0 - _SOONEST * scatter, 1.0 / scatter
    for i in range(span[0], span[0] + _whole_vectors(span)):
        up, down, held_up = s[_ASKED_UP + i], s[_ASKED_DOWN + i], s[_HELD_UP + i]
        x, going, share = s[_X + i], s[_GOING + i], s[_SHARE + i]
        level, f = usual + s[_FRICTION + i], command - x - s[_PUSHED + i]
        gap = going * f - (level - (jump_up if going > 0.0 else jump_down))
        s[_GOES_ON + i] = _goes_on(gap, s[_LEAST4 + i]) if going != 0.0 else 0.0
        s[_ON_TO + i] = x + share * going * gap
        # At rest only the level on the side of the force can be reached.
        rises = f >= 0.0
        side, jumps = 1.0 if rises else -1.0, jump_up if rises else jump_down
        before, held = up if rises else down, held_up if rises else s[_HELD_DOWN + i]
        highest = max(level + jumps + s[_RISE + i], _LEAST_LEVEL)
        asked = side * f / highest
        holds = above((asked - 1.0) * per_scatter)
        farther = asked > max(before, surely)
        holds = holds if farther else held
        s[_LETS_GO + i], s[_HOLDS + i] = 1.0 - holds / held, holds
        s[_ASKED + i] = asked if farther else before
        s[_OFF_TO + i] = x + share * side * max(side * f - (level - jumps), 0.0)


@never_raises
def _whole_vectors(span: tuple[int, int]) -> int:
    """Places of the whole vectors that hold a ``span``."""
    return (span[1] - span[0] + _U(_VECTOR - 1)) >> _U(2) << _U(2)


@never_raises
def _branch(
    s: Floats,
    span: tuple[int, int],
    m: int,
    q: Floats,
    command: float,
    crept: float,
) -> int:
    """Write what may become in a sample of the courses of a ``span`` to places from ``m`` on;
    returns where that ended. ``crept``: how far a stem at rest creeps in a sample.
    """
    for i in range(span[0], span[1]):
        weight, goes_on, read = s[_WEIGHT + i], s[_GOES_ON + i], s[_Z + i]
        if goes_on > 0.0:
            m = _add(s, m, q, (s[_ON_TO + i], read, s[_GOING + i], 0.0), weight * goes_on)
        if goes_on == 1.0:
            continue
        weight, lets_go = weight * (1.0 - goes_on), s[_LETS_GO + i]
        rises = command - s[_X + i] - s[_PUSHED + i] >= 0.0
        if 1.0 - lets_go > _LEAST_CHANCE**2:
            rested = s[_RESTED + i] + 1.0
            m = _add(s, m, q, (s[_X + i] + crept, read, 0.0, rested), weight * (1.0 - lets_go))
            c, asked, holds = m - _ONE, s[_ASKED + i], s[_HOLDS + i]
            s[_ASKED_UP + c] = asked if rises else s[_ASKED_UP + i]
            s[_ASKED_DOWN + c] = s[_ASKED_DOWN + i] if rises else asked
            s[_HELD_UP + c] = holds if rises else s[_HELD_UP + i]
            s[_HELD_DOWN + c] = s[_HELD_DOWN + i] if rises else holds
        if lets_go > _LEAST_CHANCE:
            side = 1.0 if rises else -1.0
            m = _add(s, m, q, (s[_OFF_TO + i], read, side, 0.0), weight * lets_go)
    return m


@never_raises
def _alone(
    s: Floats,
    c: int,
    q: Floats,
    force: Floats,
    mv: Floats,
    slack: Floats,
    span: tuple[int, int],
    readings: tuple[float, float, float],
    slides: tuple[float, float],
    rests: tuple[float, float],
) -> tuple[int, float]:
    """Go on with course ``c``, the only one, as long as nothing is left to chance: it rests well
    below its levels, or moves on. Returns where that ended, within the ``span``, and the logarithm
    of the likelihood on the way.

    Of stems without tables, growth and drift. ``readings``: their offset, the coarse step, and 1
    over the scale, which is 0 where they do not count. ``slides``: the share of its gap that a stem
    covers in a sample, and the fourth power of the gap at which it sticks; ``rests``: how far it
    creeps in a sample, and the share of its level up to which it surely holds.
    """
    (begin, end), (offset, step, per_sigma) = span, readings
    (share, least4), (crept, _) = slides, rests
    half, product, total = 0.5 * q[stem_number.PLAY], 1.0, 0.0
    fs_up, fs_down, fd_up, fd_down = _levels(q)
    x, read, going = s[_X + c], s[_Z + c], s[_GOING + c]
    most_up, most_down = _surely_held(s, c, (fs_up, fs_down), rests[1])
    rested = s[_RESTED + c]
    reached = end
    for k in range(begin, end):
        f = force[k] - x
        if going != 0.0:
            gap = going * f - (fd_up if going > 0.0 else fd_down)
            if _goes_on(gap, least4) < 1.0:
                reached = k
                break
            x += share * going * gap
        else:
            if f > most_up or -f > most_down:
                reached = k
                break
            rested += 1.0
            x += crept
        x = min(max(x, q[stem_number.STOP_LOW]), q[stem_number.STOP_HIGH])
        read = min(max(read, x - half), x + half)
        if per_sigma > 0.0:
            off = max(abs(mv[k] - q[stem_number.GAIN] * (read - 50.0) - offset) - slack[k], 0.0)
            product *= _density(off, 0.0 if slack[k] > 0.0 else step, per_sigma)
            if product < _SMALL or product > _LARGE:
                total, product = total + np.log(product), 1.0
    s[_X + c], s[_Z + c], s[_RESTED + c] = x, read, rested
    # All arrays are used after the loop too: else their references would be counted at every call.
    reached = min(reached, force.size, mv.size, slack.size + q.size)
    return reached, total + np.log(product)


@never_raises
def _levels(q: Floats) -> tuple[float, float, float, float]:
    """The breakaway and the sliding levels, rising and falling, of a stem without tables and
    growth."""
    level, jump = 0.5 * q[stem_number.S], 0.5 * q[stem_number.J]
    jump_up = jump * (1.0 + q[stem_number.ASYMMETRY])
    jump_down = jump * (1.0 - q[stem_number.ASYMMETRY])
    fs_up, fs_down = max(level + jump_up, _LEAST_LEVEL), max(level + jump_down, _LEAST_LEVEL)
    return fs_up, fs_down, level - jump_up, level - jump_down


@never_raises
def _surely_held(
    s: Floats, c: int, levels: tuple[float, float], surely: float
) -> tuple[float, float]:
    """The forces up and down to which course ``c``, at rest, holds as it has held before, or below
    the share of its ``levels`` up to which it ``surely`` does."""
    up, down = max(s[_ASKED_UP + c], surely), max(s[_ASKED_DOWN + c], surely)
    return levels[0] * up, levels[1] * down


@never_raises
def _rest_together(
    s: Floats,
    span: tuple[int, int],
    q: Floats,
    force: Floats,
    mv: Floats,
    slack: Floats,
    samples: tuple[int, int],
    readings: tuple[float, float, float],
    surely: float,
) -> tuple[int, bool]:
    """Weigh the courses of a ``span`` as long as all of them rest well below their levels, and none
    of them has become too improbable. Returns where that ended, and whether the last weights are
    still to be looked at.

    Of stems without tables, growth, drift and creep; the rest as of ``_alone``.
    """
    (first, end), (offset, step, per_sigma), (begin, stop) = samples, readings, span
    fs_up, fs_down, _, _ = _levels(q)
    low, high = -np.inf, np.inf
    for c in range(begin, stop):
        if s[_GOING + c] != 0.0:
            low = np.inf
        most_up, most_down = _surely_held(s, c, (fs_up, fs_down), surely)
        low = max(low, s[_X + c] - most_down)
        high = min(high, s[_X + c] + most_up)
    reached, gain, ends = end, q[stem_number.GAIN], False
    for k in range(first, end):
        if ends or not low <= force[k] <= high:
            reached = k
            break
        if per_sigma > 0.0:
            value, free, most, least = mv[k] - offset, slack[k], 0.0, np.inf
            coarse = 0.0 if free > 0.0 else step
            for c in range(begin, stop):
                off = max(abs(value - gain * (s[_Z + c] - 50.0)) - free, 0.0)
                weight = s[_WEIGHT + c] * _density(off, coarse, per_sigma)
                s[_WEIGHT + c] = weight
                most, least = max(most, weight), min(least, weight)
            ends = not (least > _LEAST_SHARE * most and _SMALL < most < _LARGE)
    for c in range(begin, stop):
        s[_RESTED + c] += reached - first
    # Used after the loop too, as in ``_alone``.
    return min(reached, force.size, mv.size, slack.size + q.size), ends


@never_raises
def _weigh(
    s: Floats,
    span: tuple[int, int],
    q: Floats,
    reading: tuple[float, float, float, float],
    spring: Floats,
) -> None:
    """Weigh the courses of a ``span`` by a reading: its value less the offset, its slack, the
    coarse step, and 1 over its scale, which is 0 where it does not count. ``spring`` as of
    ``_held_by_spring``; the reading then moves it.
    """
    (value, slack, step, per_sigma), gain, read = reading, q[stem_number.GAIN], _Z
    if q[stem_number.HYSTERESIS] != 0.0:
        read = _held_by_spring(s, span, q, spring)
        drag_to(spring, value / gain + 50.0, q[stem_number.WAY])
    if per_sigma == 0.0:
        return
    if step > 0.0 and slack == 0.0:
        for j in range(span[0], span[1]):
            off = abs(value - gain * (s[read + j] - 50.0))
            s[_WEIGHT + j] *= _in_step(off, step, per_sigma)
        return
    for j in range(span[0], span[0] + _whole_vectors(span)):
        off = max(abs(value - gain * (s[read + j] - 50.0)) - slack, 0.0)
        s[_WEIGHT + j] *= _about(off, per_sigma)


@never_raises
def _held_by_spring(s: Floats, span: tuple[int, int], q: Floats, spring: Floats) -> int:
    """Write where the courses of a ``span`` stand with what the spring's inner friction holds back
    after the readings so far, and return the row.

    A course is that of ``x + H h``, which is what the command moves; ``spring`` (4,) are the
    anchors of the elements and the last place.
    """
    hysteresis, way, last = q[stem_number.HYSTERESIS], q[stem_number.WAY], spring[3]
    anchors = spring[0], spring[1], spring[2]
    moved = last + hysteresis * held_back(anchors, last, way)
    for j in range(span[0], span[1]):
        gap = s[_Z + j] - moved
        side = 1.0 if gap > 0.0 else -1.0
        s[_OFF_TO + j] = last + side * way_through(anchors, last, side, abs(gap), hysteresis, way)
    return _OFF_TO


@never_raises
def _begin_spring(s: Floats, c: int, q: Floats, force: float, grown: float, spring: Floats) -> None:
    """Anchor the spring's elements of course ``c``, which has just begun at its place."""
    hysteresis, way, place = q[stem_number.HYSTERESIS], q[stem_number.WAY], s[_X + c]
    band = 0.5 * abs(q[stem_number.S] + q[stem_number.J]) * grown + 0.5 * q[stem_number.PLAY]
    share = min(max((force - place) / (band + hysteresis + _LEAST_LEVEL), -1.0), 1.0)
    anchor_at(spring, place, way, share)
    s[_X + c] += hysteresis * share
    s[_Z + c] += hysteresis * share


@never_raises
def _is_steady(numbers: Floats) -> bool:
    """Whether neither levels nor readings vary with place, rest or time."""
    varying = 0.0
    for number in _VARYING:
        varying += abs(numbers[number])
    return varying == 0.0


@never_raises
def _same(s: Floats, c: int, j: int, place: float, share: float) -> bool:
    """Whether two courses have become one: within a ``place`` and a ``share`` of each other."""
    if abs(s[_X + c] - s[_X + j]) >= place:
        return False
    if s[_GOING + c] != s[_GOING + j]:
        return False
    if abs(s[_Z + c] - s[_Z + j]) >= place:
        return False
    if s[_GOING + c] != 0.0:
        return True
    up = abs(s[_ASKED_UP + c] - s[_ASKED_UP + j])
    return bool(max(up, abs(s[_ASKED_DOWN + c] - s[_ASKED_DOWN + j])) < share)


@never_raises
def _put(s: Floats, c: int, j: int, weight: float) -> None:
    """Copy course ``j`` to place ``c``, with another weight."""
    if c != j:
        for row in _STATE:
            s[row + c] = s[row + j]
    s[_WEIGHT + c] = weight


@never_raises
def _keep(
    s: Floats, span: tuple[int, int], place: float, share: float, most: int
) -> tuple[int, bool]:
    """Join those courses of a ``span`` that are alike, to the more probable one, and keep the most
    probable, at its beginning; returns where they end, and whether any were joined.
    """
    (begin, end), least, joined = span, 0.0, False
    for j in range(begin, end):
        least = max(least, s[_WEIGHT + j])
    least, count = _LEAST_SHARE * least, begin
    for j in range(begin, end):
        weight, c = s[_WEIGHT + j], begin
        if weight <= least:
            continue
        while c < count and not _same(s, c, j, place, share):
            c += _ONE
        if c == count:
            _put(s, c, j, weight)
            count += _ONE
            continue
        joined = True
        if weight > s[_WEIGHT + c]:
            _put(s, c, j, weight + s[_WEIGHT + c])
        else:
            s[_WEIGHT + c] += weight
    while count > begin + most:
        lightest = begin
        for c in range(begin + _ONE, count):
            lightest = c if s[_WEIGHT + c] < s[_WEIGHT + lightest] else lightest
        count -= _ONE
        _put(s, lightest, count, s[_WEIGHT + count])
    return count, joined


@never_raises
def _made_one(s: Floats, span: tuple[int, int]) -> float:
    """Make the probabilities of a ``span`` sum to one; returns the logarithm of their sum, 0 of
    none.
    """
    total = 0.0
    for c in range(span[0], span[1]):
        total += s[_WEIGHT + c]
    for c in range(span[0], span[1]):
        s[_WEIGHT + c] /= total
    logarithm: float = np.log(total) if total > 0.0 else 0.0
    return logarithm


@never_raises
def _offset_and_growth(q: Floats, wander: Floats, k: int, n: int) -> tuple[float, float]:
    """Of sample ``k`` of ``n``: the reading at half the stroke, and how far friction has grown."""
    offset = 50.0 + q[stem_number.ZERO] + q[stem_number.DRIFT] * (k - 0.5 * n) / n
    offset += wander[0, k] if q[stem_number.BY_TIME] != 0.0 else 0.0
    return offset, 1.0 + q[stem_number.GROWTH] * k / n


@never_raises
def _followed(
    s: Floats,
    span: tuple[int, int],
    both: int,
    q: Floats,
    friction: Floats,
    pushing: Floats,
    breakaway: Floats,
    wander: Floats,
    force: Floats,
    mv: Floats,
    slack: Floats,
    samples: tuple[int, int],
    slides: tuple[float, float],
    scales: tuple[float, float, float, float],
    alike: tuple[float, float],
    spring: Floats,
) -> tuple[int, int, float]:
    """Follow the courses of a ``span`` through the ``samples`` of one stretch; returns where they
    are then, and the logarithm of the likelihood on the way. The courses and what becomes of them
    change places: the two begin at ``both`` together.

    ``scales``: the coarse step, 1 over that of the readings, the scatter, and the interval.
    """
    (now, end), (k, until), (step, per_sigma, scatter, dt) = span, samples, scales
    most, steady, apart, total = both // _U(_CHILDREN), _is_steady(q), False, 0.0
    offset, grown = _offset_and_growth(q, wander, k, mv.size)
    rests = q[stem_number.CREEP] * dt, 1.0 - _SOONEST * scatter
    while k < until:
        begun, readings = k, (offset, step, per_sigma)
        if steady and end == now + _ONE:
            k, likely = _alone(s, now, q, force, mv, slack, (k, until), readings, slides, rests)
            total += likely
        elif apart:
            surely = rests[1]
            k, ends = _rest_together(
                s, (now, end), q, force, mv, slack, (k, until), readings, surely
            )
            if ends:
                end, _ = _keep(s, (now, end), 0.0, 0.0, most)
                total += _made_one(s, (now, end))
        if k > begun:
            continue
        if not steady:
            _look_up(s, (now, end), q, friction, pushing, breakaway, dt)
            offset, grown = _offset_and_growth(q, wander, k, mv.size)
        new = both - now
        _weigh_chances(s, (now, end), q, (force[k], grown, scatter))
        m = _branch(s, (now, end), new, q, force[k], rests[0])
        _weigh(s, (new, m), q, (mv[k] - offset, slack[k], step, per_sigma), spring)
        now, (end, joined) = new, _keep(s, (new, m), alike[0], alike[1], most)
        apart = steady and not joined and rests[0] == 0.0
        if not _SMALL < s[_WEIGHT + now] < _LARGE:
            total += _made_one(s, (now, end))
        k += 1
    return now, end, total


@never_raises
def _end_of_stretch(block: NDArray[np.int64], marks: NDArray[np.uint8], k: int) -> int:
    """Where the stretch of sample ``k`` ends: with its block, or before the next start."""
    end = k + 1
    while end < block.size and block[end] == block[k] and marks[end] != _START:
        end += 1
    return end


@never_raises
def log_likelihood(
    force: Floats,
    numbers: Floats,
    tables: Tables,
    record: Record,
    block: NDArray[np.int64],
    slack: Floats,
    step: float,
    sigma: float,
    scatter: float,
    most: int,
    least: Floats,
    by_block: Floats,
) -> None:
    """Write the logarithm of the likelihood of each block (n_blocks,) to ``by_block``.

    ``force`` (n,) is the command that reaches the stem, percent; ``numbers`` (20,) and ``tables``
    (of one stem) as in ``stem``, without inertia. The stem is set to its reading where ``record``
    is marked as a start. ``block`` and ``slack`` (n,) as in ``kernel.Scoring``; ``step`` is that of
    coarse readings, else 0, ``sigma`` the scale of the readings, both percent, and ``scatter`` that
    of the breakaway levels, a share of them. At most ``most`` courses, and 48, are kept. Where
    the sum up to the end of a block is below ``least`` (n_blocks,), the run is given up: the other
    blocks are ``GIVEN_UP``.
    """
    # Unpacked first: an array that is read from a tuple is reference-counted at every sample.
    mv, marks, _, _, dt, _ = record
    friction, pushing, breakaway, wander = tables
    n, k, current, total, so_far = mv.size, 0, -1, 0.0, 0.0
    # Two halves, of which one holds the courses and the other what becomes of them. (To exchange
    # two arrays would count references at every sample.)
    both = _U(_CHILDREN * min(most, MOST_COURSES))
    q, now, end = numbers, _U(0), _U(0)
    (s, slides), alike = _no_courses(dt, q), (_ALIKE_PLACE * sigma, _ALIKE_FORCE * scatter)
    by_block[:], spring = 0.0, np.empty(4)
    while k < n:
        if block[k] != current:
            likely = _made_one(s, (now, end))
            if current >= 0:
                by_block[current] = total + likely
                so_far += by_block[current]
                if so_far < least[current]:
                    by_block[current + 1 :] = GIVEN_UP
                    return
            current, total = block[k], 0.0
        if k == 0 or marks[k] == _START:
            total += _made_one(s, (now, end))
            offset, grown = _offset_and_growth(q, wander, k, n)
            place = (mv[k] - offset) / q[stem_number.GAIN] + 50.0
            end = _begin(s, now, q, place, force[k], grown)
            _begin_spring(s, now, q, force[k], grown, spring)
            k += 1
            continue
        until = _end_of_stretch(block, marks, k)
        scales = step, 1.0 / sigma if current >= 0 else 0.0, scatter, dt
        now, end, likely = _followed(
            s, (now, end), both, q, friction, pushing, breakaway, wander, force, mv, slack,
            (k, until), slides, scales, alike, spring,
        )  # fmt: skip
        k, total = until, total + likely
    if current >= 0:
        by_block[current] = total + _made_one(s, (now, end))
