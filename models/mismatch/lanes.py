"""The lanes in which candidates run side by side: their array, and how all of them move.

Row by row the array holds the state of all lanes (``s[_X + i]`` is the place of the stem in lane
``i``), then the constants of their runs. ``_slide`` is the common case: friction and drag, alike in
both directions. ``kernel`` has everything else, and what is rare. Its cache of compiled code does
not notice a change here: clear it, or save ``kernel`` as well.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from stemwatch.models.mismatch import stem as stem_number
from stemwatch.models.recording import Floats

LANES = 32  # candidates that run side by side at most
_FULL = 1e200  # a product of losses this large is replaced by its logarithm
_AHEAD = 64  # samples of the forces that are transposed to lanes at once
WIDTH = 8  # lanes of a vector; a remainder of lanes would run without vectors
_U = np.uint64
# Rows of the lanes' array: state of the stem; constants of a run; levels; reading and loss.
_ROWS = 36
(_X, _Z, _SIDE, _MOVING, _BEFORE, _LEAVES, _RESTED) = [_U(i * LANES) for i in range(7)]
(_SHARE, _LEAST, _STEP, _LOW, _HIGH, _HALF) = [_U(i * LANES) for i in range(7, 13)]
(_S_HALF, _J_HALF, _UNEVEN, _GROWN) = [_U(i * LANES) for i in range(13, 17)]
(_FS_UP, _FS_DOWN, _FD_UP, _FD_DOWN, _PUSHED) = [_U(i * LANES) for i in range(17, 22)]
(_SPAN, _OFFSET, _DRIFTS, _WANDER, _PRODUCT) = [_U(i * LANES) for i in range(22, 27)]
(_FRICTION, _RISE, _LOOKED_UP) = [_U(i * LANES) for i in range(27, 30)]
(_SPEED, _HAS_LEFT, _WAS_AT) = [_U(i * LANES) for i in range(30, 33)]
(_GOING, _RISES_FROM, _FALLS_FROM) = [_U(i * LANES) for i in range(33, 36)]
# A function that may raise counts array references at each call.
_QUIET = njit(cache=True, error_model="numpy")


@njit(cache=True)
def _reading(z: float, gain: float, offset: float, drift: float, wander: float, t: float) -> float:
    """The reading of the place ``z``, percent of MV, ``t`` samples from the record's middle."""
    return gain * (z - 50.0) + (offset + drift * t + wander)


@njit(cache=True)
def _cost(residual: float, slack: float, scale: float) -> float:
    """The factor 1 + (r/delta)^2 of a ``residual`` in percent; ``scale`` is 1/delta^2."""
    r = abs(residual) - slack
    r = r if r > 0.0 else 0.0
    return 1.0 + r * r * scale


@_QUIET
def _settle(s: Floats, lanes: int, b: int, least: float, scale: float, losses: Floats) -> None:
    """Add the logarithms of the products beyond ``least`` to block ``b``, and reset them to 1.

    Spare lanes are reset too: a product that stays full would end every stretch.
    """
    for lane in range(lanes):
        i = _U(lane)
        if s[_PRODUCT + i] > least:
            if lane < losses.shape[0] and b >= 0:
                losses[lane, b] += np.log(s[_PRODUCT + i]) / scale
            s[_PRODUCT + i] = 1.0


@njit(cache=True)
def _lay_out(
    force: Floats, rows: NDArray[np.int64], begin: int, lanes: int, target: Floats
) -> None:
    """Transpose the next forces to lanes, four at a time, so that neighbours are written together;
    spare lanes repeat the last candidate.
    """
    end, last = min(begin + _AHEAD, force.shape[1]), rows.size - 1
    for lane in range(0, lanes, 4):
        first, second = _U(rows[min(lane, last)]), _U(rows[min(lane + 1, last)])
        third, fourth = _U(rows[min(lane + 2, last)]), _U(rows[min(lane + 3, last)])
        place = _U(lane)
        for k in range(_U(begin), _U(end)):
            target[place], target[place + _U(1)] = force[first, k], force[second, k]
            target[place + _U(2)], target[place + _U(3)] = force[third, k], force[fourth, k]
            place += _U(lanes)


@njit(cache=True)
def _keep(laid_out: Floats, end: int, lanes: int, out: Floats) -> None:
    """Copy the readings before ``end`` from lanes into ``out`` (n, m)."""
    begin = max(end - 1, 0) // _AHEAD * _AHEAD
    for k in range(_U(begin), _U(min(end, out.shape[0]))):
        first = (k - _U(begin)) * _U(lanes)
        for lane in range(_U(out.shape[1])):
            out[k, lane] = laid_out[first + lane]


@_QUIET
def _next_forces(
    force: Floats, rows: NDArray[np.int64], k: int, lanes: int, laid_out: Floats, out: Floats
) -> None:
    """Where the forces that are laid out end at ``k``, keep their readings and lay out the next."""
    if k % _AHEAD == 0:
        _keep(laid_out, k, lanes, out)
        _lay_out(force, rows, k, lanes, laid_out)


@njit(cache=True)
def _move(
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

    ``forces`` (_AHEAD lanes,) are transposed to lanes, and each is overwritten by the reading. A
    stuck stem breaks away beyond ``near_onset`` times ``fs``, rising and falling. With a ``scale``
    of 0 no loss is added. Returns the sample at which it stopped (``end``, or earlier where
    products of losses are full) and how many products are full.
    """
    near_up, near_down = near_onset
    k, full, half_way = begin, 0, 0.5 * mv.size
    while k < end and full == 0:
        o, t = _U(k % _AHEAD) * lanes, k - half_way
        seen, free = (mv[k], slack[k]) if scale > 0.0 else (0.0, 0.0)
        for i in range(lanes):
            x, z, d, moving = s[_X + i], s[_Z + i], s[_SIDE + i], s[_MOVING + i]
            fs_up, fs_down = s[_FS_UP + i], s[_FS_DOWN + i]
            fd_up, fd_down = s[_FD_UP + i], s[_FD_DOWN + i]
            share, least, step = s[_SHARE + i], s[_LEAST + i], s[_STEP + i]
            low, high, half = s[_LOW + i], s[_HIGH + i], s[_HALF + i]
            gain, offset = s[_SPAN + i], s[_OFFSET + i]
            drift, wander = s[_DRIFTS + i], s[_WANDER + i]
            product = s[_PRODUCT + i]
            f = forces[o + i] - x - s[_PUSHED + i]
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
            s[_LEAVES + i] = 0.0 if moving > 0.0 else leaves
            d = d if moving > 0.0 else turned
            gap = gap_on if moving > 0.0 else gap
            gap = gap if gap > 0.0 else 0.0  # friction never pushes the stem back
            moving = moving if moving > 0.0 else goes
            slid, crept = x + share * d * gap, x + step
            new_place = slid if moving > 0.0 else crept
            s[_BEFORE + i] = f + x - new_place
            new_place = new_place if new_place > low else low
            new_place = new_place if new_place < high else high
            behind, ahead = new_place - half, new_place + half
            z = z if z > behind else behind
            z = z if z < ahead else ahead
            read = _reading(z, gain, offset, drift, wander, t)
            product *= _cost(seen - read, free, scale)
            forces[o + i] = read
            s[_X + i], s[_Z + i], s[_SIDE + i], s[_MOVING + i] = new_place, z, d, moving
            s[_PRODUCT + i] = product
            full += 1 if product > _FULL else 0
        k += 1
    return k, full


@njit(cache=True)
def alike(numbers: Floats) -> bool:
    """Whether no stem has inertia, creeps, meets a stop, has play, or jumps differently in its two
    directions: ``_slide`` and ``_slide_varied`` then do what ``_move`` does, with less work.
    """
    for q in numbers:
        if (
            q[stem_number.ASYMMETRY] != 0.0
            or q[stem_number.CREEP] != 0.0
            or q[stem_number.STOP_LOW] > -np.inf
            or q[stem_number.STOP_HIGH] < np.inf
            or q[stem_number.PLAY] != 0.0
            or q[stem_number.RUN_UP_S] > 0.0
        ):
            return False
    return True


@njit(cache=True)
def drifts(numbers: Floats) -> bool:
    """Whether the reading of some stem drifts."""
    any_drifts = False
    for q in numbers:
        any_drifts |= q[stem_number.DRIFT] != 0.0
    return any_drifts


@njit(cache=True)
def _enter(s: Floats, lanes: np.uint64, near_onset: tuple[float, float]) -> None:
    """Before ``_slide``: the side of the motion, 0 at rest, and the forces that break away."""
    near_up, near_down = near_onset
    for i in range(lanes):
        s[_GOING + i] = s[_SIDE + i] if s[_MOVING + i] > 0.0 else 0.0
        s[_RISES_FROM + i] = near_up * s[_FS_UP + i]
        s[_FALLS_FROM + i] = -near_down * s[_FS_DOWN + i]


@njit(cache=True)
def _leave(s: Floats, lanes: np.uint64) -> None:
    """After ``_slide``: side, motion and reading place as ``_move`` keeps them."""
    for i in range(lanes):
        going = s[_GOING + i]
        s[_SIDE + i] = going if going != 0.0 else s[_SIDE + i]
        s[_MOVING + i], s[_Z + i] = abs(going), s[_X + i]


@_QUIET
def _slide(
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
    """``_move`` of stems that are ``alike``, with levels and readings that do not change, and
    without what only a breakaway that is seen asks for (rows ``_LEAVES`` and ``_BEFORE``). Products
    that are full are added to ``block`` on the way. Returns ``end``.

    The same to the last bit: what is left out would multiply by 1 or add 0.
    """
    _enter(s, lanes, near_onset)
    for k in range(begin, end):
        o, full = _U(k % _AHEAD) * lanes, 0
        seen, free = (mv[k], slack[k]) if scale > 0.0 else (0.0, 0.0)
        for i in range(lanes):
            x, going, product = s[_X + i], s[_GOING + i], s[_PRODUCT + i]
            rises_from, falls_from = s[_RISES_FROM + i], s[_FALLS_FROM + i]
            fd, share, least = s[_FD_UP + i], s[_SHARE + i], s[_LEAST + i]
            gain, offset = s[_SPAN + i], s[_OFFSET + i]
            f = forces[o + i] - x
            goes = -1.0 if f < falls_from else 0.0
            goes = 1.0 if f > rises_from else goes
            goes_on = (going * f - fd > least) & (going != 0.0)
            going = going if goes_on else goes
            gap = going * f - fd
            gap = gap if gap > 0.0 else 0.0
            x += share * going * gap
            read = gain * (x - 50.0) + offset
            product *= _cost(seen - read, free, scale)
            forces[o + i] = read
            s[_X + i], s[_GOING + i], s[_PRODUCT + i] = x, going, product
            full += 1 if product > _FULL else 0
        if full > 0 and scale > 0.0:
            _settle(s, int(lanes), block, _FULL, scale, losses)
    _leave(s, lanes)
    return end
