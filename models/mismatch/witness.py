"""What a recording exercised, in the numbers by which the audit of effects decides."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.excitation import Slips, reversals, slips, swing
from stemwatch.models.mismatch.facets import moving_stem, rests
from stemwatch.models.recording import Bools, Floats

QUICK_S, OPENING_S, SLOW_S = 5.0, 10.0, 20.0  # windows of a quick move, an opening, a slow ramp
QUICK_PERCENT_PER_S = 0.2  # of a net move over 5 s
SLOW_PERCENT_PER_S = (0.003, 0.25)  # of a ramp on which a stem could stick again and again
OPENING_PERCENT = 2.0
SLIP_NOISE = 0.01  # percent, of a simulated stem
BANDS = 12  # of travel, whose passes are counted


@dataclass(frozen=True, kw_only=True)
class Witness:
    """Counts are of the recording or of the simulated stem, whichever saw more.

    ``travel`` is the range of MV in percent, 1st to 99th percentile; ``moves`` (rising, falling)
    counts the stem's moves between its turns, ``slips`` its jumps; ``quick`` OP's moves by at
    least 0.2 %/s over 5 s each way, ``openings`` its rises by 2 % or more within 10 s; ``restarts``
    starts in the direction of the motion before; ``slow_s`` the time of ramps slower than
    0.25 %/s; ``rests`` (m,) lengths in seconds; ``passes`` the most through any band of travel.
    ``at_low`` and ``at_high`` tell whether MV stands at that end while OP goes further.
    """

    duration_s: float
    travel: float
    moves: tuple[int, int]
    slips: tuple[int, int]
    quick: tuple[int, int]
    openings: int
    restarts: int
    slow_s: float
    resting_s: float
    rests: Floats
    passes: int
    at_low: bool
    at_high: bool


def witness(
    op: Floats,
    mv: Floats,
    simulated: Floats,
    scored: Bools,
    interval_s: float,
    sigma: float,
    S: float,
    J: float,
) -> Witness:
    """Look at a recording; all arrays (n,) finite, percent; ``sigma`` is the noise of MV.

    S and J are those of the base fit, percent.
    """
    moving = moving_stem(simulated, interval_s)
    ends, lengths = rests(moving)
    jumps = slips(mv, op, sigma)
    pairs = [
        (int(np.sum(sizes > 0.0)), int(np.sum(sizes < 0.0)))
        for sizes in (jumps.sizes, slips(simulated, op, SLIP_NOISE).sizes)
    ]
    seen = np.diff(jumps.begins) * interval_s
    return Witness(
        duration_s=float(np.count_nonzero(scored)) * interval_s,
        travel=swing(mv[scored]) if scored.any() else 0.0,
        moves=_moves(mv, simulated, sigma),
        slips=(max(p[0] for p in pairs), max(p[1] for p in pairs)),
        quick=(_quick(op, interval_s), _quick(-op, interval_s)),
        openings=_events(_rise(op, OPENING_S, interval_s) >= OPENING_PERCENT),
        restarts=max(_restarts(simulated, ends, lengths), _further_jumps(mv, jumps, sigma)),
        slow_s=_slow(op, interval_s),
        resting_s=float(np.count_nonzero(~moving)) * interval_s,
        rests=np.concatenate((lengths * interval_s, seen)),
        passes=_passes(mv, sigma),
        at_low=_at_end(-op, -mv, sigma, S, J),
        at_high=_at_end(op, mv, sigma, S, J),
    )


def _restarts(simulated: Floats, ends: NDArray[np.int64], lengths: NDArray[np.int64]) -> int:
    """Rests of the simulated stem after which it goes on the way it came."""
    way = np.sign(np.diff(simulated, prepend=simulated[:1]))
    return int(np.sum(way[np.maximum(ends - lengths - 1, 0)] * way[ends] > 0.0))


def _further_jumps(mv: Floats, jumps: Slips, sigma: float) -> int:
    """Jumps of the recorded stem from where the jump before left it, in the same direction."""
    begins, sizes = jumps.begins, jumps.sizes
    between = np.abs(mv[begins[1:]] - (mv[begins[:-1]] + sizes[:-1]))
    rested = between < max(8.0 * sigma, 0.3)
    return int(np.sum(rested & (sizes[1:] * sizes[:-1] > 0.0)))


def _moves(mv: Floats, simulated: Floats, sigma: float) -> tuple[int, int]:
    """Moves rising and falling between turns that noise does not make."""
    counts = []
    for stem, noise in ((mv, sigma), (simulated, 0.0)):
        turns = reversals(stem, max(8.0 * noise, 0.3))
        points = stem[np.concatenate(([0], turns, [stem.size - 1]))]
        way = np.diff(points)
        large = np.abs(way) >= max(8.0 * noise, 0.3)
        counts.append((int(np.sum(large & (way > 0.0))), int(np.sum(large & (way < 0.0)))))
    return max(c[0] for c in counts), max(c[1] for c in counts)


def _rise(op: Floats, window_s: float, interval_s: float) -> Floats:
    """(m,) net rise of OP over a window, percent."""
    lag = min(max(round(window_s / interval_s), 1), op.size - 1)
    return np.asarray(op[lag:] - op[:-lag])


def _events(flags: Bools) -> int:
    """Runs of True."""
    return int(np.count_nonzero(np.diff(np.concatenate(([0], flags.astype(np.int8)))) == 1))


def _quick(op: Floats, interval_s: float) -> int:
    """Stretches in which OP rises quickly, by more than its own scatter."""
    rise = _rise(op, QUICK_S, interval_s)
    return _events(rise >= QUICK_PERCENT_PER_S * max(QUICK_S, interval_s))


def _slow(op: Floats, interval_s: float) -> float:
    """Seconds in which OP creeps one way: its net speed over 20 s is small and not nothing."""
    speed = np.abs(_rise(op, SLOW_S, interval_s)) / max(SLOW_S, interval_s)
    low, high = SLOW_PERCENT_PER_S
    return float(np.count_nonzero((speed > low) & (speed < high))) * interval_s


def _passes(mv: Floats, sigma: float) -> int:
    """The most often that the stem crossed any of eleven places of its travel."""
    turns: NDArray[np.int64] = reversals(mv, max(8.0 * sigma, 0.3))
    points = mv[np.concatenate(([0], turns, [mv.size - 1]))]
    low, high = np.percentile(mv, (1.0, 99.0))
    places = np.linspace(low, high, BANDS + 1)[1:-1, None]
    crossed = (points[:-1] < places) != (points[1:] < places)
    return int(crossed.sum(axis=1).max())


def _at_end(op: Floats, mv: Floats, sigma: float, S: float, J: float) -> bool:
    """True where MV stands at its upper end while OP goes on by more than friction explains.

    Friction holds the stem up to ``(S + J)/2`` from its command. A fit that took a stop for
    friction has too large an S, so what OP - MV reaches elsewhere counts where it is smaller.
    """
    near = mv >= float(np.percentile(mv, 99.5)) - max(4.0 * sigma, 0.3)
    if np.count_nonzero(near) < 10 or np.all(near):
        return False
    beyond = float(np.percentile((op - mv)[near], 98.0))
    # The stem's own band about the command, without what a shifted reading adds to both sides.
    low, high = np.percentile((op - mv)[~near], (5.0, 95.0))
    centre, half = 0.5 * (low + high), 0.5 * float(high - low)
    return bool(beyond - centre > min(0.5 * (S + J), half) + max(3.0 * sigma, 0.15))
