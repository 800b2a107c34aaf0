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

GIVEN_UP = -1e6  # of a block that was not followed
_CHILDREN = 4  # of a course in a sample: it goes on, rests, rises, falls
_LEAST_SHARE = 2e-6  # of the most probable course; less is let go
_LEAST_CHANCE = 1e-4  # at which a stem is let go or stuck
_ALIKE_PLACE, _ALIKE_FORCE = 0.3, 0.25  # of sigma and of the scatter: courses that are one
_SOONEST = 8.0  # scatters below its level, up to which a stem lets go
_LEAST_LEVEL = 1e-3  # percent
_LEAST_DENSITY = 1e-200
_SMALL, _LARGE = 1e-90, 1e90  # products beyond these are replaced by their logarithms
_START = 1
# Columns of a course: place, place that is read, side of the last motion, 1 while it moves, samples
# that it has rested, the largest shares of its levels that were asked for, how probably a stem
# holds there, its probability.
_X, _Z, _SIDE, _MOVING, _RESTED, _ASKED_UP, _ASKED_DOWN, _HELD_UP, _HELD_DOWN, _WEIGHT = range(10)
_COLUMNS = 10
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
        return above(near * per_sigma) - above(far * per_sigma) + _LEAST_DENSITY
    u = residual * per_sigma
    b = 1.0 / (1.0 + 0.25 * u * u)
    density: float = 0.375 * b * b * np.sqrt(b) * per_sigma
    return density


@never_raises
def _asked(share: float, before: float, held: float, scatter: float) -> tuple[float, float, float]:
    """The probability that a stem which has ``held`` at a share ``before`` of its level lets go at
    the ``share`` that is asked of it now; the larger of the two, and how probably it holds there.
    """
    if share <= max(before, 1.0 - _SOONEST * scatter):
        return 0.0, before, held
    holds = above((share - 1.0) / scatter)
    return 1.0 - holds / held, share, holds


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
    state: tuple[float, float, float, float, float],
    weight: float,
) -> int:
    """Add a course that has just stuck or let go at a new place, within the stops; returns how many
    there are. ``state``: its place, the place that was read, side, motion and rest.
    """
    place, read, side, moving, rested = state
    half = 0.5 * q[stem_number.PLAY]
    place = min(max(place, q[stem_number.STOP_LOW]), q[stem_number.STOP_HIGH])
    read = min(max(read, place - half), place + half)
    courses[m, _X], courses[m, _Z] = place, read
    courses[m, _SIDE], courses[m, _MOVING], courses[m, _RESTED] = side, moving, rested
    courses[m, _ASKED_UP], courses[m, _ASKED_DOWN] = 0.0, 0.0
    courses[m, _HELD_UP], courses[m, _HELD_DOWN] = 1.0, 1.0
    courses[m, _WEIGHT] = weight
    return m + 1


@never_raises
def _begin(courses: Floats, c: int, q: Floats, place: float, force: float, grown: float) -> int:
    """One course ``c`` at rest at the ``place`` that was read, within the band that its force
    allows.
    """
    band = 0.5 * abs(q[stem_number.S] + q[stem_number.J]) * grown + 0.5 * q[stem_number.PLAY]
    place = min(max(place, force - band), force + band)
    return _add(courses, c, q, (place, place, 1.0, 0.0, 0.0), 1.0)


@never_raises
def _branch(
    courses: Floats,
    span: tuple[int, int],
    m: int,
    q: Floats,
    friction: Floats,
    pushing: Floats,
    breakaway: Floats,
    moved: tuple[float, float, float, float],
    slides: tuple[float, float],
) -> int:
    """Write what may become in a sample of the courses of a ``span`` to places from ``m`` on;
    returns where that ended.

    ``moved``: the command, how far friction has grown, the interval, and the scatter; ``slides``:
    the share of its gap that a stem covers in a sample, and the gap at which it sticks.
    """
    (command, grown, dt, scatter), (share, least) = moved, slides
    for i in range(span[0], span[1]):
        x, read, side = courses[i, _X], courses[i, _Z], courses[i, _SIDE]
        up, down, rested = courses[i, _ASKED_UP], courses[i, _ASKED_DOWN], courses[i, _RESTED]
        held_up, held_down = courses[i, _HELD_UP], courses[i, _HELD_DOWN]
        weight = courses[i, _WEIGHT]
        level, jump, f = 0.5 * q[stem_number.S] * grown, 0.5 * q[stem_number.J] * grown, command - x
        if q[stem_number.BY_PLACE] != 0.0:
            level += table_value(friction, 0, x)
            f -= table_value(pushing, 0, x)
            share, least = share_and_least(dt, q, table_slope(pushing, 0, x))
        jump_up = jump * (1.0 + q[stem_number.ASYMMETRY])
        jump_down = jump * (1.0 - q[stem_number.ASYMMETRY])
        if courses[i, _MOVING] > 0.0:
            gap = side * f - (level - jump_up if side > 0.0 else level - jump_down)
            goes_on = _goes_on(gap, least)
            if goes_on > 0.0:
                at = x + share * side * gap
                m = _add(courses, m, q, (at, read, side, 1.0, 0.0), weight * goes_on)
            if goes_on == 1.0:
                continue
            weight, rested = weight * (1.0 - goes_on), 0.0
        rise = breakaway[0, int(rested)] if q[stem_number.BY_REST] != 0.0 else 0.0
        asked_up = f / max(level + jump_up + rise, _LEAST_LEVEL)
        asked_down = -f / max(level + jump_down + rise, _LEAST_LEVEL)
        rises, up, held_up = _asked(asked_up, up, held_up, scatter)
        falls, down, held_down = _asked(asked_down, down, held_down, scatter)
        holds = (1.0 - rises) * (1.0 - falls)
        if holds > _LEAST_CHANCE**2:
            at = x + q[stem_number.CREEP] * dt
            m = _add(courses, m, q, (at, read, side, 0.0, rested + 1.0), weight * holds)
            courses[m - 1, _ASKED_UP], courses[m - 1, _ASKED_DOWN] = up, down
            courses[m - 1, _HELD_UP], courses[m - 1, _HELD_DOWN] = held_up, held_down
        if rises > _LEAST_CHANCE:
            at = x + share * max(f - (level - jump_up), 0.0)
            m = _add(courses, m, q, (at, read, 1.0, 1.0, 0.0), weight * rises)
        if falls > _LEAST_CHANCE:
            at = x - share * max(-f - (level - jump_down), 0.0)
            m = _add(courses, m, q, (at, read, -1.0, 1.0, 0.0), weight * falls)
    return m


@never_raises
def _alone(
    courses: Floats,
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
    x, read, side = courses[c, _X], courses[c, _Z], courses[c, _SIDE]
    most_up = fs_up * max(courses[c, _ASKED_UP], surely)
    most_down = fs_down * max(courses[c, _ASKED_DOWN], surely)
    rested, moves = courses[c, _RESTED], courses[c, _MOVING] > 0.0
    while k < end:
        f = force[k] - x
        if moves:
            gap = side * f - (level - jump_up if side > 0.0 else level - jump_down)
            if _goes_on(gap, least) < 1.0:
                break
            x += share * side * gap
        else:
            if f > most_up or -f > most_down:
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
        k += 1
    courses[c, _X], courses[c, _Z], courses[c, _RESTED] = x, read, rested
    return k, total + np.log(product)


@never_raises
def _weigh(
    courses: Floats,
    span: tuple[int, int],
    gain: float,
    reading: tuple[float, float, float, float],
) -> None:
    """Weigh the courses of a ``span`` by a reading: its value less the offset, its slack, the
    coarse step, and 1 over its scale, which is 0 where it does not count.
    """
    value, slack, step, per_sigma = reading
    for j in range(span[0], span[1] if per_sigma > 0.0 else span[0]):
        off = max(abs(value - gain * (courses[j, _Z] - 50.0)) - slack, 0.0)
        courses[j, _WEIGHT] *= _density(off, 0.0 if slack > 0.0 else step, per_sigma)


@never_raises
def _is_steady(numbers: Floats) -> bool:
    """Whether neither levels nor readings vary with place, rest or time."""
    varying = 0.0
    for number in _VARYING:
        varying += abs(numbers[number])
    return varying == 0.0


@never_raises
def _same(courses: Floats, c: int, j: int, place: float, share: float) -> bool:
    """Whether two courses have become one: within a ``place`` and a ``share`` of each other."""
    if courses[c, _MOVING] != courses[j, _MOVING]:
        return False
    if abs(courses[c, _X] - courses[j, _X]) >= place:
        return False
    if abs(courses[c, _Z] - courses[j, _Z]) >= place:
        return False
    if courses[c, _MOVING] > 0.0:
        return bool(courses[c, _SIDE] == courses[j, _SIDE])
    up = abs(courses[c, _ASKED_UP] - courses[j, _ASKED_UP])
    return bool(max(up, abs(courses[c, _ASKED_DOWN] - courses[j, _ASKED_DOWN])) < share)


@never_raises
def _put(courses: Floats, c: int, j: int, weight: float) -> None:
    """Copy course ``j`` to place ``c``, with another weight."""
    if c != j:
        for column in range(_WEIGHT):
            courses[c, column] = courses[j, column]
    courses[c, _WEIGHT] = weight


@never_raises
def _keep(courses: Floats, span: tuple[int, int], place: float, share: float, most: int) -> int:
    """Join those courses of a ``span`` that are alike, to the more probable one, and keep the most
    probable, at its beginning; returns where they end.
    """
    (begin, end), least = span, 0.0
    for j in range(begin, end):
        least = max(least, _LEAST_SHARE * courses[j, _WEIGHT])
    count = begin
    for j in range(begin, end):
        weight, c = courses[j, _WEIGHT], begin
        if weight <= least:
            continue
        while c < count and not _same(courses, c, j, place, share):
            c += 1
        if c == count:
            _put(courses, c, j, weight)
            count += 1
        elif weight > courses[c, _WEIGHT]:
            _put(courses, c, j, weight + courses[c, _WEIGHT])
        else:
            courses[c, _WEIGHT] += weight
    while count > begin + most:
        lightest = begin
        for c in range(begin + 1, count):
            lightest = c if courses[c, _WEIGHT] < courses[lightest, _WEIGHT] else lightest
        count -= 1
        _put(courses, lightest, count, courses[count, _WEIGHT])
    return count


@never_raises
def _made_one(courses: Floats, span: tuple[int, int]) -> float:
    """Make the probabilities of a ``span`` sum to one; returns the logarithm of their sum, 0 of
    none.
    """
    total = 0.0
    for c in range(span[0], span[1]):
        total += courses[c, _WEIGHT]
    for c in range(span[0], span[1]):
        courses[c, _WEIGHT] /= total
    logarithm: float = np.log(total) if total > 0.0 else 0.0
    return logarithm


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

    ``force`` (n,) is the command that reaches the stem, percent; ``numbers`` (18,) and ``tables``
    (of one stem) as in ``stem``, without inertia. The stem is set to its reading where ``record``
    is marked as a start. ``block`` and ``slack`` (n,) as in ``kernel.Scoring``; ``step`` is that of
    coarse readings, else 0, ``sigma`` the scale of the readings, both percent, and ``scatter`` that
    of the breakaway levels, a share of them. At most ``most`` courses are kept. Where
    the sum up to the end of a block is below ``least`` (n_blocks,), the run is given up: the other
    blocks are ``GIVEN_UP``.
    """
    # Unpacked first: an array that is read from a tuple is reference-counted at every sample.
    mv, marks, _, _, dt, _ = record
    friction, pushing, breakaway, wander = tables
    n, current, total, so_far = mv.size, -1, 0.0, 0.0
    # Two halves, of which one holds the courses and the other what becomes of them. (To exchange
    # two arrays would count references at every sample.)
    half = _CHILDREN * most
    courses, now, end = np.empty((2 * half, _COLUMNS)), 0, 0
    q, steady, slides = numbers, _is_steady(numbers), share_and_least(dt, numbers, 0.0)
    gain, rests = q[stem_number.GAIN], (q[stem_number.CREEP] * dt, 1.0 - _SOONEST * scatter)
    by_block[:], k = 0.0, 0
    while k < n:
        if block[k] != current:
            likely = _made_one(courses, (now, end))
            if current >= 0:
                by_block[current] = total + likely
                so_far += by_block[current]
                if so_far < least[current]:
                    by_block[current + 1 :] = GIVEN_UP
                    return
            current, total = block[k], 0.0
        since, per_sigma = (k - 0.5 * n) / n, 1.0 / sigma if current >= 0 else 0.0
        offset = 50.0 + q[stem_number.ZERO] + q[stem_number.DRIFT] * since
        offset += wander[0, k] if q[stem_number.BY_TIME] != 0.0 else 0.0
        grown = 1.0 + q[stem_number.GROWTH] * k / n
        if k == 0 or marks[k] == _START:
            total += _made_one(courses, (now, end))
            end = _begin(courses, now, q, (mv[k] - offset) / gain + 50.0, force[k], grown)
            k += 1
            continue
        if end == now + 1 and steady:
            begun, until = k, _end_of_stretch(block, marks, k)
            readings = offset, step, per_sigma
            k, likely = _alone(
                courses, now, q, force, mv, slack, (k, until), readings, slides, rests
            )
            total += likely
            if k > begun:
                continue
        moved = force[k], grown, dt, scatter
        reading = mv[k] - offset, slack[k], step, per_sigma
        new = half - now
        m = _branch(courses, (now, end), new, q, friction, pushing, breakaway, moved, slides)
        _weigh(courses, (new, m), gain, reading)
        now, end = new, _keep(courses, (new, m), _ALIKE_PLACE * sigma, _ALIKE_FORCE * scatter, most)
        if not _SMALL < courses[now, _WEIGHT] < _LARGE:
            total += _made_one(courses, (now, end))
        k += 1
    if current >= 0:
        by_block[current] = total + _made_one(courses, (now, end))
