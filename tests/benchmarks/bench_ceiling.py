"""Why effects are missed: would the right term have passed, had its search begun at the truth?

    python tests/benchmarks/bench_ceiling.py [--seed S] [--cases N]

The valves of ``stemwatch prove`` that hide one effect of the catalogue, and whose record shows it,
are explained. Where the effect is not named, its term is fitted once more from its true size and
the true S and J, and scored on unseen blocks as any term. One line for each, and a table.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import product

import numpy as np

from stemwatch.models.mismatch import evaluator as base_coordinate
from stemwatch.models.mismatch.acceptance_limits import NEAR, strength
from stemwatch.models.mismatch.base_fit import BaseFit
from stemwatch.models.mismatch.batched_search import conclude
from stemwatch.models.mismatch.crossfit import (
    CAREFUL,
    POLISH,
    FitEffort,
    Fitted,
    better,
    crossfit,
    gain,
    refit,
)
from stemwatch.models.mismatch.evaluator import CoordinateLayout
from stemwatch.models.mismatch.explain import explain
from stemwatch.models.mismatch.findings import Mismatch
from stemwatch.models.mismatch.other_coordinates import without
from stemwatch.models.mismatch.prepared_recording import prepare, problem_of
from stemwatch.models.mismatch.record_effects import measured_record
from stemwatch.models.mismatch.term import ActsOn, Term
from stemwatch.models.mismatch.term_selection import neutral
from stemwatch.models.mismatch.terms import catalogue
from stemwatch.models.own_clock import on_own_clock
from stemwatch.models.recording import Floats, Recording
from stemwatch.models.studies.simulator.hidden import HiddenCase, draw_hidden, simulate_hidden
from stemwatch.models.studies.simulator.hidden.catalogue import RECORD

EFFORT = FitEffort(keep=6, rounds=12, first=((2, 4, np.inf),), population=24)
AROUND = (0.8, 1.0, 1.25)  # times the true size: the plant's formulas are not the terms' own
S_AND_J = ((1.0, 1.0), (0.9, 0.8))  # times the true ones
RESTICKS = (0.02, 0.2, 1.0)  # %/s
# Shares of the drawn speed, at which friction has fallen, at which a stem may stick again.
OF_STRIBECK = (0.02, 0.05, 0.1, 0.2, 0.35, 0.6, 1.0, 1.6)
# A rise that settles, over that of the logarithm which it reaches after three minutes.
SETTLES = 3.5
NAMED = "named"
REFUSED = "the recording was not asked: it could not have shown it"
NOTHING = f"gains nothing: below {NEAR} of the limits even from the truth"
LITTLE = "gains too little: below the limits even from the truth"
SEARCH = "lost by the search: passes from the truth"
DROPPED = "found, and dropped afterwards"

Sizes = Mapping[str, float]
SIZES: dict[str, Callable[[Sizes], list[list[float]]]] = {
    "actuator_lag": lambda of: [[of["lag_s"]]],
    "asymmetric_lag": lambda of: both_ways(of["fill_lag_s"], of["vent_lag_s"]),
    "dead_time": lambda of: [[of["delay_s"]]],
    "rate_limit": lambda of: [[1.0 / of["rate_percent_per_s"]]],
    "asymmetric_rate_limit": lambda of: both_ways(
        1.0 / of["fill_percent_per_s"], 1.0 / of["vent_percent_per_s"]
    ),
    "underdamped_positioner": lambda of: [[of["ring_rad_per_s"], of["damping"]]],
    "supply_sag": lambda of: [[sign * of["share"], of["recovery_s"]] for sign in (-1.0, 1.0)],
    "viscous_drag": lambda of: [[of["drag_s"]]],
    "low_speed_restick": lambda of: [[k * of["stribeck_percent_per_s"]] for k in OF_STRIBECK],
    "asymmetric_slip": lambda of: either_sign(of["J_skew"]),
    "position_dependent_friction": lambda of: [
        [of["height_percent"], of["at_percent"] + off, of["width_percent"]]
        for off in (-1.0, 0.0, 1.0)
    ],
    "growing_stiction": lambda of: [[of["growth"]]],
    "dwell_dependent_breakaway": lambda of: [[of["percent"] / (SETTLES if of["settles"] else 1.0)]],
    "stem_creep": lambda of: either_sign(of["creep_percent_per_s"]),
    "travel_stop": lambda of: [
        [of["low_percent"], 0.0] if "low_percent" in of else [0.0, 100.0 - of["high_percent"]]
    ],
    "flow_force": lambda of: either_sign(of["flow_percent"]),
    "lost_motion": lambda of: [[of["play_percent"]]],
    "sensor_drift": lambda of: [[of["drift_percent"], 0.0, 0.0, 0.0]],
    "bowed_linkage": lambda of: either_sign(of["bow_percent"]),
}


def both_ways(opening: float, closing: float) -> list[list[float]]:
    """Of a valve that opens by air, and of one that closes by it."""
    return [[opening, closing], [closing, opening]]


def either_sign(size: float) -> list[list[float]]:
    """The size in the plant's direction and in the other."""
    return [[size], [-size]]


def at_truth(case: HiddenCase, term: Term, base: BaseFit) -> tuple[CoordinateLayout, Floats]:
    """The base with ``term``, and candidates (m, size) about the true sizes, S and J."""
    slug, valve, evaluator = case.hidden[0], case.loop.valve, base.evaluator
    layout = evaluator.layout(base.fitted.layout.hypothesis.plus(term))
    own = {name.split(".", 1)[1]: value for name, value in case.sizes.items()}
    centre = base.fitted.candidates.mean(axis=0)
    # A walk has no sizes that the term could begin from, so it begins from its own grid.
    walk = slug == "sensor_drift" and not own["drift_percent"]
    true_sizes = term.starts(evaluator.summary) if walk else SIZES[slug](own)
    rows = []
    for values, (S, J), k, plain, restick in product(
        true_sizes, S_AND_J, AROUND, (False, True), (None, *RESTICKS)
    ):
        row = np.zeros(layout.size)
        row[: base_coordinate.N_BASE] = centre[: base_coordinate.N_BASE]
        if plain:
            row[[base_coordinate.ZERO, base_coordinate.GAIN]] = 0.0
        row[base_coordinate.S_PERCENT] = S * valve.S_read
        row[base_coordinate.RATIO] = J * valve.J_read / (S * valve.S_read)
        if restick is not None:
            row[base_coordinate.RESTICK] = restick
        row[layout.places[slug]] = values
        row[layout.places[slug].start] *= 1.0 if slug == "travel_stop" else k
        rows.append(row)
    return layout, layout.bounds.clip(np.array(rows))


def best_from(base: BaseFit, layout: CoordinateLayout, starts: Floats) -> tuple[Fitted, Fitted]:
    """The base, restarted from the richer fit, and that fit, which contains it."""
    evaluator = base.evaluator
    rich = conclude(evaluator, crossfit(evaluator, layout, starts, EFFORT))
    rich = conclude(evaluator, refit(evaluator, rich, POLISH))
    restarts = without(rich, base.fitted.layout)
    simple = conclude(evaluator, refit(evaluator, base.fitted, CAREFUL, *restarts))
    simple = conclude(evaluator, refit(evaluator, simple, POLISH))
    nothing = conclude(evaluator, neutral(evaluator, simple, layout.hypothesis))
    return simple, better(evaluator, nothing, rich)


def from_truth(case: HiddenCase, recording: Recording) -> float | None:
    """The strength of the right term, begun at the truth, or ``None`` where it is not asked."""
    recording = on_own_clock(recording)
    measured = measured_record(recording)
    prepared = prepare(recording, measured, None, problem_of(recording, measured))
    slug, base = case.hidden[0], prepared.base
    if slug in prepared.refused:
        return None
    simple, rich = best_from(base, *at_truth(case, catalogue()[slug], base))
    evaluator = base.evaluator
    if not catalogue()[slug].material(rich.values(slug).mean(axis=0), evaluator.summary):
        return 0.0
    return strength(gain(evaluator, simple, rich), evaluator.measured_counts, slug)


def why_missed(slug: str, mismatch: Mismatch, best: float | None) -> str:
    """What became of the right effect, whose strength is ``best`` from the truth."""
    if best is None:
        return REFUSED
    found = max((score.strength for score in mismatch.scores if score.slug == slug), default=0.0)
    if found >= 1.0:
        return DROPPED
    if best >= 1.0:
        return SEARCH
    return LITTLE if best >= NEAR else NOTHING


def of_the_catalogue(case: HiddenCase) -> bool:
    """Whether the case hides one effect of physics that is a term of its own."""
    if len(case.effects) != 1 or case.effects[0] in RECORD:
        return False
    term = catalogue().get(case.effects[0])
    return term is not None and term.acts_on is not ActsOn.READING


def stored(recording: Recording) -> Recording:
    """With four decimals, as the proof's files have them."""
    signals = {
        role: replace(signal, values=np.round(signal.values, 4))
        for role, signal in recording.signals.items()
    }
    return replace(recording, signals=signals)


def main() -> None:
    """Explain the valves, and say of each missed effect why."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=2108)
    parser.add_argument("--cases", type=int, default=400)
    requested = parser.parse_args()
    counts: Counter[str] = Counter()
    for drawn in filter(of_the_catalogue, draw_hidden(requested.cases, requested.seed)):
        case, run = simulate_hidden(drawn)
        if not case.excited:
            continue
        slug, recording = case.hidden[0], stored(run.recording)
        mismatch = explain(recording)
        if any(slug in effect.members for effect in mismatch.effects):
            counts[NAMED] += 1
            continue
        best = from_truth(case, recording)
        why = why_missed(slug, mismatch, best)
        counts[why] += 1
        size = "" if best is None else f" ({best:.2f} of the limits)"
        print(f"{slug}, {case.concealment}: {why}{size}", flush=True)
    for why in (NAMED, REFUSED, NOTHING, LITTLE, SEARCH, DROPPED):
        print(f"{counts[why]:4d}  {why}")


if __name__ == "__main__":
    main()
