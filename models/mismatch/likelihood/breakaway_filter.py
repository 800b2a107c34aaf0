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
at which the model's sticks. Where a stem lets go the sooner the quicker it is loaded, ``f_s`` is
lower by ``min(d r^(2/3), J)``, with the speed ``r`` of the force in percent/s (``breakaway_levels``
has the reason). A reading lies about that of the course by the same distribution, of scale
``sigma`` (Lange, Little and Taylor, 1989, doi:10.1080/01621459.1989.10478852); one in coarse steps
has the probability of its step.

Courses that have become alike are joined, and the most probable are kept, as in the filter of
sums of Alspach and Sorenson (1972, doi:10.1109/TAC.1972.1100034).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.mismatch.likelihood import stem_courses as course
from stemwatch.models.mismatch.stem_model import stem as stem_number
from stemwatch.models.mismatch.stem_model.inner_friction import drag_to
from stemwatch.models.mismatch.stem_model.kernel import Record
from stemwatch.models.mismatch.stem_model.lanes import never_raises
from stemwatch.models.mismatch.stem_model.stem import Tables
from stemwatch.models.recording import Floats

GIVEN_UP = -1e6  # of a block that was not followed
RATE_POWER = 2.0 / 3.0  # of the speed of the force, percent/s
_ALIKE_PLACE, _ALIKE_FORCE = 0.3, 0.25  # of sigma and of the scatter: courses that are one
_LEAST_DENSITY = 1e-200
_SMALL, _LARGE = 1e-90, 1e90  # products beyond these are replaced by their logarithms
_START = 1
_VARYING = (
    stem_number.BY_PLACE,
    stem_number.BY_REST,
    stem_number.BY_TIME,
    stem_number.GROWTH,
    stem_number.DRIFT,
    stem_number.SOONER,
    stem_number.GIVES,
)


@never_raises
def _in_step(residual: float, step: float, per_sigma: float) -> float:
    """The probability of a reading in a coarse ``step`` that is ``residual`` off."""
    near, far = residual - 0.5 * step, residual + 0.5 * step
    return course.above(near * per_sigma) - course.above(far * per_sigma) + _LEAST_DENSITY


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
    fs_up, fs_down, fd_up, fd_down = course.levels(q, 0.0)
    x, read, going = s[course.X + c], s[course.Z + c], s[course.GOING + c]
    most_up, most_down = course.surely_held(s, c, (fs_up, fs_down), rests[1])
    rested = s[course.RESTED + c]
    reached = end
    for k in range(begin, end):
        f = force[k] - x
        if going != 0.0:
            gap = going * f - (fd_up if going > 0.0 else fd_down)
            if course.goes_on(gap, least4) < 1.0:
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
    s[course.X + c], s[course.Z + c], s[course.RESTED + c] = x, read, rested
    # All arrays are used after the loop too: else their references would be counted at every call.
    reached = min(reached, force.size, mv.size, slack.size + q.size)
    return reached, total + np.log(product)


@never_raises
def _rest_together(
    s: Floats,
    span: tuple[int, int],
    q: Floats,
    force: Floats,
    mv: Floats,
    slack: Floats,
    wander: Floats,
    samples: tuple[int, int],
    readings: tuple[float, float, float],
    surely: float,
) -> tuple[int, bool]:
    """Weigh the courses of a ``span`` as long as all of them rest well below their levels, and none
    of them has become too improbable. Returns where that ended, and whether the last weights are
    still to be looked at.

    Of stems of which nothing changes at rest (``_changes_at_rest``); the rest as of ``_alone``.
    """
    (first, end), (offset, step, per_sigma), (begin, stop) = samples, readings, span
    low, high = -np.inf, np.inf
    for c in range(begin, stop):
        if s[course.GOING + c] != 0.0:
            low = np.inf
        fs_up, fs_down, _, _ = course.levels(q, s[course.FRICTION + c])
        most_up, most_down = course.surely_held(s, c, (fs_up, fs_down), surely)
        place = s[course.X + c] + s[course.PUSHED + c]
        low, high = max(low, place - most_down), min(high, place + most_up)
    wanders = q[stem_number.DRIFT] != 0.0 or q[stem_number.BY_TIME] != 0.0
    reached, gain, ends = end, q[stem_number.GAIN], False
    for k in range(first, end):
        if ends or not low <= force[k] <= high:
            reached = k
            break
        if wanders:
            offset, _ = _offset_and_growth(q, wander, k, mv.size)
        if per_sigma > 0.0:
            value, free, most, least = mv[k] - offset, slack[k], 0.0, np.inf
            coarse = 0.0 if free > 0.0 else step
            for c in range(begin, stop):
                off = max(abs(value - gain * (s[course.Z + c] - 50.0)) - free, 0.0)
                weight = s[course.WEIGHT + c] * _density(off, coarse, per_sigma)
                s[course.WEIGHT + c] = weight
                most, least = max(most, weight), min(least, weight)
            ends = not (least > course.LEAST_SHARE * most and _SMALL < most < _LARGE)
    for c in range(begin, stop):
        s[course.RESTED + c] += reached - first
    # Used after the loop too, as in ``_alone``.
    return min(reached, force.size, mv.size, slack.size + q.size + wander.size), ends


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
    ``course.held_by_spring``; the reading then moves it.
    """
    (value, slack, step, per_sigma), gain, read = reading, q[stem_number.GAIN], course.Z
    if q[stem_number.HYSTERESIS] != 0.0:
        read = course.held_by_spring(s, span, q, spring)
        drag_to(spring, value / gain + 50.0, q[stem_number.WAY])
    if per_sigma == 0.0:
        return
    if step > 0.0 and slack == 0.0:
        for j in range(span[0], span[1]):
            off = abs(value - gain * (s[read + j] - 50.0))
            s[course.WEIGHT + j] *= _in_step(off, step, per_sigma)
        return
    for j in range(span[0], span[0] + course.whole_vectors(span)):
        off = max(abs(value - gain * (s[read + j] - 50.0)) - slack, 0.0)
        s[course.WEIGHT + j] *= _about(off, per_sigma)


@never_raises
def _is_steady(numbers: Floats) -> bool:
    """Whether neither levels nor readings vary with place, rest or time."""
    varying = 0.0
    for number in _VARYING:
        varying += abs(numbers[number])
    return varying == 0.0


@never_raises
def _changes_at_rest(q: Floats) -> bool:
    """Whether something of a stem changes while it rests, other than its reading: its levels, its
    place, or what a spring's inner friction holds back."""
    changing = abs(q[stem_number.GROWTH]) + abs(q[stem_number.CREEP]) + q[stem_number.SOONER]
    changing += q[stem_number.GIVES]
    return bool(changing + q[stem_number.BY_REST] + abs(q[stem_number.HYSTERESIS]) > 0.0)


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
    most, steady, changes = both // course.U(course.CHILDREN), _is_steady(q), _changes_at_rest(q)
    apart, total = False, 0.0
    offset, grown = _offset_and_growth(q, wander, k, mv.size)
    rests = q[stem_number.CREEP] * dt, 1.0 - course.SOONEST * scatter
    while k < until:
        begun, readings = k, (offset, step, per_sigma)
        if not steady:
            course.look_up_levels(s, (now, end), q, friction, pushing, breakaway)
        if steady and end == now + course.ONE:
            k, likely = _alone(s, now, q, force, mv, slack, (k, until), readings, slides, rests)
            total += likely
        elif apart:
            surely = rests[1]
            k, ends = _rest_together(
                s, (now, end), q, force, mv, slack, wander, (k, until), readings, surely
            )
            if ends:
                end, _ = course.keep(s, (now, end), 0.0, 0.0, most)
                total += course.made_one(s, (now, end))
        if k > begun:
            continue
        if not steady:
            course.look_up_slides(s, (now, end), q, pushing, dt)
            offset, grown = _offset_and_growth(q, wander, k, mv.size)
        new = both - now
        sooner = 0.0
        if q[stem_number.SOONER] != 0.0:
            sooner = q[stem_number.SOONER] * (abs(force[k] - force[k - 1]) / dt) ** RATE_POWER
        course.weigh_chances(s, (now, end), q, (force[k], grown, scatter, sooner))
        course.give_way(s, (now, end), q, (force[k - 1], force[k], grown), rests[0])
        m = course.branch(s, (now, end), new, q, force[k], rests[0])
        _weigh(s, (new, m), q, (mv[k] - offset, slack[k], step, per_sigma), spring)
        now, (end, joined) = new, course.keep(s, (new, m), alike[0], alike[1], most)
        apart = not (changes or joined)
        if not _SMALL < s[course.WEIGHT + now] < _LARGE:
            total += course.made_one(s, (now, end))
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

    ``force`` (n,) is the command that reaches the stem, percent; ``numbers`` (22,) and ``tables``
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
    n, k, current, total, so_far = mv.size, course.INT(0), course.INT(-1), 0.0, 0.0
    # Two halves, of which one holds the courses and the other what becomes of them. (To exchange
    # two arrays would count references at every sample.)
    both = course.U(course.CHILDREN * min(most, course.MOST_COURSES))
    q, now, end = numbers, course.U(0), course.U(0)
    (s, slides), alike = course.no_courses(dt, q), (_ALIKE_PLACE * sigma, _ALIKE_FORCE * scatter)
    by_block[:], spring = 0.0, np.empty(4)
    while k < n:
        if block[k] != current:
            likely = course.made_one(s, (now, end))
            if current >= 0:
                by_block[current] = total + likely
                so_far += by_block[current]
                if so_far < least[current]:
                    by_block[current + 1 :] = GIVEN_UP
                    return
            current, total = block[k], 0.0
        if k == 0 or marks[k] == _START:
            total += course.made_one(s, (now, end))
            offset, grown = _offset_and_growth(q, wander, k, n)
            place = (mv[k] - offset) / q[stem_number.GAIN] + 50.0
            end = course.begin(s, now, q, place, force[k], grown)
            course.begin_spring(s, now, q, force[k], grown, spring)
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
        by_block[current] = total + course.made_one(s, (now, end))


@never_raises
def log_likelihoods(
    forces: Floats,
    rows: NDArray[np.int64],
    numbers: Floats,
    tables: Tables,
    record: Record,
    block: NDArray[np.int64],
    slack: Floats,
    step: float,
    scales: Floats,
    most: int,
    behind: float,
    best: float,
    least: Floats,
    by_block: Floats,
) -> float:
    """``log_likelihood`` of several stems, one after the other, into ``by_block`` (m, n_blocks).

    ``rows`` (m,) are those of ``forces`` (r, n); ``numbers`` (m, 22) and ``tables`` are of the
    stems, ``scales`` (m, 2) of the readings and of the levels. A run that falls ``behind`` the
    ``best`` so far, of which ``least`` (n_blocks,) says what that leaves at the end of each block,
    is given up; both are kept for more stems, and the best is returned. No run is given up where
    ``behind`` is infinite.
    """
    friction, pushing, breakaway, wander = tables
    for i in range(rows.size):
        end, likely = i + 1, 0.0
        own = Tables(friction[i:end], pushing[i:end], breakaway[i:end], wander[i:end])
        log_likelihood(
            forces[rows[i]], numbers[i], own, record, block, slack, step,
            scales[i, 0], scales[i, 1], most, least, by_block[i],
        )  # fmt: skip
        for b in range(least.size):
            likely += by_block[i, b]
        if behind < np.inf and likely > best:
            best, so_far = likely, 0.0
            for b in range(least.size):
                so_far += by_block[i, b]
                least[b] = so_far - behind
    return best
