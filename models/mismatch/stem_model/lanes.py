"""How the stems of all lanes move, side by side.

``lane_rows`` says what each row of their array ``s`` holds. ``slide`` is the common case: friction
and drag, alike in both directions. ``kernel`` has everything else, and what is rare.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.compiled import compiled
from stemwatch.models.mismatch.stem_model import lane_rows as row
from stemwatch.models.mismatch.stem_model import stem as stem_number
from stemwatch.models.recording import Floats

FULL = 1e200  # a product of losses this large is replaced by its logarithm
AHEAD = 64  # samples of the forces that are transposed to lanes at once
WIDTH = 8  # lanes of a vector; a remainder of lanes would run without vectors
# Without Python's check for a division by zero: a function that may raise counts array references
# at each call, which takes as long as its work. Divisors here are never zero.
never_raises = compiled(error_model="numpy")


@never_raises
def reading(z: float, gain: float, offset: float, drift: float, wander: float, t: float) -> float:
    """The reading of the place ``z``, percent of MV, ``t`` samples from the record's middle."""
    return gain * (z - 50.0) + (offset + drift * t + wander)


@never_raises
def loss_factor(residual: float, slack: float, scale: float) -> float:
    """The factor 1 + (r/delta)^2 of a ``residual`` in percent; ``scale`` is 1/delta^2."""
    r = abs(residual) - slack
    r = r if r > 0.0 else 0.0
    return 1.0 + r * r * scale


@never_raises
def settle_losses(
    s: Floats, lanes: int, b: int, least: float, scale: float, losses: Floats
) -> None:
    """Add the logarithms of the products beyond ``least`` to block ``b``, and reset them to 1.

    Spare lanes are reset too: a product that stays full would end every stretch.
    """
    for lane in range(lanes):
        i = np.uint64(lane)
        if s[row.PRODUCT + i] > least:
            if lane < losses.shape[0] and b >= 0:
                losses[lane, b] += np.log(s[row.PRODUCT + i]) / scale
            s[row.PRODUCT + i] = 1.0


@never_raises
def _lay_out(
    force: Floats, rows: NDArray[np.int64], begin: int, lanes: int, target: Floats
) -> None:
    """Transpose the next forces to lanes, four at a time, so that neighbours are written together;
    spare lanes repeat the last candidate.
    """
    end, last = min(begin + AHEAD, force.shape[1]), rows.size - 1
    for lane in range(0, lanes, 4):
        first, second = np.uint64(rows[min(lane, last)]), np.uint64(rows[min(lane + 1, last)])
        third, fourth = np.uint64(rows[min(lane + 2, last)]), np.uint64(rows[min(lane + 3, last)])
        place = np.uint64(lane)
        for k in range(np.uint64(begin), np.uint64(end)):
            target[place] = force[first, k]
            target[place + np.uint64(1)] = force[second, k]
            target[place + np.uint64(2)] = force[third, k]
            target[place + np.uint64(3)] = force[fourth, k]
            place += np.uint64(lanes)


@never_raises
def keep_readings(laid_out: Floats, end: int, lanes: int, out: Floats) -> None:
    """Copy the readings before ``end`` from lanes into ``out`` (n, m)."""
    begin = max(end - 1, 0) // AHEAD * AHEAD
    for k in range(np.uint64(begin), np.uint64(min(end, out.shape[0]))):
        first = (k - np.uint64(begin)) * np.uint64(lanes)
        for lane in range(np.uint64(out.shape[1])):
            out[k, lane] = laid_out[first + lane]


@never_raises
def next_forces(
    force: Floats, rows: NDArray[np.int64], k: int, lanes: int, laid_out: Floats, out: Floats
) -> None:
    """Where the forces that are laid out end at ``k``, keep their readings and lay out the next."""
    if k % AHEAD == 0:
        keep_readings(laid_out, k, lanes, out)
        _lay_out(force, rows, k, lanes, laid_out)


@never_raises
def move(
    s: Floats,
    forces: Floats,
    lanes: np.uint64,
    near_onset: tuple[float, float],
    mv: Floats,
    slack: Floats,
    scale: float,
    begin: int,
    end: int,
) -> tuple[int, int]:
    """Advance every lane by some samples: stick, break away, slide, read, and add the loss.

    ``forces`` (AHEAD lanes,) are transposed to lanes, and each is overwritten by the reading. A
    stuck stem breaks away beyond ``near_onset`` times ``fs``, rising and falling. With a ``scale``
    of 0 no loss is added. Returns the sample at which it stopped (``end``, or earlier where
    products of losses are full) and how many products are full.
    """
    near_up, near_down = near_onset
    k, full, half_way = begin, 0, 0.5 * mv.size
    while k < end and full == 0:
        o, t = np.uint64(k % AHEAD) * lanes, k - half_way
        measured, free = (mv[k], slack[k]) if scale > 0.0 else (0.0, 0.0)
        for i in range(lanes):
            x, z, d, moving = s[row.X + i], s[row.Z + i], s[row.SIDE + i], s[row.MOVING + i]
            fs_up, fs_down = s[row.FS_UP + i], s[row.FS_DOWN + i]
            fd_up, fd_down = s[row.FD_UP + i], s[row.FD_DOWN + i]
            share, least, step = s[row.SHARE + i], s[row.LEAST_GAP + i], s[row.CREEP + i]
            low, high, half = s[row.STOP_LOW + i], s[row.STOP_HIGH + i], s[row.HALF_PLAY + i]
            gain, offset = s[row.GAIN + i], s[row.OFFSET + i]
            drift, wander = s[row.DRIFT + i], s[row.WANDER + i]
            product = s[row.PRODUCT + i]
            f = forces[o + i] - x - s[row.FORCE + i]
            rises, falls = f > near_up * fs_up, -f > near_down * fs_down
            fd, fd_on = fd_up if rises else fd_down, fd_up if d > 0.0 else fd_down
            # A moving stem goes on where it is fast enough; one that is at rest, or sticks, may
            # break away.
            gap_on, gap = d * f - fd_on, abs(f) - fd
            moving = moving if gap_on > least else 0.0
            goes = 1.0 if rises | falls else 0.0
            leaves = f if rises | falls else 0.0
            turned = -1.0 if falls else d
            turned = 1.0 if rises else turned
            s[row.LET_GO_AT + i] = 0.0 if moving > 0.0 else leaves
            d = d if moving > 0.0 else turned
            gap = gap_on if moving > 0.0 else gap
            gap = gap if gap > 0.0 else 0.0  # friction never pushes the stem back
            moving = moving if moving > 0.0 else goes
            slid, crept = x + share * d * gap, x + step
            new_place = slid if moving > 0.0 else crept
            s[row.FORCE_AFTER + i] = f + x - new_place
            new_place = new_place if new_place > low else low
            new_place = new_place if new_place < high else high
            behind, ahead = new_place - half, new_place + half
            z = z if z > behind else behind
            z = z if z < ahead else ahead
            read = reading(z, gain, offset, drift, wander, t)
            product *= loss_factor(measured - read, free, scale)
            forces[o + i] = read
            s[row.X + i], s[row.Z + i], s[row.SIDE + i], s[row.MOVING + i] = new_place, z, d, moving
            s[row.PRODUCT + i] = product
            full += 1 if product > FULL else 0
        k += 1
    return k, full


@never_raises
def alike(numbers: Floats) -> bool:
    """Whether no stem has inertia, creeps, gives way, meets a stop, has play, or jumps differently
    in its two directions: ``slide`` and ``_slide_varied`` then do what ``move`` does, with less
    work.
    """
    for q in numbers:
        if (
            q[stem_number.ASYMMETRY] != 0.0
            or q[stem_number.CREEP] != 0.0
            or q[stem_number.GIVES] != 0.0
            or q[stem_number.STOP_LOW] > -np.inf
            or q[stem_number.STOP_HIGH] < np.inf
            or q[stem_number.PLAY] != 0.0
            or q[stem_number.RUN_UP_S] > 0.0
        ):
            return False
    return True


@never_raises
def drifts(numbers: Floats) -> bool:
    """Whether the reading of some stem drifts."""
    any_drifts = False
    for q in numbers:
        any_drifts |= q[stem_number.DRIFT] != 0.0
    return any_drifts


@never_raises
def slid(
    f: float,
    going: float,
    falls_from: float,
    rises_from: float,
    fd: float,
    share: float,
    least: float,
) -> tuple[float, float]:
    """The side of the motion in the next sample, 0 at rest, and the way, percent, of a stem under
    the force ``f`` that is ``alike`` in both directions.

    A moving stem goes on where it is fast enough; one that is at rest, or sticks, may break away.
    """
    goes = -1.0 if f < falls_from else 0.0
    goes = 1.0 if f > rises_from else goes
    goes_on = (going * f - fd > least) & (going != 0.0)
    going = going if goes_on else goes
    gap = going * f - fd
    gap = gap if gap > 0.0 else 0.0  # friction never pushes the stem back
    return going, share * going * gap


@never_raises
def begin_sliding(s: Floats, lanes: np.uint64, near_onset: tuple[float, float]) -> None:
    """Before ``slide``: the side of the motion, 0 at rest, and the forces that break away."""
    near_up, near_down = near_onset
    for i in range(lanes):
        s[row.GOING + i] = s[row.SIDE + i] if s[row.MOVING + i] > 0.0 else 0.0
        s[row.RISES_FROM + i] = near_up * s[row.FS_UP + i]
        s[row.FALLS_FROM + i] = -near_down * s[row.FS_DOWN + i]


@never_raises
def note_force(s: Floats, forces: Floats, lanes: np.uint64, o: np.uint64) -> None:
    """Before the last sample of ``slide``: the force on the place of each stem, of which
    ``end_sliding`` takes what the motion leaves. Rounded as in ``move``.
    """
    for i in range(lanes):
        x = s[row.X + i]
        s[row.FORCE_AFTER + i] = forces[o + i] - x - s[row.FORCE + i] + x


@never_raises
def end_sliding(s: Floats, lanes: np.uint64) -> None:
    """After ``slide``: side, motion, reading place and the force that is left as ``move`` keeps
    them.
    """
    for i in range(lanes):
        going = s[row.GOING + i]
        s[row.FORCE_AFTER + i] -= s[row.X + i]
        s[row.SIDE + i] = going if going != 0.0 else s[row.SIDE + i]
        s[row.MOVING + i], s[row.Z + i] = abs(going), s[row.X + i]


@never_raises
def slide(
    s: Floats,
    forces: Floats,
    lanes: np.uint64,
    near_onset: tuple[float, float],
    mv: Floats,
    slack: Floats,
    scale: float,
    begin: int,
    end: int,
    block: int,
    losses: Floats,
) -> int:
    """``move`` of stems that are ``alike``, with levels and readings that do not change, and
    without what only a breakaway that is seen asks for (``LET_GO_AT``, and ``FORCE_AFTER`` but for
    the last sample). Products that are full are added to ``block`` on the way. Returns ``end``.

    The same to the last bit: what is left out would multiply by 1 or add 0.
    """
    begin_sliding(s, lanes, near_onset)
    for k in range(begin, end):
        o, full = np.uint64(k % AHEAD) * lanes, 0
        measured, free = (mv[k], slack[k]) if scale > 0.0 else (0.0, 0.0)
        if k == end - 1:
            note_force(s, forces, lanes, o)
        for i in range(lanes):
            x, going, product = s[row.X + i], s[row.GOING + i], s[row.PRODUCT + i]
            rises_from, falls_from = s[row.RISES_FROM + i], s[row.FALLS_FROM + i]
            fd, share, least = s[row.FD_UP + i], s[row.SHARE + i], s[row.LEAST_GAP + i]
            gain, offset = s[row.GAIN + i], s[row.OFFSET + i]
            f = forces[o + i] - x
            going, way = slid(f, going, falls_from, rises_from, fd, share, least)
            x += way
            read = gain * (x - 50.0) + offset
            product *= loss_factor(measured - read, free, scale)
            forces[o + i] = read
            s[row.X + i], s[row.GOING + i], s[row.PRODUCT + i] = x, going, product
            full += 1 if product > FULL else 0
        if full > 0 and scale > 0.0:
            settle_losses(s, int(lanes), block, FULL, scale, losses)
    end_sliding(s, lanes)
    return end
