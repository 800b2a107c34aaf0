"""The stem's kernel: many candidates over a recording, side by side.

No two breakaways of a real stem are equal (5 to 12 % scatter is normal), and on a slow ramp a
breakaway that comes a little late costs a whole jump for a long time. A run may therefore be
*assimilated*: where the recording shows the stem let go (``onsets``), and the force is within a
window of ``fs``, the stem lets go there, and what is charged is how far the force was from
``fs``, not the time. All hypotheses are compared this way; what is shown to people is a free run.

Each sample waits for the one before, so that one stem alone leaves most of a processor idle.
Candidates therefore run side by side, one in each *lane*. The state of all lanes is one array, row
by row (``lane_rows``), and the loop over the lanes selects values instead of branching, so that the
compiler vectorises it. It does so only with unsigned indices, with one array beside the forces, and
where all values are read before any is selected. What is rare (marks, onsets, tables, logarithms)
is done lane by lane. The motion itself is in ``lanes``.

The equations stand in ``stem``.
"""

from __future__ import annotations

from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.mismatch.stem_model import lane_rows as row
from stemwatch.models.mismatch.stem_model import stem as stem_number
from stemwatch.models.mismatch.stem_model.by_place import (
    anchor,
    look_up,
    share_and_least,
    table_value,
)
from stemwatch.models.mismatch.stem_model.lane_rows import LANES
from stemwatch.models.mismatch.stem_model.lanes import (
    AHEAD,
    FULL,
    WIDTH,
    alike,
    begin_sliding,
    drifts,
    end_sliding,
    keep_readings,
    loss_factor,
    move,
    never_raises,
    next_forces,
    note_force,
    reading,
    settle_losses,
    slid,
    slide,
)
from stemwatch.models.mismatch.stem_model.presliding import given_way
from stemwatch.models.mismatch.stem_model.stem import Tables
from stemwatch.models.recording import Floats


class Record(NamedTuple):
    """What every candidate is run over, ``n`` samples every ``interval_s`` seconds.

    ``marks`` (n,): at START the whole state is taken from ``mv`` (n,), percent, at RESYNC only the
    place where a resting stem rests. ``next_up`` and ``next_down`` (n,) are the samples at which
    the recorded stem next lets go, or n; ``window`` (a share of ``fs``, 0: a free run) is how far
    from ``fs`` it may do so.
    """

    mv: Floats
    marks: NDArray[np.uint8]
    next_up: NDArray[np.int64]
    next_down: NDArray[np.int64]
    interval_s: float
    window: float


class Scoring(NamedTuple):
    """What a run costs: Cauchy's loss ``delta^2 log(1 + (r/delta)^2)`` of its samples, and more.

    ``block`` (n,) is the block number of a sample, negative where it is not scored; neighbours
    must be grouped. ``slack`` (n,) is how far a value may lie from ``mv`` at no cost, percent: 0
    where it was measured. A breakaway that was assimilated ``e`` percent from its level costs
    ``event`` times ``delta^2 log(1 + (e/scatter)^2)``.
    """

    block: NDArray[np.int64]
    slack: Floats
    delta: float
    scatter: float
    event: float


_START, _RESYNC = 1, 2
_PATIENCE_S = 120.0  # how long an assimilated run waits for a breakaway that the recording shows
# numba types a plain 0 as the literal 0, so all that is called with it would be compiled twice.
_I = cast("type[int]", np.int64)
_PARTS = 4  # of a sample, in which a stem with inertia is moved


@never_raises
def _set_levels(s: Floats, lanes: np.uint64, k: int) -> None:
    """Set the breakaway and sliding levels of every lane at sample ``k``, percent."""
    for i in range(lanes):
        s_half, j_half = s[row.HALF_S + i], s[row.HALF_J + i]
        uneven, growth = s[row.ASYMMETRY + i], s[row.GROWTH + i]
        friction, rise = s[row.FRICTION + i], s[row.BREAKAWAY + i]
        grown = 1.0 + growth * k
        level, jump = s_half * grown + friction, j_half * grown
        up, down = jump * (1.0 + uneven), jump * (1.0 - uneven)
        s[row.FS_UP + i], s[row.FS_DOWN + i] = level + up + rise, level + down + rise
        s[row.FD_UP + i], s[row.FD_DOWN + i] = level - up, level - down


@never_raises
def _begin(
    s: Floats, numbers: Floats, lanes: int, force: Floats, rows: NDArray[np.int64], dt: float
) -> None:
    """Set every lane to rest at its first force."""
    n = force.shape[1]
    for lane in range(lanes):
        candidate, i = min(lane, rows.size - 1), np.uint64(lane)
        q = numbers[candidate]
        s[row.X + i] = s[row.Z + i] = force[rows[candidate], 0]
        s[row.SIDE + i] = s[row.PRODUCT + i] = 1.0
        s[row.MOVING + i] = s[row.RESTED + i] = s[row.SPEED + i] = 0.0
        s[row.FORCE_AFTER + i] = s[row.FORCE + i] = s[row.WANDER + i] = 0.0
        s[row.FRICTION + i] = s[row.BREAKAWAY + i] = 0.0
        s[row.LOOKED_UP_AT + i] = np.nan
        s[row.SHARE + i], s[row.LEAST_GAP + i] = share_and_least(
            dt, q[stem_number.DRAG_S], q[stem_number.RESTICK], 0.0
        )
        s[row.CREEP + i] = q[stem_number.CREEP] * dt
        s[row.STOP_LOW + i], s[row.STOP_HIGH + i] = (
            q[stem_number.STOP_LOW],
            q[stem_number.STOP_HIGH],
        )
        s[row.HALF_PLAY + i] = 0.5 * q[stem_number.PLAY]
        s[row.HALF_S + i], s[row.HALF_J + i] = 0.5 * q[stem_number.S], 0.5 * q[stem_number.J]
        s[row.ASYMMETRY + i] = q[stem_number.ASYMMETRY]
        s[row.GROWTH + i], s[row.DRIFT + i] = q[stem_number.GROWTH] / n, q[stem_number.DRIFT] / n
        s[row.GAIN + i], s[row.OFFSET + i] = q[stem_number.GAIN], 50.0 + q[stem_number.ZERO]
    _set_levels(s, np.uint64(lanes), _I(0))


@never_raises
def used(numbers: Floats) -> tuple[bool, bool, bool]:
    """Whether levels of some stem vary along the record, whether readings wander, and whether some
    stem has inertia."""
    varied, timed, heavy = False, False, False
    for q in numbers:
        varied |= (
            q[stem_number.GROWTH] != 0.0
            or q[stem_number.BY_PLACE] != 0.0
            or q[stem_number.BY_REST] != 0.0
            or q[stem_number.GIVES] != 0.0
        )
        timed |= q[stem_number.BY_TIME] != 0.0
        heavy |= q[stem_number.RUN_UP_S] > 0.0
    return varied, timed, heavy


@never_raises
def _move_heavy(
    s: Floats, numbers: Floats, forces: Floats, near_onset: tuple[float, float], dt: float
) -> None:
    """Advance the lanes whose stem has inertia by one sample, before ``move`` takes its reading
    and loss.

    The force balance in ``_PARTS`` implicit steps ``h``, stable for every drag and inertia: in the
    direction of motion, ``w = max((a w/h + gap) / (a/h + DRAG_S + h), 0)``, ``a = DRAG_S
    RUN_UP_S``; at the limit of the voltage the force does not depend on the place, and the last
    ``h`` is 0. ``forces`` (lanes,) then hold the stem at its new place, so that ``move`` reads it
    there; ``_after_heavy`` corrects afterwards what ``move`` cannot know.
    """
    h = dt / _PARTS
    for lane in range(numbers.shape[0]):
        i, q = np.uint64(lane), numbers[lane]
        if q[stem_number.RUN_UP_S] <= 0.0:
            continue
        drag, top = q[stem_number.DRAG_S], q[stem_number.TOP_SPEED]
        inertia = drag * q[stem_number.RUN_UP_S] / h
        most = drag * top if drag > 0.0 and top < np.inf else np.inf
        x, d, w = s[row.X + i], s[row.SIDE + i], s[row.SPEED + i]
        load, force_left = s[row.FORCE + i], 0.0
        for part in range(_PARTS):
            off = forces[i] - x
            f = min(max(off, -most), most) - load
            if w <= 0.0:
                up = f > near_onset[0] * s[row.FS_UP + i]
                down = -f > near_onset[1] * s[row.FS_DOWN + i]
                if not (up or down):
                    break
                d = 1.0 if up else -1.0
                force_left = f if part == 0 else force_left
            gap = d * f - (s[row.FD_UP + i] if d > 0.0 else s[row.FD_DOWN + i])
            gives = h if abs(off) < most else 0.0
            w = max((inertia * w + gap) / (inertia + drag + gives), 0.0)
            x += d * w * h
        stopped = min(max(x, s[row.STOP_LOW + i]), s[row.STOP_HIGH + i])
        s[row.SPEED + i] = w if stopped == x else 0.0
        s[row.X + i], s[row.SIDE + i], s[row.MOVING + i] = stopped, d, 0.0
        s[row.HEAVY_LET_GO_AT + i], s[row.HEAVY_FORCE_AFTER + i] = (
            force_left,
            min(max(forces[i] - stopped, -most), most) - load,
        )
        forces[i] = stopped + load


@never_raises
def _after_heavy(s: Floats, numbers: Floats) -> None:
    """Restore the state of the lanes that ``_move_heavy`` moved: whether they are still moving, the
    force at their breakaway, and the present force.
    """
    for lane in range(numbers.shape[0]):
        i = np.uint64(lane)
        if numbers[lane, stem_number.RUN_UP_S] > 0.0:
            s[row.MOVING + i] = 1.0 if s[row.SPEED + i] > 0.0 else 0.0
            s[row.LET_GO_AT + i] = s[row.HEAVY_LET_GO_AT + i]
            s[row.FORCE_AFTER + i] = s[row.HEAVY_FORCE_AFTER + i]


@never_raises
def _share_near_onset(onset: int, k: int, n: int, window: float, patience: int) -> float:
    """The share of ``fs`` beyond which a stem lets go that was next seen to do so at ``onset``."""
    if window <= 0.0 or onset >= n:
        return 1.0
    if onset == k:
        return 1.0 - window
    return 1.0 + window if onset - k <= patience else 1.0


@never_raises
def _near_onsets(
    up: int, down: int, k: int, n: int, window: float, patience: int
) -> tuple[float, float]:
    """The shares of ``fs`` beyond which a stem lets go rising and falling."""
    near_up = _share_near_onset(up, k, n, window, patience)
    return near_up, _share_near_onset(down, k, n, window, patience)


@never_raises
def _early_late(s: Floats, i: np.uint64, before: float, up: bool, down: bool) -> float:
    """How far the force was from ``fs`` where lane ``i`` let go as it was seen to, percent, else 0.

    ``before`` was the force one sample ago. It was seen to go ``up`` or ``down`` between the two
    samples: neither early nor late if ``fs`` lies between.
    """
    size, fs_up, fs_down = s[row.LET_GO_AT + i], s[row.FS_UP + i], s[row.FS_DOWN + i]
    side, fs = (1.0, fs_up) if size > 0.0 else (-1.0, fs_down)
    size, distance = abs(size), 0.0
    if size > 0.0 and (up if side > 0.0 else down):
        late = min(side * before, size) - fs if side * before > fs else 0.0
        distance = size - fs if size < fs else late
    return distance


@never_raises
def _lanes_with(numbers: Floats, number: int) -> NDArray[np.int64]:
    """The lanes whose stem has a number that is not 0."""
    found = np.empty(numbers.shape[0], np.int64)
    many = 0
    for lane in range(numbers.shape[0]):
        if numbers[lane, number] != 0.0:
            found[many] = lane
            many += 1
    return found[:many]


@never_raises
def _tabled(
    numbers: Floats,
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """The lanes whose stem has tables over place, over the rest before, and over time."""
    return (
        _lanes_with(numbers, stem_number.BY_PLACE),
        _lanes_with(numbers, stem_number.BY_REST),
        _lanes_with(numbers, stem_number.BY_TIME),
    )


@never_raises
def _rise(s: Floats, resting: NDArray[np.int64], breakaway: Floats) -> None:
    """Look up what the rest before adds to the breakaway of some lanes."""
    for j in range(resting.size):
        lane = resting[j]
        i = np.uint64(lane)
        # A stem that sticks at this very sample has not rested yet.
        rested = 0.0 if s[row.MOVING + i] > 0.0 else s[row.RESTED + i]
        s[row.BREAKAWAY + i] = breakaway[lane, int(rested)]
        s[row.RESTED + i] = rested + 1.0


@never_raises
def _give_way(
    s: Floats, numbers: Floats, sample: tuple[float, int, np.uint64], forces: Floats
) -> None:
    """Set how far the stems that give way creep in this sample, if they rest: by what the change of
    the force makes them give, and by what they creep anyhow. ``sample`` as in ``look_up``.
    """
    dt, _, o = sample
    for lane in range(numbers.shape[0]):
        i, q = np.uint64(lane), numbers[lane]
        if q[stem_number.GIVES] == 0.0:
            continue
        before, force = s[row.FORCE_AFTER + i], forces[o + i] - s[row.X + i] - s[row.FORCE + i]
        level = s[row.FS_UP + i] if force > before else s[row.FS_DOWN + i]
        way = given_way(before, force, level, q[stem_number.GIVES])
        s[row.CREEP + i] = q[stem_number.CREEP] * dt + way


@never_raises
def _wander(s: Floats, waving: NDArray[np.int64], wander: Floats, k: int) -> None:
    """Look up how far the readings of some lanes wander at sample ``k``."""
    for j in range(waving.size):
        lane = waving[j]
        s[row.WANDER + np.uint64(lane)] = wander[lane, k]


@never_raises
def _slide_varied(
    s: Floats,
    forces: Floats,
    lanes: np.uint64,
    near_onset: tuple[float, float],
    record: tuple[Floats, Floats],
    scale: float,
    span: tuple[int, int],
    block: int,
    losses: Floats,
    tabled: tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]],
    tables: Tables,
    stems: tuple[Floats, float],
) -> int:
    """``slide`` with the levels and the readings of every sample: ``tabled`` are the lanes that
    have tables (``_tabled``), ``record`` MV and its slack, ``span`` the samples, ``stems`` their
    numbers and the interval.
    """
    (mv, slack), (near_up, near_down), (placed, resting, waving) = record, near_onset, tabled
    (begin, end), half_way, (friction, pushing, breakaway, wander) = span, 0.5 * mv.size, tables
    (numbers, dt), near = stems, min(near_up, near_down)
    begin_sliding(s, lanes, near_onset)
    for k in range(begin, end):
        o, t, full = np.uint64(k % AHEAD) * lanes, k - half_way, 0
        measured, free = (mv[k], slack[k]) if scale > 0.0 else (0.0, 0.0)
        look_up(s, numbers, placed, friction, pushing, (dt, k, o), row.GOING, near, forces)
        for j in range(resting.size):  # as in ``_rise``: a call at every sample takes 4 % longer
            lane = resting[j]
            at = np.uint64(lane)
            rested = 0.0 if s[row.GOING + at] != 0.0 else s[row.RESTED + at]
            s[row.BREAKAWAY + at], s[row.RESTED + at] = breakaway[lane, int(rested)], rested + 1.0
        _wander(s, waving, wander, k)
        if k == end - 1:
            note_force(s, forces, lanes, o)
        for i in range(lanes):
            x, going, product = s[row.X + i], s[row.GOING + i], s[row.PRODUCT + i]
            grown = 1.0 + s[row.GROWTH + i] * k
            level, jump = s[row.HALF_S + i] * grown + s[row.FRICTION + i], s[row.HALF_J + i] * grown
            fs, fd = level + jump + s[row.BREAKAWAY + i], level - jump
            share, least, pushed = s[row.SHARE + i], s[row.LEAST_GAP + i], s[row.FORCE + i]
            gain, offset = s[row.GAIN + i], s[row.OFFSET + i]
            drift, wandered = s[row.DRIFT + i], s[row.WANDER + i]
            f = forces[o + i] - x - pushed
            rises_from, falls_from = near_up * fs, -near_down * fs
            going, way = slid(f, going, falls_from, rises_from, fd, share, least)
            x += way
            read = reading(x, gain, offset, drift, wandered, t)
            product *= loss_factor(measured - read, free, scale)
            forces[o + i] = read
            s[row.X + i], s[row.GOING + i], s[row.PRODUCT + i] = x, going, product
            full += 1 if product > FULL else 0
        if full > 0 and scale > 0.0:
            settle_losses(s, int(lanes), block, FULL, scale, losses)
    end_sliding(s, lanes)
    return end


@never_raises
def _start(
    s: Floats, lanes: int, t: float, seen: tuple[float, float, float], laid_force: Floats
) -> int:
    """Take reading and loss of all lanes at a START, where nothing moves; returns how many products
    are full.

    ``seen`` are MV, its slack and the scale of the loss; the readings are written to
    ``laid_force``.
    """
    full, (measured, free, scale) = 0, seen
    for i in range(np.uint64(lanes)):
        laid_force[i] = reading(
            s[row.Z + i], s[row.GAIN + i], s[row.OFFSET + i], s[row.DRIFT + i], s[row.WANDER + i], t
        )
        s[row.PRODUCT + i] *= loss_factor(measured - laid_force[i], free, scale)
        full += 1 if s[row.PRODUCT + i] > FULL else 0
    return full


@never_raises
def _end_of_alike(
    k: int,
    last_sample: int,
    marks: NDArray[np.uint8],
    block: NDArray[np.int64],
    up: int,
    down: int,
    patience: int,
) -> int:
    """The end of the stretch from ``k`` on in which nothing rare happens: one block, no mark, no
    onset.
    """
    end = min(last_sample, up if up <= k + patience else up - patience)
    end = min(end, down if down <= k + patience else down - patience)
    end, last, b = max(end, k + 1), k + 1, block[k]
    while last < end:
        if (marks[last] != 0) | (block[last] != b):
            end = last
        last += 1
    return end


@never_raises
def _strained(s: Floats, numbers: Floats, forces: Floats) -> None:
    """At a mark: stems that give way have done so to the force that they are under."""
    for lane in range(numbers.shape[0]):
        i = np.uint64(lane)
        if numbers[lane, stem_number.GIVES] != 0.0:
            s[row.FORCE_AFTER + i] = forces[lane] - s[row.X + i] - s[row.FORCE + i]


@never_raises
def _wander_and_rest(
    s: Floats,
    numbers: Floats,
    tables: Tables,
    seen: tuple[float, float, int],
    k: int,
    t: float,
    laid_out: Floats,
) -> None:
    """Before sample ``k``: set how far readings wander, and at a mark set resting stems to where
    they were ``seen`` (MV, MV one sample ago, and the mark), within the band that their force
    allows.
    """
    (now, ago, mark), (friction, force, breakaway, wander) = seen, tables
    start = mark == _START
    for lane in range(numbers.shape[0]):
        i, q = np.uint64(lane), numbers[lane]
        if q[stem_number.BY_TIME] != 0.0:
            s[row.WANDER + i] = wander[lane, k]
        if not (start or (mark == _RESYNC and s[row.MOVING + i] == 0.0)):
            continue
        offset = s[row.OFFSET + i] + s[row.DRIFT + i] * t + s[row.WANDER + i]
        z, half = ((now if start else ago) - offset) / s[row.GAIN + i] + 50.0, s[row.HALF_PLAY + i]
        level = abs(s[row.HALF_S + i] + s[row.HALF_J + i])
        band = level * (1.0 + abs(s[row.GROWTH + i]) * k) + half
        if q[stem_number.BY_PLACE] != 0.0:
            band += abs(table_value(friction, lane, z)) + abs(table_value(force, lane, z))
            band += q[stem_number.HYSTERESIS]
        if q[stem_number.BY_REST] != 0.0 and not start:
            band += breakaway[lane, int(s[row.RESTED + i])]
        z = min(max(z, laid_out[lane] - band), laid_out[lane] + band)
        # At a RESYNC it rests within the play of its reading.
        s[row.X + i] = z if start else min(max(s[row.X + i], z - half), z + half)
        s[row.Z + i], s[row.MOVING + i], s[row.SPEED + i] = z, 0.0, 0.0
        s[row.RESTED + i] = 0.0 if start else s[row.RESTED + i]
        if start and q[stem_number.HYSTERESIS] != 0.0:
            anchor(s, i, q[stem_number.WAY], z, (laid_out[lane] - z) / band)
    if mark != 0:
        _strained(s, numbers, laid_out)


@never_raises
def _charge_onsets(
    s: Floats,
    before: Floats,
    sides: tuple[bool, bool],
    costs: tuple[float, float, float],
    k: int,
    b: int,
    losses: Floats,
    early_late: Floats,
) -> None:
    """After sample ``k``: where the recorded stem broke away, add the loss of each lane for it.

    ``sides``: whether it was seen to rise, to fall. ``costs``: the scatter, the weight of a
    breakaway in samples, and 1/delta^2.
    """
    up, down = sides
    scatter, event, scale = costs
    for lane in range(losses.shape[0] if up or down else 0):
        late = _early_late(s, np.uint64(lane), before[lane], up, down)
        if early_late.size > 0:
            early_late[lane, k] = late
        if late != 0.0 and b >= 0:
            e = late / scatter
            losses[lane, b] += event * np.log(1.0 + e * e) / scale


@never_raises
def _note(s: Floats, m: int, before: Floats) -> None:
    """Copy the force after the last sample, of ``m`` lanes, into ``before``; one by one, since
    copying a slice would compile numba's error about shapes too.
    """
    for lane in range(m):
        before[lane] = s[row.FORCE_AFTER + np.uint64(lane)]


@never_raises
def follow(
    force: Floats,
    rows: NDArray[np.int64],
    numbers: Floats,
    tables: Tables,
    record: Record,
    scoring: Scoring,
    losses: Floats,
    out: Floats,
    early_late: Floats,
) -> None:
    """Run ``m <= LANES`` stems of ``numbers`` (m, 22), each over a row of ``force`` (r, n).

    ``rows`` (m,) says which; forces must be finite, percent. ``losses`` (m, blocks) receives the
    sums of the loss, ``out`` (n, m) the readings sample by sample, percent of MV, and
    ``early_late`` (m, n), at the samples where the recorded stem lets go, how far the force was
    below (negative) or beyond ``fs``, percent, or 0 where the run did not let go with it, as in one
    without a window. Of the last two, empty ones are left alone.
    """
    # Unpacked first: an array that is read from the tuple is reference-counted at every sample.
    mv, marks, next_up, next_down, dt, window = record
    block, slack, delta, scatter, event = scoring
    friction, pushing, breakaway, wander = tables
    n, m, scale, patience = mv.size, rows.size, 1.0 / (delta * delta), int(_PATIENCE_S / dt)
    lanes = (m + WIDTH - 1) // WIDTH * WIDTH
    s, laid_out, before = np.empty(row.COUNT * LANES), np.empty(AHEAD * LANES), np.empty(LANES)
    _begin(s, numbers, lanes, force, rows, dt)
    varied, timed, heavy = used(numbers)
    slides, varies = alike(numbers), varied or timed or drifts(numbers)
    tables_of = placed, rested, waving = _tabled(numbers)
    weighty = numbers[: m if heavy else 0]
    losses[:], early_late[:, : 0 if window > 0.0 else n] = 0.0, 0.0
    all_lanes, k, current, full = np.uint64(lanes), _I(0), _I(-1), _I(0)
    while k < n:
        next_forces(force, rows, k, lanes, laid_out, out)
        b, mark, t, o = block[k], marks[k], k - 0.5 * n, k % AHEAD * lanes
        if b >= 0 and (b != current or full > 0):
            settle_losses(s, lanes, current, 0.0 if b != current else FULL, scale, losses)
            current, full = b, 0
        charged = scale if b >= 0 else 0.0
        if timed or mark != 0:
            seen = mv[k], mv[k - 1], int(mark)
            _wander_and_rest(s, numbers, tables, seen, k, t, laid_out[o:])
        if mark == _START:
            full += _start(s, m, t, (mv[k], slack[k], charged), laid_out[o:])
            early_late[:, k : k + 1] = 0.0
            k += 1
            continue
        up, down = window > 0.0 and next_up[k] == k, window > 0.0 and next_down[k] == k
        last = k + 1 if up or down or mark != 0 or heavy else min(n, k - k % AHEAD + AHEAD)
        end = _end_of_alike(k, last, marks, block, next_up[k], next_down[k], patience)
        near_onset = _near_onsets(next_up[k], next_down[k], k, n, window, patience)
        _note(s, m, before)
        begun, charged_more = k, _I(0)
        if slides and not (up or down):
            if varies:
                k = _slide_varied(s, laid_out, all_lanes, near_onset, (mv, slack), charged,
                    (k, end), current, losses, tables_of, tables, (numbers, dt))  # fmt: skip
            else:
                k = slide(s, laid_out, all_lanes, near_onset, mv, slack, charged, k, end,
                    current, losses)  # fmt: skip
        while k < end and charged_more == 0:
            if varied:  # not one function: passing all tables takes as long as using them
                sample, near = (dt, k, np.uint64(k % AHEAD * lanes)), min(*near_onset)
                look_up(s, numbers, placed, friction, pushing, sample, row.MOVING, near, laid_out)
                _rise(s, rested, breakaway)
                _set_levels(s, all_lanes, k)
                _give_way(s, numbers, sample, laid_out)
            if timed:
                _wander(s, waving, wander, k)
            _move_heavy(s, weighty, laid_out[o:], near_onset, dt)
            stop = k + 1 if varied or timed else end
            k, charged_more = move(s, laid_out, all_lanes, near_onset, mv, slack, charged, k, stop)
        full += charged_more
        _after_heavy(s, weighty)
        _charge_onsets(s, before, (up, down), (scatter, event, scale), begun, b, losses, early_late)
    settle_losses(s, lanes, current, 0.0, scale, losses)
    keep_readings(laid_out, n, lanes, out)
