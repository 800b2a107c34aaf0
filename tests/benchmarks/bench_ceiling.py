"""Why effects are missed: would the right term have passed, had its search begun at the truth?

    python tests/benchmarks/bench_ceiling.py [--seed S] [--cases N]

The valves of ``stemwatch prove`` that hide one effect of the catalogue, and whose record shows it,
are explained. Where the effect is not named, its term is fitted once more from its true size and
the true S and J, and judged as any term: by the trajectories on unseen blocks, and by the
likelihood of the whole record. One line for each, and a table of the records and one of the
effects. Dwell, which has a search of its own, is judged by trajectories alone here;
``bench_dwell --hidden`` has its likelihood.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from stemwatch.models.mismatch.acceptance.accepted_hypothesis import named_effects
from stemwatch.models.mismatch.acceptance_limits import NEAR, strength
from stemwatch.models.mismatch.explain import explain
from stemwatch.models.mismatch.findings import Mismatch
from stemwatch.models.mismatch.fit import base_coordinate
from stemwatch.models.mismatch.fit.base_fit import BaseFit
from stemwatch.models.mismatch.fit.batched_search import conclude
from stemwatch.models.mismatch.fit.crossfit import (
    CAREFUL,
    POLISH,
    FitEffort,
    Fitted,
    better,
    crossfit,
    gain,
    refit,
)
from stemwatch.models.mismatch.fit.evaluator import CoordinateLayout
from stemwatch.models.mismatch.likelihood.likelihood_evidence import evidence_of
from stemwatch.models.mismatch.likelihood.maximum_likelihood import (
    FEW_COURSES,
    RELEASED,
    Likeliest,
    RecordLikelihood,
    points_at,
)
from stemwatch.models.mismatch.measurement.record_effects import measured_record
from stemwatch.models.mismatch.prepared_recording import (
    PreparedRecording,
    admissible,
    prepare,
    problem_of,
)
from stemwatch.models.mismatch.search.breakaway_levels import DWELL
from stemwatch.models.mismatch.search.breakaway_scatter import (
    leaves_something,
    released,
    scatter_matters,
    scatters_most,
)
from stemwatch.models.mismatch.search.compared_by_likelihood import _compared
from stemwatch.models.mismatch.search.drive import of_the_valve
from stemwatch.models.mismatch.search.named_by_likelihood import (
    _passes,
    _released,
    named_by_likelihood,
)
from stemwatch.models.mismatch.search.other_coordinates import without
from stemwatch.models.mismatch.search.reading_errors import (
    COORDINATES,
    LEAST_RESTICK,
    RESTICK,
    pinned,
)
from stemwatch.models.mismatch.search.sticking_by_likelihood import HARDER
from stemwatch.models.mismatch.search.term_scores import neutral
from stemwatch.models.mismatch.term import Term
from stemwatch.models.mismatch.terms import catalogue
from stemwatch.models.preparation.own_clock import on_own_clock
from stemwatch.models.recording import Floats, Recording
from stemwatch.models.studies.simulator.hidden import HiddenCase, draw_hidden, simulate_hidden
from stemwatch.models.studies.simulator.hidden.catalogue import RECORD

EFFORT = FitEffort(keep=6, rounds=12, first=((2, 4, np.inf),), population=24)
AROUND = (0.8, 1.0, 1.25)  # times the true size: the plant's formulas are not the terms' own
S_AND_J = ((1.0, 1.0), (0.9, 0.8))  # times the true ones
CLIMBED = 4  # points by the truth from which the likelihood is climbed
RESTICKS = (0.02, 0.2, 1.0)  # %/s
# Shares of the drawn speed, at which friction has fallen, at which a stem may stick again.
OF_STRIBECK = (0.02, 0.05, 0.1, 0.2, 0.35, 0.6, 1.0, 1.6)
# Elements that slip one by one turn over a way of their own.
OF_WAY = (0.6, 0.85, 1.2)
# A rise that settles, over that of the logarithm which it reaches after three minutes.
SETTLES = 3.5
NAMED, NOTHING, LITTLE = "named", "gains nothing", "too little"
REFUSED, SEARCH, DROPPED = "not asked", "search loses it", "found, then dropped"
MISSED = (NOTHING, LITTLE, REFUSED, SEARCH, DROPPED)
GROUPS = {kind: "an hour that moves" for kind in ("rich", "routine", "scatter", "noisy")}
GROUPS |= {"short": "a quarter of an hour"}

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
    "spring_hysteresis": lambda of: [
        [of["hysteresis_percent"], k * of["hysteresis_way_percent"]] for k in OF_WAY
    ],
}


def both_ways(opening: float, closing: float) -> list[list[float]]:
    """Of a valve that opens by air, and of one that closes by it."""
    return [[opening, closing], [closing, opening]]


def either_sign(size: float) -> list[list[float]]:
    """The size in the plant's direction and in the other."""
    return [[size], [-size]]


def at_truth(case: HiddenCase, term: Term, base: BaseFit) -> tuple[CoordinateLayout, Floats]:
    """The base with ``term``, and candidates (m, size) about the true sizes, S and J."""
    slug, evaluator = case.hidden[0], base.evaluator
    layout = evaluator.layout(base.fitted.layout.hypothesis.plus(term))
    own = {name.split(".", 1)[1]: value for name, value in case.sizes.items()}
    # A walk has no sizes that the term could begin from, so it begins from its own grid.
    walk = slug == "sensor_drift" and not own["drift_percent"]
    true_sizes = term.starts(evaluator.summary) if walk else SIZES[slug](own)
    rows = []
    for values, (S, J), k, plain, restick in product(
        true_sizes, S_AND_J, AROUND, (False, True), (None, *RESTICKS)
    ):
        row = about_truth(layout, base, case, (S, J), plain, restick)
        row[layout.places[slug]] = values
        row[layout.places[slug].start] *= 1.0 if slug == "travel_stop" else k
        rows.append(row)
    return layout, layout.bounds.clip(np.array(rows))


def about_truth(
    layout: CoordinateLayout,
    base: BaseFit,
    case: HiddenCase,
    of_true: tuple[float, float],
    plain: bool,
    restick: float | None,
) -> Floats:
    """(size,) the base, with ``of_true`` times the true S and J; the reading has no error where
    ``plain``, and the stem sticks again at ``restick``, %/s, where given."""
    row, (S, J), valve = np.zeros(layout.size), of_true, case.loop.valve
    row[: base_coordinate.N_BASE] = base.fitted.candidates.mean(axis=0)[: base_coordinate.N_BASE]
    if plain:
        row[[base_coordinate.ZERO, base_coordinate.GAIN]] = 0.0
    row[base_coordinate.S_PERCENT] = S * valve.S_read
    row[base_coordinate.RATIO] = J * valve.J_read / (S * valve.S_read)
    if restick is not None:
        row[base_coordinate.RESTICK] = restick
    return row


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


@dataclass(frozen=True)
class FromTruth:
    """How strong the right effect is from the truth, 1 at the limits of either judge; ``found``:
    the likelihood's own search finds it beside S and J alone."""

    trajectories: float = 0.0
    likelihood: float = 0.0
    found: bool = False
    why: str = ""

    def __str__(self) -> str:
        by = f"{self.trajectories:.2f} by trajectories, {self.likelihood:.2f} by the likelihood"
        return f"{by}{self.why}"


def from_truth(case: HiddenCase, recording: Recording) -> FromTruth | None:
    """The right effect, begun at the truth, or ``None`` where the record is not asked for it."""
    recording = on_own_clock(recording)
    measured = measured_record(recording)
    prepared = prepare(recording, measured, None, problem_of(recording, measured))
    slug = case.hidden[0]
    if slug in prepared.refused:
        return None
    if slug == RESTICK:
        by_likelihood, why = sticking_from_truth(case, prepared)
        return FromTruth(likelihood=by_likelihood, why=why)
    layout, starts = at_truth(case, catalogue()[slug], prepared.base)
    by_likelihood, why = likelihood_from_truth(case, prepared, layout, starts)
    return FromTruth(
        trajectories_from_truth(slug, prepared, layout, starts),
        by_likelihood,
        by_likelihood > 0.0 and is_found(slug, prepared),
        why,
    )


def trajectories_from_truth(
    slug: str, prepared: PreparedRecording, layout: CoordinateLayout, starts: Floats
) -> float:
    """The strength on unseen blocks, 0 where the size is not material."""
    evaluator = prepared.base.evaluator
    simple, rich = best_from(prepared.base, layout, starts)
    if not catalogue()[slug].material(rich.values(slug).mean(axis=0), evaluator.summary):
        return 0.0
    return strength(gain(evaluator, simple, rich), evaluator.measured_counts, slug)


def likelihood_from_truth(
    case: HiddenCase, prepared: PreparedRecording, layout: CoordinateLayout, starts: Floats
) -> tuple[float, str]:
    """The strength by the likelihood, and what it is made of; below 1 where it does not pass."""
    base, term = prepared.base, catalogue()[case.hidden[0]]
    if term.slug == DWELL or not scatter_matters(base.evaluator, base.fitted):
        return 0.0, " (not asked)"
    likelihood, simple = RecordLikelihood(base.evaluator), base.fitted.layout
    first = likelihood.first_of_record
    rich = climbed_from(likelihood, layout, starts)
    today = likelihood.maximised(simple, points_at(base.fitted, first))
    alone = climbed_from(likelihood, simple, starts[:, : simple.size])
    alone = max(alone, today, key=lambda at: at.total)
    one = _released(likelihood, _compared(likelihood, alone, rich, term))
    lost = one.simple.total - today.total
    why = (
        f" (gain {one.evidence.gain:.0f}, t {one.evidence.t:.1f}, scatter {one.rich.scatter:.2f}, "
        f"noise {one.rich.noise / base.evaluator.problem.sigma:.1f} of sigma; "
        f"S and J alone lose {lost:.0f})"
    )
    passes = _passes(one, base.evaluator)
    return (one.evidence.strength if passes else min(one.evidence.strength, 0.99)), why


def climbed_from(
    likelihood: RecordLikelihood, layout: CoordinateLayout, starts: Floats
) -> Likeliest:
    """The most likely point from the best of some starts, each climbed by itself."""
    quick = replace(likelihood, courses=FEW_COURSES)
    points = [np.append(row, likelihood.first_of_record) for row in starts]
    begun = quick.ranked(layout, points)[:CLIMBED]
    return max(
        (likelihood.maximised(layout, [one.point]) for one in begun), key=lambda at: at.total
    )


def sticking_from_truth(case: HiddenCase, prepared: PreparedRecording) -> tuple[float, str]:
    """The strength by the likelihood of a stem that sticks again, of which trajectories are asked
    all along."""
    base, valve = prepared.base, case.loop.valve
    if not scatter_matters(base.evaluator, base.fitted):
        return 0.0, " (not asked)"
    layout, centre = base.fitted.layout, base.fitted.candidates.mean(axis=0)
    starts = np.tile(centre, (len(OF_STRIBECK) * 2, 1))
    starts[:, base_coordinate.S_PERCENT] = valve.S_read
    starts[:, base_coordinate.RATIO] = valve.J_read / valve.S_read
    speeds = [of * case.sizes[f"{RESTICK}.stribeck_percent_per_s"] for of in OF_STRIBECK]
    starts[:, base_coordinate.RESTICK] = np.repeat(speeds, 2)
    starts[::2, [base_coordinate.ZERO, base_coordinate.GAIN]] = 0.0
    starts = layout.bounds.clip(starts)
    likelihood = RecordLikelihood(base.evaluator)
    sticking = climbed_from(likelihood, layout, starts)
    slides = pinned(layout, *COORDINATES[RESTICK])
    sliding = climbed_from(
        likelihood, slides, np.vstack((starts, sticking.candidate, base.fitted.candidates))
    )
    if scatters_most(sticking):
        sliding, sticking = released(likelihood, sliding, sticking)
    evidence = evidence_of(sticking, sliding)
    speed = float(sticking.candidate[base_coordinate.RESTICK])
    why = (
        f" (gain {evidence.gain:.0f}, t {evidence.t:.1f}, scatter {sticking.scatter:.2f}, "
        f"noise {sticking.noise / base.evaluator.problem.sigma:.1f} of sigma; at {speed:.2f} %/s)"
    )
    passes = speed >= LEAST_RESTICK and not leaves_something(sticking, base.evaluator, RELEASED)
    strong = evidence.strength / HARDER
    return (strong if passes else min(strong, 0.99)), why


def is_found(slug: str, prepared: PreparedRecording) -> bool:
    """Whether the likelihood's own search names the effect where nothing else is named."""
    terms = admissible(prepared.refused)
    named = named_effects(prepared, terms)
    nothing = replace(named, fitted=named.base, needed=())
    found = named_by_likelihood(nothing, of_the_valve(terms))
    return any(slug in needed.members for needed in found.needed)


def why_missed(slug: str, mismatch: Mismatch, truth: FromTruth | None) -> str:
    """What became of the right effect, which is as strong as ``truth`` says from there."""
    if truth is None:
        return REFUSED
    by_trajectories = max(
        (score.strength for score in mismatch.scores if score.slug == slug), default=0.0
    )
    if truth.found or by_trajectories >= 1.0:
        return DROPPED
    best = max(truth.trajectories, truth.likelihood)
    if best >= 1.0:
        return SEARCH
    return LITTLE if best >= NEAR else NOTHING


def of_the_catalogue(case: HiddenCase) -> bool:
    """Whether the case hides one effect of physics that is a term of its own."""
    if len(case.effects) != 1 or case.effects[0] in RECORD:
        return False
    term = catalogue().get(case.effects[0])
    return term is not None and (not term.in_base or term.slug == RESTICK)


def stored(recording: Recording) -> Recording:
    """With four decimals, as the proof's files have them."""
    signals = {
        role: replace(signal, values=np.round(signal.values, 4))
        for role, signal in recording.signals.items()
    }
    return replace(recording, signals=signals)


def table(counts: Counter[tuple[str, str]], of: str) -> str:
    """How many were named, and why the others were not, by what the counts are ``of``."""
    kinds = list(dict.fromkeys(kind for kind, _ in counts))
    lines = [f"{of:28s}" + "".join(f"{head:>21s}" for head in ("asked", NAMED, *MISSED))]
    for kind in (*kinds, "all"):
        of_kind = Counter[str]()
        for (other, why), count in counts.items():
            of_kind[why] += count if kind in (other, "all") else 0
        numbers = (of_kind.total(), *(of_kind[why] for why in (NAMED, *MISSED)))
        lines.append(f"{kind:28s}" + "".join(f"{number:21d}" for number in numbers))
    return "\n".join(lines)


def main() -> None:
    """Explain the valves, and say of each missed effect why."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=2119)
    parser.add_argument("--cases", type=int, default=400)
    requested = parser.parse_args()
    counts: Counter[tuple[str, str]] = Counter()
    of_effects: Counter[tuple[str, str]] = Counter()
    for number, drawn in enumerate(draw_hidden(requested.cases, requested.seed), start=1):
        if not of_the_catalogue(drawn):
            continue
        case, run = simulate_hidden(drawn)
        if not case.excited:
            continue
        slug, recording = case.hidden[0], stored(run.recording)
        kind = GROUPS.get(case.concealment, case.concealment)
        mismatch = explain(recording)
        if any(slug in effect.members for effect in mismatch.effects):
            counts[kind, NAMED] += 1
            of_effects[slug, NAMED] += 1
            continue
        truth = from_truth(case, recording)
        why = why_missed(slug, mismatch, truth)
        counts[kind, why] += 1
        of_effects[slug, why] += 1
        said = " and ".join(effect.slug for effect in mismatch.effects) or mismatch.finding
        strong = "" if truth is None else f"; from the truth {truth}"
        print(f"{number:4d} {slug}, {case.concealment}: {why}; said: {said}{strong}", flush=True)
    print(table(counts, "record"))
    print(table(of_effects, "effect"))


if __name__ == "__main__":
    main()
