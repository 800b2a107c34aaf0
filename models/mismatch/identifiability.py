"""Which effects of the catalogue a recording could not have shown, and why not.

First what the recording exercised is counted (moves, slips, turns, rests, travel); then each effect
is asked whether so much could have shown it.

An effect that the recording never exercised is not absent: it is not testable. The limits refuse an
effect only where it could not be seen at all; where it would show weakly, the evidence decides.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.mismatch.evidence.conditioning import moving_stem, rests
from stemwatch.models.preparation.own_clock import duration, is_of_seconds, long_time, rate
from stemwatch.models.recording import Bools, Floats
from stemwatch.models.signals.excitation import Jumps, jumps_from_rest, reversals, swing
from stemwatch.models.signals.runs_of_samples import equal_runs, runs_of
from stemwatch.models.words import only_times, share, times

QUICK_S, OPENING_S, SLOW_S = 5.0, 10.0, 20.0  # windows of a quick move, an opening, a slow ramp
QUICK_PERCENT_PER_S = 0.2  # of a net move over 5 s
SLOW_PERCENT_PER_S = (0.003, 0.25)  # of a ramp on which a stem could stick repeatedly
OPENING_PERCENT = 2.0
SLIP_NOISE = 0.01  # percent, of a simulated stem
BANDS = 12  # of travel, whose passes are counted
FEWEST_AT_END = 10  # samples at an end of the range, from which the stem stands there

PHYSICS = (
    "actuator_lag",
    "asymmetric_lag",
    "dead_time",
    "rate_limit",
    "asymmetric_rate_limit",
    "asymmetric_slip",
    "position_dependent_friction",
    "zero_shift",
    "span_error",
    "bowed_linkage",
    "spring_hysteresis",
    "lost_motion",
    "travel_stop",
    "underdamped_positioner",
    "viscous_drag",
    "low_speed_restick",
    "slip_overshoot",
    "flow_force",
    "sensor_drift",
    "growing_stiction",
    "dwell_dependent_breakaway",
    "stem_creep",
    "presliding",
    "supply_sag",
)
_QUICK_EFFECTS = (
    "actuator_lag",
    "asymmetric_lag",
    "dead_time",
    "viscous_drag",
    "underdamped_positioner",
)

_RESTING = ("low_speed_restick", "slip_overshoot")  # these show where a moving stem sticks again

SLOWEST_SAMPLING_S = 5.0  # at which an effect of a few seconds still shows
# Effects between samples: how the stem sticks again, how long it rested before it let go.
_BETWEEN_SAMPLES = ("low_speed_restick", "slip_overshoot", "dwell_dependent_breakaway")
# Share of the samples at which OP bends by more than a tenth of its swing: then its turns fall
# between samples. At most 0.010 in 92 simulated loops at 1 s, at least 0.020 in 32 of them at 5 s
# and 0.039 at 10 s.
SHARP_BEND = 0.1
BENDS_UNSEEN, MOST_BENDS = 0.015, 0.035
HELD = 10  # samples of one value: where OP leaves or reaches such a hold, it does not turn
# A command that bends at nearly every sample is dithered, and shows quick effects all the time: of
# 64 simulated loops at 5 to 60 s none bends at more than 0.64 of its samples.
DITHERED = 0.7
# Correlation of a step of OP with the one before it: -0.5 for white noise, which bends without
# turning, and around 0 or above for a loop whose turns fall between samples.
NOISE, LEAST_STEPS = -0.25, 10
LEAST_MOVES = 2  # both ways together
# For the sizes of slips to be compared at all: slips of one way, and slips or moves of the other. A
# stem that moves that way without a slip has slipped by less than is seen.
LEAST_SLIPS = 3
LEAST_QUICK = 1  # quick moves of OP, both ways together
LEAST_OPENINGS = 2
SPAN_TRAVEL, FLOW_TRAVEL, FRICTION_TRAVEL = 6.0, 15.0, 3.0  # percent of travel
LEAST_PASSES = 4
LEAST_RESTARTS = 2
LEAST_SLOW_S = 60.0
LEAST_RESTING_S = 60.0
LEAST_RESTS, REST_SPREAD = 4, 2.0  # count, and longest to shortest
LEAST_DURATION_S = 840.0  # a quarter of an hour, less the first minute
_SLOW_CHANGE = "a quarter of an hour"

NO_POSITION = (
    "the recording holds no valve position, and what the stem does cannot be told from OP and PV"
)
Refusals = Iterator[tuple[str, str]]  # slug of an effect, and why it cannot be tested


@dataclass(frozen=True, kw_only=True)
class Exercised:
    """What the recording exercised; counts of the recording or of the simulated stem, whichever is
    larger.

    ``travel`` is the range of MV in percent, 1st to 99th percentile; ``moves`` (rising, falling)
    counts the stem's moves between its turns, ``slips`` its jumps; ``quick`` OP's moves by at least
    0.2 %/s over 5 s each way, ``openings`` its rises by 2 % or more within 10 s; ``restarts``
    starts in the direction of the motion before; ``slow_s`` the time of ramps slower than 0.25 %/s;
    ``rests`` (m,) lengths in seconds; ``passes`` the most through any band of travel. ``bends`` is
    the share of the samples at which OP bends by more than a tenth of its swing and does not rest
    before or after (the corners of a step that is held hide no turn), and ``noisy``
    whether its noise explains these bends; ``at_low`` and ``at_high`` tell whether MV stands at
    that end while OP goes further.
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
    bends: float = 0.0
    noisy: bool = False
    unit_s: float = 1.0  # seconds in the unit of the times, see ``own_clock``


def exercised(
    op: Floats,
    mv: Floats,
    simulated: Floats,
    scored: Bools,
    interval_s: float,
    sigma: float,
    S: float,
    J: float,
    unit_s: float = 1.0,
) -> Exercised:
    """Count what a recording exercised; all arrays (n,) finite, percent; ``sigma`` is the noise of
    MV.

    S and J are those of the base fit, percent, and ``simulated`` its run; times in units of
    ``unit_s`` seconds.
    """
    moving = moving_stem(simulated, interval_s)
    ends, lengths = rests(moving)
    jumps = jumps_from_rest(mv, op, sigma)
    slips = [
        (int(np.sum(sizes > 0.0)), int(np.sum(sizes < 0.0)))
        for sizes in (jumps.sizes, jumps_from_rest(simulated, op, SLIP_NOISE).sizes)
    ]
    between_jumps_s = np.diff(jumps.begins) * interval_s
    return Exercised(
        duration_s=float(np.count_nonzero(scored)) * interval_s,
        travel=swing(mv[scored]) if scored.any() else 0.0,
        moves=_moves(mv, simulated, sigma),
        slips=_larger(slips),
        quick=(_quick(op, interval_s), _quick(-op, interval_s)),
        openings=len(runs_of(_rise(op, OPENING_S, interval_s) >= OPENING_PERCENT)),
        restarts=max(_restarts(simulated, ends, lengths), _further_jumps(mv, jumps, sigma)),
        slow_s=_slow(op, interval_s),
        resting_s=float(np.count_nonzero(~moving)) * interval_s,
        rests=np.concatenate((lengths * interval_s, between_jumps_s)),
        passes=_passes(mv, sigma),
        at_low=_at_end(-op, -mv, sigma, S, J),
        at_high=_at_end(op, mv, sigma, S, J),
        bends=_bends(op),
        noisy=correlation_of_steps(op) < NOISE,
        unit_s=unit_s,
    )


def _bends(op: Floats) -> float:
    """The share of the samples of OP (n,) at which it bends and does not rest on either side."""
    bends = np.abs(np.diff(op, 2)) > SHARP_BEND * swing(op)
    runs = equal_runs(op)
    held = runs[runs[:, 1] - runs[:, 0] >= HELD]
    corners = np.concatenate((held[:, 0], held[:, 1] - 1)) - 1  # a bend is at its middle sample
    bends[corners[(corners >= 0) & (corners < bends.size)]] = False
    return float(np.mean(bends))


def correlation_of_steps(op: Floats) -> float:
    """Correlation of a step of OP (n,) with the one before it; 0 where OP does not move."""
    steps = np.diff(op)
    if steps.size < LEAST_STEPS or steps[1:].std() == 0.0 or steps[:-1].std() == 0.0:
        return 0.0
    return float(np.corrcoef(steps[1:], steps[:-1])[0, 1])


def _restarts(simulated: Floats, ends: NDArray[np.int64], lengths: NDArray[np.int64]) -> int:
    """Rests of the simulated stem after which it goes on the way it came."""
    directions = np.sign(np.diff(simulated, prepend=simulated[:1]))
    return int(np.sum(directions[np.maximum(ends - lengths - 1, 0)] * directions[ends] > 0.0))


def _further_jumps(mv: Floats, jumps: Jumps, sigma: float) -> int:
    """Jumps of the recorded stem from where the jump before left it, in the same direction."""
    begins, sizes = jumps.begins, jumps.sizes
    between = np.abs(mv[begins[1:]] - (mv[begins[:-1]] + sizes[:-1]))
    rested = between < _least_move(sigma)
    return int(np.sum(rested & (sizes[1:] * sizes[:-1] > 0.0)))


def _least_move(sigma: float) -> float:
    """The smallest move that is no noise of standard deviation ``sigma``, percent."""
    return max(8.0 * sigma, 0.3)


def _turning_points(stem: Floats, sigma: float) -> Floats:
    """(m,) where the stem turned, by more than noise, with its first and last place."""
    turns: NDArray[np.int64] = reversals(stem, _least_move(sigma))
    return np.asarray(stem[np.concatenate(([0], turns, [stem.size - 1]))])


def _moves(mv: Floats, simulated: Floats, sigma: float) -> tuple[int, int]:
    """Moves rising and falling between turns that noise does not make."""
    counts = []
    for stem, noise in ((mv, sigma), (simulated, 0.0)):
        steps = np.diff(_turning_points(stem, noise))
        large = np.abs(steps) >= _least_move(noise)
        counts.append((int(np.sum(large & (steps > 0.0))), int(np.sum(large & (steps < 0.0)))))
    return _larger(counts)


def _larger(counts: Sequence[tuple[int, int]]) -> tuple[int, int]:
    """The larger count of the recorded and of the simulated stem, rising and falling."""
    return max(rising for rising, _ in counts), max(falling for _, falling in counts)


def _rise(op: Floats, window_s: float, interval_s: float) -> Floats:
    """(m,) net rise of OP over a window, percent."""
    lag = min(max(round(window_s / interval_s), 1), op.size - 1)
    return np.asarray(op[lag:] - op[:-lag])


def _quick(op: Floats, interval_s: float) -> int:
    """Stretches in which OP rises quickly, by more than its own scatter."""
    rise = _rise(op, QUICK_S, interval_s)
    return len(runs_of(rise >= QUICK_PERCENT_PER_S * max(QUICK_S, interval_s)))


def _slow(op: Floats, interval_s: float) -> float:
    """Seconds in which OP creeps one way: its net speed over 20 s is small but not zero."""
    speed = np.abs(_rise(op, SLOW_S, interval_s)) / max(SLOW_S, interval_s)
    low, high = SLOW_PERCENT_PER_S
    return float(np.count_nonzero((speed > low) & (speed < high))) * interval_s


def _passes(mv: Floats, sigma: float) -> int:
    """The most often that the stem crossed any of eleven places of its travel."""
    points = _turning_points(mv, sigma)
    low, high = np.percentile(mv, (1.0, 99.0))
    places = np.linspace(low, high, BANDS + 1)[1:-1, None]
    crossed = (points[:-1] < places) != (points[1:] < places)
    return int(crossed.sum(axis=1).max())


def _at_end(op: Floats, mv: Floats, sigma: float, S: float, J: float) -> bool:
    """True where MV stands at its upper end while OP goes on by more than friction explains.

    Friction holds the stem up to ``(S + J)/2`` from its command. A fit that took a stop for
    friction has too large an S, so what OP - MV reaches elsewhere counts where it is smaller.
    """
    near_end = mv >= float(np.percentile(mv, 99.5)) - max(4.0 * sigma, 0.3)
    if np.count_nonzero(near_end) < FEWEST_AT_END or np.all(near_end):
        return False
    beyond_end = float(np.percentile((op - mv)[near_end], 98.0))
    # The stem's own band about the command, without what a shifted reading adds to both sides.
    low, high = np.percentile((op - mv)[~near_end], (5.0, 95.0))
    centre, half = 0.5 * (low + high), 0.5 * float(high - low)
    return bool(beyond_end - centre > min(0.5 * (S + J), half) + max(3.0 * sigma, 0.15))


def untestable_effects(
    op: Floats,
    mv: Floats | None,
    simulated: Floats | None,
    scored: Bools,
    interval_s: float,
    sigma: float,
    S: float,
    J: float,
    spacing_s: float = 0.0,
    unit_s: float = 1.0,
) -> dict[str, str]:
    """Slugs of physics effects that cannot be tested here, each with its reason, a clause.

    ``op``, ``mv`` and the base simulation (n,), finite, in percent; ``sigma`` the noise of MV; S
    and J of the base fit; ``spacing_s`` how far apart true samples are, where that is more than the
    interval (``MeasuredRecord.spacing_s``); times in units of ``unit_s`` seconds.
    Without a position nothing of the valve can be tested.
    """
    if mv is None or simulated is None:
        return dict.fromkeys(PHYSICS, NO_POSITION)
    motion = exercised(op, mv, simulated, scored, interval_s, sigma, S, J, unit_s)
    refused = dict(_sampling(max(interval_s, spacing_s), unit_s))
    refused |= dict(_lost_turns(motion, interval_s))
    for rule in _RULES:
        for slug, reason in rule(motion):
            refused.setdefault(slug, reason)
    return refused


def _sampling(spacing_s: float, unit_s: float) -> Refusals:
    """Effects of a few seconds between samples that are further apart."""
    if spacing_s > SLOWEST_SAMPLING_S:
        reason = (
            f"the samples are {duration(spacing_s, unit_s, 'g')} apart, and an effect of a few "
            f"seconds falls between them; record every {duration(SLOWEST_SAMPLING_S, unit_s)} or "
            "faster"
        )
        yield from ((slug, reason) for slug in _QUICK_EFFECTS)


def _lost_turns(motion: Exercised, interval_s: float) -> Refusals:
    """Effects within a few samples where OP itself turns between the samples."""
    reason = (
        f"OP bends by more than a tenth of its swing at {share(motion.bends, 1)} of the samples: "
        "its turns fall between them, and so does such an effect; record faster than every "
        f"{duration(interval_s, motion.unit_s, 'g')}"
    )
    if motion.noisy or motion.bends > DITHERED:
        return
    if motion.bends > BENDS_UNSEEN:
        yield from ((slug, reason) for slug in _BETWEEN_SAMPLES)
    if motion.bends > MOST_BENDS:
        yield from ((slug, reason) for slug in _QUICK_EFFECTS)


def _untested_moves(motion: Exercised) -> Refusals:
    """Effects that show while the stem moves, in one direction or in both."""
    up, down = motion.moves
    if up + down < LEAST_MOVES:
        reason = f"the stem moved {only_times(up + down)}, and this shows while it moves"
        for slug in (*_QUICK_EFFECTS, "zero_shift", "lost_motion", *_RESTING):
            yield slug, reason
    if min(up, down) < 1:
        seldom = "rose" if up < down else "fell"
        reason = (
            f"the stem {seldom} {only_times(min(up, down))}, so its directions cannot be compared"
        )
        yield from ((slug, reason) for slug in ("asymmetric_lag", "asymmetric_rate_limit"))


def _speeds(motion: Exercised) -> Refusals:
    """Effects that need quick moves or large openings of the command."""
    up, down = motion.quick
    quick, over_time = (
        rate(QUICK_PERCENT_PER_S, motion.unit_s, "g"),
        duration(QUICK_S, motion.unit_s),
    )
    reason = (
        f"OP moved faster than {quick} over {over_time} {only_times(up + down)}; a "
        "slower command never meets the valve's top speed"
    )
    if up + down < LEAST_QUICK:
        yield "rate_limit", reason
        yield "asymmetric_rate_limit", reason
    if motion.openings < LEAST_OPENINGS:
        yield (
            "supply_sag",
            f"OP opened by {OPENING_PERCENT:g} % within {duration(OPENING_S, motion.unit_s)} only "
            f"{times(motion.openings)}; the air supply was never drawn on",
        )
    if motion.slow_s < LEAST_SLOW_S:
        reason = (
            f"OP crept slower than {rate(SLOW_PERCENT_PER_S[1], motion.unit_s, 'g')} for only "
            f"{duration(motion.slow_s, motion.unit_s)}; stepping along slow "
            "ramps cannot show without them"
        )
        yield from ((slug, reason) for slug in _RESTING)


def _slips(motion: Exercised) -> Refusals:
    """Effects that compare slips with one another."""
    (up, down), (rises, falls) = motion.slips, motion.moves
    if max(up, down) < LEAST_SLIPS or min(max(up, rises), max(down, falls)) < LEAST_SLIPS:
        yield (
            "asymmetric_slip",
            f"the stem slipped {times(up)} rising and {times(down)} falling; their sizes can be "
            f"compared from {LEAST_SLIPS} one way and as many moves the other way",
        )
    if motion.restarts < LEAST_RESTARTS:
        seldom = f"started again {only_times(motion.restarts)}"
        yield (
            "lost_motion",
            f"the stem {seldom if motion.restarts else 'never started again'} in the same "
            "direction; at full reversals play cannot be told from a smaller jump (do a staircase "
            "test)",
        )
    rests_s = motion.rests
    spread = float(np.divide(*np.percentile(rests_s, (95.0, 5.0)))) if rests_s.size else 1.0
    if rests_s.size < LEAST_RESTS or spread < REST_SPREAD:
        yield (
            "dwell_dependent_breakaway",
            f"the stem rested {times(rests_s.size)}, the long rests {spread:.1f} times as long as "
            f"the short ones; at least {LEAST_RESTS} rests that differ {REST_SPREAD:g}-fold are "
            "needed",
        )


def _travel(motion: Exercised) -> Refusals:
    """Effects that need a part of the stroke, passes through it, or its ends."""
    for slug, least in (
        ("span_error", SPAN_TRAVEL),
        ("bowed_linkage", SPAN_TRAVEL),
        ("spring_hysteresis", SPAN_TRAVEL),
        ("flow_force", FLOW_TRAVEL),
        ("position_dependent_friction", FRICTION_TRAVEL),
    ):
        if motion.travel < least:
            yield (
                slug,
                f"the stem covered only {motion.travel:.1f} % of its travel; {least:g} % are "
                "needed",
            )
    if motion.passes < LEAST_PASSES:
        yield (
            "position_dependent_friction",
            f"the stem passed no place of its travel more than {times(motion.passes)}; "
            f"{LEAST_PASSES} passes are needed to tell the place from the time",
        )
    if not (motion.at_low or motion.at_high):
        yield (
            "travel_stop",
            "the position never stood still at an end of its range while OP went on by more than "
            "friction explains; a stop further out was not reached",
        )


def _time(motion: Exercised) -> Refusals:
    """Effects that need a long record, or long rests."""
    if motion.duration_s < LEAST_DURATION_S:
        least = long_time(LEAST_DURATION_S, motion.unit_s)
        reason = (
            f"the recording has {long_time(motion.duration_s, motion.unit_s)}; a slow change needs "
            f"{_SLOW_CHANGE if is_of_seconds(motion.unit_s) else least} at least"
        )
        yield "sensor_drift", reason
        yield "growing_stiction", reason
    if sum(motion.moves) <= LEAST_MOVES:
        yield (
            "growing_stiction",
            f"the stem moved {only_times(sum(motion.moves))}, too seldom to compare early with "
            "late",
        )
    if motion.resting_s < LEAST_RESTING_S:
        reason = (
            f"the stem rested for only {duration(motion.resting_s, motion.unit_s)}, and creep "
            "shows at rest"
        )
        yield "stem_creep", reason
        yield "presliding", reason


_RULES: tuple[Callable[[Exercised], Refusals], ...] = (
    _untested_moves,
    _speeds,
    _slips,
    _travel,
    _time,
)
