"""The stem's kernel: sticking, slipping, sliding, stops, play and the reading, over a force.

The element is the canonical one of Choudhury, Thornhill and Shah (2005): levels
``fs = (S + J)/2`` and ``fd = (S - J)/2``, ``F = p - x - force(x)``. What is added to it:

- whether a moving stem sticks again is decided by its own speed and the force on it. With
  ``gap = d F - fd`` the stem moves ``a gap`` in a sample, ``a = 1 - exp(-dt / DRAG_S)``; it sticks
  where that is no faster than ``RESTICK``. Without drag ``gap`` is the step of the force, and this
  is the canonical test; with drag, the stem goes on after the command has turned.
- friction may depend on place (``friction``, added to both levels), on the rest before
  (``breakaway``, added to ``fs``), on direction (``ASYMMETRY``: J (1 + a) rising, J (1 - a)
  falling) and on time (``GROWTH``: both levels times 1 + g t/T),
- a force may depend on place (``force``), a resting stem may creep, stops may hold it,
- between stem and reading there may be play, and the reading may drift:
  ``MV = gain (z - 50) + 50 + zero + drift (t/T - 1/2) + wander(t)``.

No two breakaways of a real stem are equal (5 to 12 % scatter is normal), and on a slow ramp a
breakaway that comes a little late costs a whole jump for a long time. A run may therefore be
*assimilated*: where the recording shows the stem let go (``onsets``), and the force is within a
window of ``fs``, the stem lets go there, and what is charged is how far the force was from
``fs``, not the time. All hypotheses are compared this way; what is shown to people is a free run.

The tables over place have ``PLACES`` entries from ``PLACE_LOW`` to ``PLACE_HIGH`` percent and are
read by linear interpolation, so that a new law of friction needs no change here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from stemwatch.models.recording import Floats
from stemwatch.models.stickslip.kernel import Marks

(
    S,
    J,
    ASYMMETRY,
    GROWTH,
    CREEP,
    DRAG_S,
    RESTICK,
    STOP_LOW,
    STOP_HIGH,
    PLAY,
    GAIN,
    ZERO,
    DRIFT,
    BY_PLACE,
    BY_REST,
    BY_TIME,
) = range(16)
N_NUMBERS = 16

_NEUTRAL = np.zeros(N_NUMBERS)
_NEUTRAL[[GAIN, STOP_LOW, STOP_HIGH]] = 1.0, -np.inf, np.inf
EVENT = 3.0  # samples that a breakaway counts for
PLACE_LOW, PLACE_HIGH, PLACES = -20.0, 120.0, 141
_START, _RESYNC = 1, 2
_ROUNDING = 1e-9  # percent; a smaller step of the force is a held command
# A stem that drags towards its end of travel never quite arrives; below this speed it stands.
_STANDS_BELOW = 0.01  # percent per second
_PATIENCE_S = 120.0  # how long an assimilated run waits for a breakaway that the recording shows


@dataclass
class Stem:
    """Numbers (16,) and tables of one run; ``clear`` makes it the canonical element again.

    ``friction`` and ``force`` (141,) over place, ``breakaway`` (n + 1,) over the samples rested,
    ``wander`` (n + 1,) of the reading over time, all in percent of span. A term that fills a table
    sets ``numbers[BY_PLACE]``, ``numbers[BY_REST]`` or ``numbers[BY_TIME]`` to 1.
    """

    numbers: Floats
    friction: Floats
    force: Floats
    breakaway: Floats
    wander: Floats
    interval_s: float

    @classmethod
    def neutral(cls, samples: int, interval_s: float) -> Stem:
        """A stem without friction whose tables suit a recording of ``samples``."""
        times = np.zeros(samples + 1), np.zeros(samples + 1)
        tables = np.zeros(PLACES), np.zeros(PLACES), *times
        stem = cls(np.zeros(N_NUMBERS), *tables, interval_s)
        stem.clear()
        return stem

    def clear(self) -> None:
        """Everything neutral; the tables only where they were used."""
        q = self.numbers
        if q[BY_PLACE] != 0.0:
            self.friction[:] = 0.0
            self.force[:] = 0.0
        if q[BY_REST] != 0.0:
            self.breakaway[:] = 0.0
        if q[BY_TIME] != 0.0:
            self.wander[:] = 0.0
        q[:] = _NEUTRAL


def places() -> Floats:
    """(141,) the places of the tables, percent of travel."""
    return np.linspace(PLACE_LOW, PLACE_HIGH, PLACES)


@njit(cache=True)
def _at(table: Floats, x: float) -> float:
    """The table at place ``x``, linear between its entries and constant beyond."""
    place = (x - PLACE_LOW) * ((PLACES - 1) / (PLACE_HIGH - PLACE_LOW))
    place = min(max(place, 0.0), PLACES - 1.000001)
    i = int(place)
    value: float = table[i] + (place - i) * (table[i + 1] - table[i])
    return value


@njit(cache=True)
def _clip(x: float, low: float, high: float) -> float:
    inside: float = min(max(x, low), high)
    return inside


@njit(cache=True)
def _share(dt: float, q: Floats) -> float:
    """The share of its way that a dragging stem makes in a sample."""
    made: float = 1.0 - np.exp(-dt / q[DRAG_S]) if q[DRAG_S] > 1e-3 else 1.0
    return made


@njit(cache=True)
def _least(dt: float, q: Floats) -> float:
    """The speed below which the stem sticks, as a gap; a negative one lets only a turn stop it."""
    share = _share(dt, q)
    speed = max(q[RESTICK], _STANDS_BELOW if share < 1.0 else 0.0)
    gap: float = max(speed * dt / share, _ROUNDING) if q[RESTICK] >= 0.0 else -_ROUNDING
    return gap


@njit(cache=True)
def _sliding(level: float, half_jump: float, d: float, asymmetry: float) -> float:
    """The level ``fd`` of a stem that slides in direction ``d``, percent."""
    fd: float = level - half_jump * (1.0 + d * asymmetry)
    return fd


@njit(cache=True)
def _lets_go(
    size: float,
    before: float,
    fs: float,
    window: float,
    ahead: int,
    left: bool,
    patience: int,
) -> tuple[bool, float]:
    """Whether a stuck stem lets go under a force of ``size``, and how far that was from ``fs``.

    ``ahead`` samples on, the recorded stem next lets go in this direction, if any is ``left``;
    ``before`` is the force one sample ago, in the same direction.
    """
    goes = size > fs
    if window <= 0.0 or size <= (1.0 - window) * fs:
        return goes, 0.0
    if left and ahead == 0:
        # It let go between two samples: neither early nor late if fs lies between.
        if size < fs:
            return True, size - fs
        return True, min(before, size) - fs if before > fs else 0.0
    if goes and size <= (1.0 + window) * fs:
        return not left or ahead > patience, 0.0
    return goes, 0.0


@njit(cache=True)
def run(
    p: Floats,
    mv: Floats,
    marks: Marks,
    dt: float,
    q: Floats,
    friction: Floats,
    force: Floats,
    breakaway: Floats,
    wander: Floats,
    next_up: NDArray[np.int64],
    next_down: NDArray[np.int64],
    window: float,
    early_late: Floats,
    out: Floats,
) -> None:
    """Run of the stem over the force ``p`` (n,), percent, into ``out`` (n,), percent of MV.

    ``marks`` (n,): at START the whole state is taken from ``mv``, at RESYNC only the place where a
    resting stem rests. ``p`` must be finite. ``next_up`` and ``next_down`` (n,) are the samples at
    which the recorded stem next lets go, or n; ``window`` (a share of ``fs``, 0: a free run) is how
    far from ``fs`` it may do so, and ``early_late`` (n,) receives how far the force was below
    (negative) or beyond ``fs`` at each assimilated breakaway, percent, else 0.
    """
    early_late[:] = 0.0
    tables, upcoming = (friction, force, breakaway, wander), (next_up, next_down)
    _follow(p, mv, marks, dt, q, tables, upcoming, window, early_late, out)
    _read(q[GAIN], 50.0 + q[ZERO], q[DRIFT] / p.size, wander, q[BY_TIME] != 0.0, out)


@njit(cache=True)
def _follow(  # one loop; what it calls is inlined
    p: Floats,
    mv: Floats,
    marks: Marks,
    dt: float,
    q: Floats,
    tables: tuple[Floats, Floats, Floats, Floats],
    upcoming: tuple[NDArray[np.int64], NDArray[np.int64]],
    window: float,
    early_late: Floats,
    out: Floats,
) -> None:
    """``run`` without the reading: ``out`` is the place of the reading's end of the stem."""
    (friction, force, breakaway, wander), (next_up, next_down) = tables, upcoming
    n, share, least = p.size, _share(dt, q), _least(dt, q)
    # Copies: the compiler cannot know that nothing here writes to ``q``.
    s_half, j_half, asymmetry, growth = 0.5 * q[S], 0.5 * q[J], q[ASYMMETRY], q[GROWTH] / n
    half, creep, low, high = 0.5 * q[PLAY], q[CREEP] * dt, q[STOP_LOW], q[STOP_HIGH]
    gain, zero, drift, patience = q[GAIN], 50.0 + q[ZERO], q[DRIFT] / n, int(_PATIENCE_S / dt)
    by_place, by_rest, by_time = q[BY_PLACE] != 0.0, q[BY_REST] != 0.0, q[BY_TIME] != 0.0
    steady = growth == 0.0 and creep == 0.0 and not by_rest  # at rest nothing changes but ``p``
    x = z = p[0]
    moving, resting, d, rest, before, near = False, False, 1.0, 0, 0.0, 1.0 - window
    level = pushed = was = up = down = 0.0
    rise, fall = j_half * (1.0 + asymmetry), j_half * (1.0 - asymmetry)
    for k in range(n):
        mark = marks[k]
        if resting and mark == 0:
            f = p[k] - x - pushed
            if -down <= f <= up:
                out[k], before = z, f + x - x
                rest += 1
                continue
        grown = 1.0 + growth * k
        if mark == _START or (mark == _RESYNC and not moving):
            offset = zero + drift * (k - 0.5 * n) + (wander[k] if by_time else 0.0)
            z = ((mv[k] if mark == _START else mv[k - 1]) - offset) / gain + 50.0
            band = abs(s_half + j_half) * (1.0 + abs(growth) * k) + half
            band += abs(_at(friction, z)) + abs(_at(force, z)) if by_place else 0.0
            z = _clip(z, p[k] - band, p[k] + band)
            # At a RESYNC it rests within the play of its reading.
            x = z if mark == _START else _clip(x, z - half, z + half)
            moving, rest = False, 0 if mark == _START else rest
        if mark != _START:
            level = s_half * grown + (_at(friction, x) if by_place else 0.0)
            pushed = _at(force, x) if by_place else 0.0
            f, was = p[k] - x - pushed, x
            if moving and d * f - _sliding(level, j_half * grown, d, asymmetry) <= least:
                moving, rest = False, 0
            if not moving:
                side = 1.0 if f > 0.0 else -1.0
                fs = level + j_half * grown * (1.0 + side * asymmetry)
                fs += breakaway[rest] if by_rest else 0.0
                seen_at = next_up[k] if side > 0.0 else next_down[k]
                moving, early_late[k] = _lets_go(
                    abs(f), side * before, fs, window, seen_at - k, seen_at < n, patience
                )
                d = side if moving else d
                rest, x = rest + 1, x + (0.0 if moving else creep)
            if moving:
                gap = d * f - _sliding(level, j_half * grown, d, asymmetry)
                x += share * d * max(gap, 0.0)  # friction never pushes the stem back
            before = f + was - x
            x = _clip(x, low, high)
            z = _clip(z, x - half, x + half)
        out[k] = z
        # Until the force comes near a breakaway, or the record begins anew, it just rests.
        resting = steady and not moving and mark != _START and x == was
        if resting:
            up, down = near * (level + rise), near * (level + fall)


@njit(cache=True)
def _read(
    gain: float, zero: float, drift: float, wander: Floats, by_time: bool, out: Floats
) -> None:
    """Places of the reading's end, in ``out`` (n,), to what is read, percent of MV."""
    n = out.size
    for k in range(n):
        offset = zero + drift * (k - 0.5 * n) + (wander[k] if by_time else 0.0)
        out[k] = gain * (out[k] - 50.0) + offset


@njit(cache=True)
def block_loss(
    simulated: Floats,
    mv: Floats,
    slack: Floats,
    block: NDArray[np.int64],
    delta: float,
    early_late: Floats,
    scatter: float,
    event: float,
    losses: Floats,
) -> None:
    """Sums of the Cauchy loss ``delta^2 log(1 + (r/delta)^2)`` per block into ``losses`` (b,).

    ``block`` (n,) is the block number of a sample, negative where it is not scored; neighbours
    must be grouped. ``slack`` (n,) is how far a value may lie from ``mv`` at no cost, percent: 0
    where it was measured. One logarithm serves many samples. A breakaway that was assimilated
    ``early_late`` percent from its level costs ``event`` times
    ``delta^2 log(1 + (early_late/scatter)^2)``.
    """
    losses[:] = 0.0
    scale = 1.0 / (delta * delta)
    product, current = 1.0, -1
    for k in range(simulated.size):
        b = block[k]
        if b < 0:
            continue
        if b != current or product > 1e200:
            if current >= 0:
                losses[current] += np.log(product) / scale
            product, current = 1.0, b
        r = max(abs(mv[k] - simulated[k]) - slack[k], 0.0)
        product *= 1.0 + r * r * scale
        if early_late[k] != 0.0:
            e = early_late[k] / scatter
            losses[current] += event * np.log(1.0 + e * e) / scale
    if current >= 0:
        losses[current] += np.log(product) / scale
