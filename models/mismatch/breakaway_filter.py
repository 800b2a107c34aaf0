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

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.mismatch import stem as stem_number
from stemwatch.models.mismatch.kernel import Record, share_and_least, table_slope, table_value
from stemwatch.models.mismatch.lanes import never_raises
from stemwatch.models.mismatch.stem import Tables
from stemwatch.models.recording import Floats

_CHILDREN = 4  # of a course in a sample: it goes on, rests, rises, falls
_LEAST_SHARE = 2e-6  # of the most probable course; less is let go
_LEAST_CHANCE = 1e-4  # at which a stem is let go or stuck
_ALIKE_PLACE, _ALIKE_FORCE = 0.3, 0.25  # of sigma and of the scatter: courses that are one
_SOONEST = 8.0  # scatters below its level, up to which a stem lets go
_NEVER_ASKED = -9.0  # share of its level before a rest has begun
_LEAST_LEVEL = 1e-3  # percent
_TINY, _SMALL, _LARGE = (
    1e-300,
    1e-200,
    1e200,
)  # products beyond these are replaced by their logarithms
_START = 1
# Rows of a course: place, place that is read, side of the last motion, 1 while it moves, samples
# that it has rested, the largest shares of its levels that were asked for, its probability.
_X, _Z, _SIDE, _MOVING, _RESTED, _ASKED_UP, _ASKED_DOWN, _WEIGHT = range(8)
_ROWS = 8
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
def _density(residual: float, step: float, per_sigma: float) -> float:
    """Of a reading that is ``residual`` off; its probability where readings come in a ``step``."""
    if step > 0.0:
        near, far = residual - 0.5 * step, residual + 0.5 * step
        return above(near * per_sigma) - above(far * per_sigma) + _SMALL
    u = residual * per_sigma
    b = 1.0 / (1.0 + 0.25 * u * u)
    density: float = 0.375 * b * b * np.sqrt(b) * per_sigma
    return density


@never_raises
def _holds(asked: float, before: float, scatter: float) -> float:
    """The probability that a stem holds at the share ``asked`` which has held at ``before``."""
    if asked <= before or asked < 1.0 - _SOONEST * scatter:
        return 1.0
    return above((asked - 1.0) / scatter) / above((before - 1.0) / scatter)


@never_raises
def _goes_on(gap: float, least: float) -> float:
    """The probability that a moving stem does not stick at this ``gap``, percent."""
    if gap <= 0.0:
        return 0.0
    ratio = least * least / (gap * gap)
    chance = 1.0 / (1.0 + ratio * ratio)
    if chance < _LEAST_CHANCE:
        return 0.0
    return chance if chance < 1.0 - _LEAST_CHANCE else 1.0


@never_raises
def _add(
    courses: Floats,
    m: int,
    q: Floats,
    state: tuple[float, float, float, float, float, float, float],
    weight: float,
) -> int:
    """Add a course at a new place, within the stops; ``state`` holds its place, the place that was
    read, side, motion, rest and the shares asked for. Returns how many there are.
    """
    place, read, side, moving, rested, up, down = state
    half = 0.5 * q[stem_number.PLAY]
    place = min(max(place, q[stem_number.STOP_LOW]), q[stem_number.STOP_HIGH])
    courses[_X, m], courses[_Z, m] = place, min(max(read, place - half), place + half)
    courses[_SIDE, m], courses[_MOVING, m], courses[_RESTED, m] = side, moving, rested
    courses[_ASKED_UP, m], courses[_ASKED_DOWN, m], courses[_WEIGHT, m] = up, down, weight
    return m + 1


@never_raises
def _begin(courses: Floats, q: Floats, place: float, force: float, grown: float) -> int:
    """One course at rest at the ``place`` that was read, within the band that its force allows."""
    band = 0.5 * abs(q[stem_number.S] + q[stem_number.J]) * grown + 0.5 * q[stem_number.PLAY]
    place = min(max(place, force - band), force + band)
    return _add(courses, 0, q, (place, place, 1.0, 0.0, 0.0, _NEVER_ASKED, _NEVER_ASKED), 1.0)


@never_raises
def _branch(
    old: Floats,
    count: int,
    new: Floats,
    q: Floats,
    friction: Floats,
    pushing: Floats,
    breakaway: Floats,
    moved: tuple[float, float, float, float],
    slides: tuple[float, float],
) -> int:
    """Write what may become of the ``count`` courses in a sample to ``new``; returns how many.

    ``moved``: the command, how far friction has grown, the interval, and the scatter; ``slides``:
    the share of its gap that a stem covers in a sample, and the gap at which it sticks.
    """
    (command, grown, dt, scatter), (share, least), m = moved, slides, 0
    for i in range(count):
        x, read, side, weight = old[_X, i], old[_Z, i], old[_SIDE, i], old[_WEIGHT, i]
        up, down, rested = old[_ASKED_UP, i], old[_ASKED_DOWN, i], old[_RESTED, i]
        level, jump, f = 0.5 * q[stem_number.S] * grown, 0.5 * q[stem_number.J] * grown, command - x
        if q[stem_number.BY_PLACE] != 0.0:
            level += table_value(friction, 0, x)
            f -= table_value(pushing, 0, x)
            share, least = share_and_least(dt, q, table_slope(pushing, 0, x))
        jump_up = jump * (1.0 + q[stem_number.ASYMMETRY])
        jump_down = jump * (1.0 - q[stem_number.ASYMMETRY])
        if old[_MOVING, i] > 0.0:
            gap = side * f - (level - jump_up if side > 0.0 else level - jump_down)
            goes_on = _goes_on(gap, least)
            if goes_on > 0.0:
                at = x + share * side * gap
                moving = (at, read, side, 1.0, 0.0, _NEVER_ASKED, _NEVER_ASKED)
                m = _add(new, m, q, moving, weight * goes_on)
            weight, rested, up, down = weight * (1.0 - goes_on), 0.0, _NEVER_ASKED, _NEVER_ASKED
            if goes_on == 1.0:
                continue
        rise = breakaway[0, int(rested)] if q[stem_number.BY_REST] != 0.0 else 0.0
        asked_up = f / max(level + jump_up + rise, _LEAST_LEVEL)
        asked_down = -f / max(level + jump_down + rise, _LEAST_LEVEL)
        holds_up, holds_down = _holds(asked_up, up, scatter), _holds(asked_down, down, scatter)
        if holds_up * holds_down > _LEAST_CHANCE**2:
            at, asked = x + q[stem_number.CREEP] * dt, (max(up, asked_up), max(down, asked_down))
            resting = (at, read, side, 0.0, rested + 1.0, asked[0], asked[1])
            m = _add(new, m, q, resting, weight * holds_up * holds_down)
        if holds_up < 1.0 - _LEAST_CHANCE:
            at = x + share * max(f - (level - jump_up), 0.0)
            rising = (at, read, 1.0, 1.0, 0.0, _NEVER_ASKED, _NEVER_ASKED)
            m = _add(new, m, q, rising, weight * (1.0 - holds_up))
        if holds_down < 1.0 - _LEAST_CHANCE:
            at = x - share * max(-f - (level - jump_down), 0.0)
            falling = (at, read, -1.0, 1.0, 0.0, _NEVER_ASKED, _NEVER_ASKED)
            m = _add(new, m, q, falling, weight * (1.0 - holds_down))
    return m


@never_raises
def _alone(
    course: Floats,
    q: Floats,
    force: Floats,
    mv: Floats,
    slack: Floats,
    span: tuple[int, int],
    readings: tuple[float, float, float],
    slides: tuple[float, float],
    rests: tuple[float, float],
) -> tuple[int, float]:
    """Go on with the only course as long as nothing is left to chance: it rests well below its
    levels, or moves on. Returns where that ended, within the ``span``, and the logarithm of the
    likelihood on the way.

    Of stems without tables, growth and drift. ``readings``: their offset, the coarse step, and 1
    over the scale, which is 0 where they do not count. ``slides`` as of ``_branch``; ``rests``: how
    far the stem creeps in a sample, and the share of its level up to which it surely holds.
    """
    (k, end), (offset, step, per_sigma) = span, readings
    (share, least), (crept, surely) = slides, rests
    half, jump = 0.5 * q[stem_number.PLAY], 0.5 * q[stem_number.J]
    level, product, total = 0.5 * q[stem_number.S], 1.0, 0.0
    jump_up, jump_down = jump * (1.0 + q[stem_number.ASYMMETRY]), jump
    jump_down *= 1.0 - q[stem_number.ASYMMETRY]
    fs_up, fs_down = max(level + jump_up, _LEAST_LEVEL), max(level + jump_down, _LEAST_LEVEL)
    x, read, side = course[_X, 0], course[_Z, 0], course[_SIDE, 0]
    up, down, rested = course[_ASKED_UP, 0], course[_ASKED_DOWN, 0], course[_RESTED, 0]
    moves = course[_MOVING, 0] > 0.0
    while k < end:
        f = force[k] - x
        if moves:
            gap = side * f - (level - jump_up if side > 0.0 else level - jump_down)
            if _goes_on(gap, least) < 1.0:
                break
            x += share * side * gap
        else:
            asked_up, asked_down = f / fs_up, -f / fs_down
            if asked_up > max(up, surely) or asked_down > max(down, surely):
                break
            up, down, rested = max(up, asked_up), max(down, asked_down), rested + 1.0
            x += crept
        x = min(max(x, q[stem_number.STOP_LOW]), q[stem_number.STOP_HIGH])
        read = min(max(read, x - half), x + half)
        if per_sigma > 0.0:
            off = max(abs(mv[k] - q[stem_number.GAIN] * (read - 50.0) - offset) - slack[k], 0.0)
            product *= _density(off, 0.0 if slack[k] > 0.0 else step, per_sigma)
            if product < _SMALL or product > _LARGE:
                total, product = total + np.log(max(product, _TINY)), 1.0
        k += 1
    course[_X, 0], course[_Z, 0], course[_RESTED, 0] = x, read, rested
    course[_ASKED_UP, 0], course[_ASKED_DOWN, 0] = up, down
    return k, total + np.log(max(product, _TINY))


@never_raises
def _weigh(
    courses: Floats, m: int, gain: float, reading: tuple[float, float, float, float]
) -> None:
    """Weigh ``m`` courses by a reading: its value less the offset, its slack, the coarse step, and
    1 over its scale, which is 0 where it does not count.
    """
    value, slack, step, per_sigma = reading
    for j in range(m if per_sigma > 0.0 else 0):
        off = max(abs(value - gain * (courses[_Z, j] - 50.0)) - slack, 0.0)
        courses[_WEIGHT, j] *= _density(off, 0.0 if slack > 0.0 else step, per_sigma)


@never_raises
def _is_steady(numbers: Floats) -> bool:
    """Whether neither levels nor readings vary with place, rest or time."""
    varying = 0.0
    for number in _VARYING:
        varying += abs(numbers[number])
    return varying == 0.0


@never_raises
def _same(kept: Floats, c: int, other: Floats, j: int, place: float, share: float) -> bool:
    """Whether two courses have become one: within a ``place`` and a ``share`` of each other."""
    if kept[_MOVING, c] != other[_MOVING, j] or abs(kept[_X, c] - other[_X, j]) >= place:
        return False
    if abs(kept[_Z, c] - other[_Z, j]) >= place:
        return False
    if kept[_MOVING, c] > 0.0:
        return bool(kept[_SIDE, c] == other[_SIDE, j])
    up = abs(kept[_ASKED_UP, c] - other[_ASKED_UP, j])
    return bool(max(up, abs(kept[_ASKED_DOWN, c] - other[_ASKED_DOWN, j])) < share)


@never_raises
def _heaviest(courses: Floats, m: int, least: float) -> int:
    """The most probable of ``m`` courses, or -1 where none is above ``least``."""
    best = -1
    for j in range(m):
        if courses[_WEIGHT, j] > least:
            best, least = j, courses[_WEIGHT, j]
    return best


@never_raises
def _put(kept: Floats, c: int, new: Floats, j: int, weight: float) -> None:
    """Copy course ``j`` to place ``c`` of those that are kept, with another weight."""
    for row in range(_WEIGHT):
        kept[row, c] = new[row, j]
    kept[_WEIGHT, c] = weight


@never_raises
def _keep(
    new: Floats, m: int, kept: Floats, place: float, share: float, most: int
) -> tuple[int, float]:
    """Keep the most probable of ``m`` courses and join those that are alike; returns how many there
    are, and the probability of the sample that they leave together.
    """
    if m == 1:
        _put(kept, 0, new, 0, 1.0)
        return 1, new[_WEIGHT, 0]
    best = _heaviest(new, m, 0.0)
    least = _LEAST_SHARE * new[_WEIGHT, best] if best >= 0 else 0.0
    count, total = 0, 0.0
    while best >= 0:
        weight, c = new[_WEIGHT, best], 0
        new[_WEIGHT, best] = 0.0
        while c < count and not _same(kept, c, new, best, place, share):
            c += 1
        if c == most:
            break
        if c < count:
            kept[_WEIGHT, c] += weight
        else:
            _put(kept, c, new, best, weight)
            count += 1
        total += weight
        best = _heaviest(new, m, least)
    for c in range(count):
        kept[_WEIGHT, c] /= total
    return count, total


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
    courses: int,
    by_block: Floats,
) -> None:
    """Write the logarithm of the likelihood of each block (n_blocks,) to ``by_block``.

    ``force`` (n,) is the command that reaches the stem, percent; ``numbers`` (18,) and ``tables``
    (of one stem) as in ``stem``, without inertia. The stem is set to its reading where ``record``
    is marked as a start. ``block`` and ``slack`` (n,) as in ``kernel.Scoring``; ``step`` is that of
    coarse readings, else 0, ``sigma`` the scale of the readings, both percent, and ``scatter`` that
    of the breakaway levels, a share of them. At most ``courses`` are kept.
    """
    # Unpacked first: an array that is read from a tuple is reference-counted at every sample.
    mv, marks, _, _, dt, _ = record
    friction, pushing, breakaway, wander = tables
    n, current, total, count = mv.size, -1, 0.0, 0
    kept, new = np.empty((_ROWS, courses)), np.empty((_ROWS, _CHILDREN * courses))
    q, steady, slides = numbers, _is_steady(numbers), share_and_least(dt, numbers, 0.0)
    gain, rests = q[stem_number.GAIN], (q[stem_number.CREEP] * dt, 1.0 - _SOONEST * scatter)
    by_block[:], k = 0.0, 0
    while k < n:
        if block[k] != current:
            if current >= 0:
                by_block[current] += total
            current, total = block[k], 0.0
        since, per_sigma = (k - 0.5 * n) / n, 1.0 / sigma if current >= 0 else 0.0
        offset = 50.0 + q[stem_number.ZERO] + q[stem_number.DRIFT] * since
        offset += wander[0, k] if q[stem_number.BY_TIME] != 0.0 else 0.0
        grown = 1.0 + q[stem_number.GROWTH] * k / n
        if k == 0 or marks[k] == _START:
            count = _begin(kept, q, (mv[k] - offset) / gain + 50.0, force[k], grown)
            k += 1
            continue
        if count == 1 and steady:
            begun, end = k, k + 1
            while end < n and block[end] == current and marks[end] != _START:
                end += 1
            readings = offset, step, per_sigma
            k, likely = _alone(kept, q, force, mv, slack, (k, end), readings, slides, rests)
            total += likely
            if k > begun:
                continue
        moved = force[k], grown, dt, scatter
        m = _branch(kept, count, new, q, friction, pushing, breakaway, moved, slides)
        _weigh(new, m, gain, (mv[k] - offset, slack[k], step, per_sigma))
        count, left = _keep(new, m, kept, _ALIKE_PLACE * sigma, _ALIKE_FORCE * scatter, courses)
        total += np.log(max(left, _TINY))
        k += 1
    if current >= 0:
        by_block[current] += total
