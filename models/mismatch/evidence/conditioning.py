"""The ways to cut a record into cells: phase, direction, rest before, travel, speed, time.

All cuts but the direction and the slips follow the simulated stem and the command, which are free
of the noise in MV: a cut that followed MV itself would sort its noise into cells.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.mismatch.evidence.residual_map import Facet
from stemwatch.models.preparation.own_clock import between, duration, parts_of_time, rate
from stemwatch.models.recording import Bools, Floats
from stemwatch.models.signals.excitation import REST_SAMPLES, jumps_from_rest, reversals, swing
from stemwatch.models.signals.runs_of_samples import runs_of

Codes = NDArray[np.int64]

SLIP_S, SETTLED_S = 4.0, 12.0  # after a slip: slipping until, settling until
TURN_S = 4.0  # either side of a turn of OP
NEAR_A_TURN = 0.25  # and at most this share of the time between two turns
RECENT_S = 10.0  # a quick move of OP is felt this long
BANDS, LEAST_BAND = 7, 0.5  # of travel; percent
PARTS = 8  # of the record
_STANDS = 0.002  # percent per second; a simulated stem slower than this is at rest
_SIMULATED_NOISE = 0.01  # percent; a simulated step beyond seven times this is a slip
_HELD = 0.005  # percent per second; a slower command is held

PHASES = ("stick", "slip", "settling", "moving", "reversal")


def _phase_phrases(unit_s: float) -> tuple[str, ...]:
    early, late = duration(SLIP_S, unit_s), duration(SETTLED_S, unit_s)
    return (
        "While the stem rests",
        f"In the first {early} after a slip",
        f"From {between(early, late)} after a slip",
        "While the stem slides",
        "Around a turn of the command",
    )


def _after(events: NDArray[np.int64], n: int) -> Codes:
    """(n,) samples since the last event, a large number before the first."""
    last = np.full(n, -(10**9), dtype=np.int64)
    last[events[events < n]] = events[events < n]
    return np.asarray(np.arange(n) - np.maximum.accumulate(last))


def moving_stem(simulated: Floats, interval_s: float) -> Bools:
    """(n,) True where the simulated stem moved into the sample."""
    steps = np.abs(np.diff(simulated, prepend=simulated[:1]))
    return np.asarray(steps > _STANDS * interval_s)


def phase(
    op: Floats, mv: Floats, simulated: Floats, interval_s: float, sigma: float, unit_s: float = 1.0
) -> Facet:
    """Stick, slip, settling, moving or reversal; a slip of the model or of the recording counts."""
    n = op.size
    begins = np.concatenate(
        (
            jumps_from_rest(simulated, op, _SIMULATED_NOISE).begins,
            jumps_from_rest(mv, op, sigma).begins,
        )
    )
    since = _after(np.sort(begins) + 1, n) * interval_s
    turn = reversals(op, max(0.1 * swing(op), 0.2))
    half = max(round(TURN_S / interval_s), 1)
    if turn.size > 1:
        # If the command turns every few samples, every sample would be near a turn.
        half = min(half, int(NEAR_A_TURN * float(np.median(np.diff(turn)))))
    # Within half a window of a turn, on either side.
    near_turn = _after(np.maximum(turn - half, 0), n) <= 2 * half
    code = np.where(moving_stem(simulated, interval_s), 3, 0)
    code[near_turn] = 4
    code[since < SETTLED_S] = 2
    code[since < SLIP_S] = 1
    return Facet("phase", PHASES, code.astype(np.int64), _phase_phrases(unit_s))


def direction(
    mv: Floats, simulated: Floats, interval_s: float, sigma: float, least_simulated: float = 0.0
) -> Facet:
    """Rising, falling or at rest: where the recorded stem goes, else where the simulated one does,
    which has no noise and moves from ``least_simulated`` percent on (0: as the recorded one).

    The difference is taken over about 3 s with the sample itself in its middle, so that noise does
    not favour a direction.
    """
    half = max(round(1.5 / interval_s), 1)
    index = np.arange(mv.size)
    ahead, behind = np.minimum(index + half, mv.size - 1), np.maximum(index - half, 0)
    seen = mv[ahead] - mv[behind]
    modelled = simulated[ahead] - simulated[behind]
    least = max(8.5 * sigma, 0.2)
    least_modelled = least_simulated or least
    modelled = np.where(np.abs(modelled) > least_modelled, modelled, 0.0)
    moving_direction = np.where(np.abs(seen) > least, seen, modelled)
    code = np.where(moving_direction > 0.0, 0, np.where(moving_direction < 0.0, 1, 2)).astype(
        np.int64
    )
    phrases = ("While the stem rises", "While the stem falls", "While the stem is at rest")
    return Facet("direction", ("rising", "falling", "at rest"), code, phrases)


def rests(moving: Bools) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(m,) first samples of motion after a rest of three samples or more, and the rests' lengths.

    A record begins with a rest of unknown length, which is not counted.
    """
    begins, ends = runs_of(~moving).T
    whole_rests = (begins > 0) & (ends < moving.size) & (ends - begins >= REST_SAMPLES)
    return ends[whole_rests], (ends - begins)[whole_rests]


def rest_before(simulated: Floats, interval_s: float, unit_s: float = 1.0) -> Facet:
    """How long the simulated stem had rested before it moved, in terciles; 12 s after at least."""
    n = simulated.size
    moving = moving_stem(simulated, interval_s)
    ends, lengths = rests(moving)
    code = np.full(n, -1, dtype=np.int64)
    if ends.size < 6:
        return Facet("rest", (), code)
    low, high = (float(q) for q in np.percentile(lengths * interval_s, (33.3, 66.7)))
    number = _after(ends, n)
    rest_index = np.searchsorted(ends, np.arange(n), side="right") - 1
    felt = (rest_index >= 0) & (moving | (number * interval_s < SETTLED_S))
    before = lengths[np.maximum(rest_index, 0)] * interval_s
    code[felt] = ((before > low).astype(np.int64) + (before > high))[felt]
    short, long = duration(low, unit_s), duration(high, unit_s)
    labels = (f"up to {short}", between(short, long), f"over {long}")
    phrases = tuple(f"When the stem starts after a rest of {label}" for label in labels)
    return Facet("rest", labels, code, phrases)


def travel_edges(simulated: Floats, scored: Bools) -> Floats:
    """(bands + 1,) even edges from the 0.5th to the 99.5th percentile of the position."""
    low, high = np.percentile(simulated[scored], (0.5, 99.5))
    bands = int(np.clip((high - low) / LEAST_BAND, 1, BANDS))
    return np.linspace(low, max(high, low + 1e-6), bands + 1)


def travel_band(simulated: Floats, edges: Floats) -> Facet:
    """The band of travel in which the simulated stem is; what lies beyond joins the end bands."""
    code = np.searchsorted(edges[1:-1], simulated, side="right").astype(np.int64)
    digits = 0 if edges[1] - edges[0] >= 2.0 else 1
    labels = tuple(f"{a:.{digits}f} to {b:.{digits}f} %" for a, b in pairwise(edges))
    phrases = tuple(f"At a travel of {label}" for label in labels)
    return Facet("travel", labels, code, phrases)


def command_speed(op: Floats, scored: Bools, interval_s: float, unit_s: float = 1.0) -> Facet:
    """The highest speed of OP within the last 10 s: held, or bands up to the 50th, 90th and 98th
    percentile of the moving samples, and above.
    """
    steps = np.abs(np.diff(op, prepend=op[:1])) / interval_s
    window = max(round(RECENT_S / interval_s), 1)
    padded = np.concatenate((np.zeros(window - 1), steps))
    quickest = np.lib.stride_tricks.sliding_window_view(padded, window).max(axis=1)
    moving = quickest > _HELD
    code = np.full(op.size, 0, dtype=np.int64)
    chosen = quickest[moving & scored]
    if chosen.size < 50:
        return Facet("speed", ("held",), code, ("While the command is held",))
    speeds = np.percentile(chosen, (50.0, 90.0, 98.0))
    code[moving] = 1 + np.searchsorted(speeds, quickest[moving], side="left")
    words = [rate(value, unit_s, ".2g") for value in speeds]
    recent = duration(RECENT_S, unit_s)
    labels = (
        "held",
        f"below {words[0]}",
        f"{words[0]} to {words[1]}",
        f"{words[1]} to {words[2]}",
        f"above {words[2]}",
    )
    phrases = (
        "While the command is held",
        f"While the command moves slower than {words[0]}",
        *(f"Within {recent} of the command moving at {label}" for label in labels[2:4]),
        f"Within {recent} of the command moving faster than {words[2]}",
    )
    return Facet("speed", labels, code, phrases)


def part_of_record(n: int, interval_s: float, unit_s: float = 1.0) -> Facet:
    """Eight equal parts of the record, labelled by the time from its start."""
    code = (np.arange(n, dtype=np.int64) * PARTS) // max(n, 1)
    labels = parts_of_time(n * interval_s, unit_s, PARTS)
    return Facet("time", labels, code, tuple(f"From {label}" for label in labels))
