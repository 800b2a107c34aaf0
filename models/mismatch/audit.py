"""Which effects of the catalogue a recording could not have shown, and why not.

An effect that the recording never exercised is not absent: it is not testable. The limits refuse
only where nothing could be seen; what is seen weakly is left to the evidence.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from stemwatch.models.mismatch.witness import (
    OPENING_PERCENT,
    OPENING_S,
    QUICK_PERCENT_PER_S,
    Witness,
    witness,
)
from stemwatch.models.recording import Bools, Floats
from stemwatch.models.words import times

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
    "lost_motion",
    "travel_stop",
    "underdamped_positioner",
    "viscous_drag",
    "low_speed_restick",
    "flow_force",
    "sensor_drift",
    "growing_stiction",
    "dwell_dependent_breakaway",
    "stem_creep",
    "supply_sag",
)
_QUICK_EFFECTS = (
    "actuator_lag",
    "asymmetric_lag",
    "dead_time",
    "viscous_drag",
    "underdamped_positioner",
)

SLOWEST_SAMPLING_S = 5.0  # at which an effect of a few seconds leaves a trace
LEAST_MOVES = 2
LEAST_SLIPS = 3  # each way, for their sizes to be compared at all
LEAST_QUICK = 1
LEAST_OPENINGS = 2
SPAN_TRAVEL, FLOW_TRAVEL, FRICTION_TRAVEL = 6.0, 15.0, 3.0  # percent of travel
LEAST_PASSES = 4
LEAST_RESTARTS = 2
LEAST_SLOW_S = 60.0
LEAST_RESTING_S = 60.0
LEAST_RESTS, REST_SPREAD = 4, 2.0  # count, and longest to shortest
LEAST_DURATION_S = 840.0  # a quarter of an hour, less the first minute

NO_POSITION = (
    "the recording holds no valve position, and what the stem does cannot be told from OP and PV"
)


def audit(
    op: Floats,
    mv: Floats | None,
    simulated: Floats | None,
    scored: Bools,
    interval_s: float,
    sigma: float,
    S: float,
    J: float,
    spacing_s: float = 0.0,
) -> dict[str, str]:
    """Slugs of physics effects that cannot be tested here, each with its reason, a clause.

    ``op``, ``mv`` and the base simulation (n,), finite, in percent; ``sigma`` the noise of MV; S
    and J of the base fit; ``spacing_s`` how far apart true samples are, where that is more than the
    interval (``RecordSettled.spacing_s``). Without a position nothing of the valve can be tested.
    """
    if mv is None or simulated is None:
        return dict.fromkeys(PHYSICS, NO_POSITION)
    seen = witness(op, mv, simulated, scored, interval_s, sigma, S, J)
    refused = dict(_sampling(max(interval_s, spacing_s)))
    for rule in _RULES:
        for slug, reason in rule(seen):
            refused.setdefault(slug, reason)
    return refused


Refusals = Iterator[tuple[str, str]]


def _sampling(spacing_s: float) -> Refusals:
    """Effects of a few seconds between samples that are further apart."""
    if spacing_s > SLOWEST_SAMPLING_S:
        reason = (
            f"the samples are {spacing_s:g} s apart, and an effect of a few seconds falls "
            f"between them; record every {SLOWEST_SAMPLING_S:g} s or faster"
        )
        yield from ((slug, reason) for slug in _QUICK_EFFECTS)


def _moves(seen: Witness) -> Refusals:
    """Effects that show while the stem moves, in one direction or in both."""
    up, down = seen.moves
    if up + down < LEAST_MOVES:
        reason = f"the stem moved only {times(up + down)}, and this shows while it moves"
        for slug in (*_QUICK_EFFECTS, "zero_shift", "lost_motion", "low_speed_restick"):
            yield slug, reason
    if min(up, down) < 1:
        way = "rose" if up < down else "fell"
        reason = f"the stem {way} only {times(min(up, down))}, so its directions cannot be compared"
        yield from ((slug, reason) for slug in ("asymmetric_lag", "asymmetric_rate_limit"))


def _speeds(seen: Witness) -> Refusals:
    """Effects that need quick moves or large openings of the command."""
    up, down = seen.quick
    reason = (
        f"OP moved faster than {QUICK_PERCENT_PER_S:g} %/s over 5 s only {times(up + down)}; a "
        "slower command never meets the valve's top speed"
    )
    if up + down < LEAST_QUICK:
        yield "rate_limit", reason
        yield "asymmetric_rate_limit", reason
    if seen.openings < LEAST_OPENINGS:
        yield (
            "supply_sag",
            f"OP opened by {OPENING_PERCENT:g} % within {OPENING_S:g} s only "
            f"{times(seen.openings)}; the air supply was never drawn on",
        )
    if seen.slow_s < LEAST_SLOW_S:
        yield (
            "low_speed_restick",
            f"OP crept slower than 0.25 %/s for only {seen.slow_s:.0f} s; stepping along slow "
            "ramps cannot show without them",
        )


def _slips(seen: Witness) -> Refusals:
    """Effects that compare slips with one another."""
    up, down = seen.slips
    if min(up, down) < LEAST_SLIPS:
        yield (
            "asymmetric_slip",
            f"the stem slipped {times(up)} rising and {times(down)} falling; their sizes can be "
            f"compared from {LEAST_SLIPS} each way",
        )
    if seen.restarts < LEAST_RESTARTS:
        yield (
            "lost_motion",
            f"the stem started again in the same direction only {times(seen.restarts)}; at full "
            "reversals play cannot be told from a smaller jump (do a staircase test)",
        )
    rests = seen.rests
    spread = float(np.divide(*np.percentile(rests, (95.0, 5.0)))) if rests.size else 1.0
    if rests.size < LEAST_RESTS or spread < REST_SPREAD:
        yield (
            "dwell_dependent_breakaway",
            f"the stem rested {times(rests.size)}, the long rests {spread:.1f} times as long as "
            f"the short ones; at least {LEAST_RESTS} rests that differ {REST_SPREAD:g}-fold are "
            "needed",
        )


def _travel(seen: Witness) -> Refusals:
    """Effects that need a part of the stroke, passes through it, or its ends."""
    for slug, least in (
        ("span_error", SPAN_TRAVEL),
        ("flow_force", FLOW_TRAVEL),
        ("position_dependent_friction", FRICTION_TRAVEL),
    ):
        if seen.travel < least:
            yield (
                slug,
                f"the stem covered only {seen.travel:.1f} % of its travel; {least:g} % are needed",
            )
    if seen.passes < LEAST_PASSES:
        yield (
            "position_dependent_friction",
            f"the stem passed no place of its travel more than {times(seen.passes)}; "
            f"{LEAST_PASSES} passes are needed to tell the place from the time",
        )
    if not (seen.at_low or seen.at_high):
        yield (
            "travel_stop",
            "the position never stood still at an end of its range while OP went on by more than "
            "friction explains; a stop further out was not reached",
        )


def _time(seen: Witness) -> Refusals:
    """Effects that need a long record, or long rests."""
    if seen.duration_s < LEAST_DURATION_S:
        reason = (
            f"the recording has {seen.duration_s / 60:.0f} minutes; a slow change needs a quarter "
            "of an hour at least"
        )
        yield "sensor_drift", reason
        yield "growing_stiction", reason
    if sum(seen.moves) <= LEAST_MOVES:
        yield (
            "growing_stiction",
            f"the stem moved only {times(sum(seen.moves))}, too seldom to compare early with late",
        )
    if seen.resting_s < LEAST_RESTING_S:
        yield (
            "stem_creep",
            f"the stem rested for only {seen.resting_s:.0f} s, and creep shows at rest",
        )


_RULES: tuple[Callable[[Witness], Refusals], ...] = (
    _moves,
    _speeds,
    _slips,
    _travel,
    _time,
)
