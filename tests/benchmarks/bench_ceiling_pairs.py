"""Why one of two effects is missed: would it have passed beside the other, both begun at the truth?

    python -m tests.benchmarks.bench_ceiling_pairs [--seed S] [--cases N]

The valves of ``stemwatch prove`` that hide two effects of the catalogue, and whose records show
them, are explained. Each effect that is not named is fitted beside the other one, from the true
sizes of both and the true S and J, and compared with the best fit that lacks it: on unseen blocks,
as trajectories score it, and by the likelihood of the whole record. One line for each, and a table.
"""

from __future__ import annotations

import argparse
from collections import Counter
from dataclasses import dataclass
from itertools import product

import numpy as np

from stemwatch.models.mismatch.acceptance_limits import RARELY_ACTS, strength
from stemwatch.models.mismatch.explain import explain
from stemwatch.models.mismatch.findings import Mismatch
from stemwatch.models.mismatch.fit.batched_search import conclude
from stemwatch.models.mismatch.fit.crossfit import (
    CAREFUL,
    POLISH,
    Fitted,
    better,
    crossfit,
    gain,
    on_both,
    refit,
    scored,
)
from stemwatch.models.mismatch.fit.evaluator import CoordinateLayout, Evaluator, TermSet
from stemwatch.models.mismatch.likelihood.likelihood_evidence import LikelihoodEvidence, evidence_of
from stemwatch.models.mismatch.likelihood.maximum_likelihood import (
    OF_RECORD,
    Likeliest,
    RecordLikelihood,
    points_at,
)
from stemwatch.models.mismatch.measurement.record_effects import measured_record
from stemwatch.models.mismatch.prepared_recording import PreparedRecording, prepare, problem_of
from stemwatch.models.mismatch.search.breakaway_scatter import ALL_OVER, leaves_something
from stemwatch.models.mismatch.search.other_coordinates import carried_over, without
from stemwatch.models.mismatch.search.reading_errors import COORDINATES, pinned
from stemwatch.models.mismatch.term import Term
from stemwatch.models.mismatch.terms import catalogue
from stemwatch.models.preparation.own_clock import on_own_clock
from stemwatch.models.recording import Floats, Recording
from stemwatch.models.studies.simulator.hidden import HiddenCase, draw_hidden, simulate_hidden
from tests.benchmarks.bench_ceiling import EFFORT, OF_STRIBECK, S_AND_J, SIZES, about_truth, stored

# A reading that is off: what the base is fitted with, and the true size in either direction.
OF_READING = {
    "zero_shift": lambda of: [[of["zero_percent"]], [-of["zero_percent"]]],
    "span_error": lambda of: [[of["span"] - 1.0], [1.0 / of["span"] - 1.0]],
    "low_speed_restick": lambda of: [[k * of["stribeck_percent_per_s"]] for k in OF_STRIBECK],
}
EXCHANGES, SETTLED = 6, 1.0  # times that each begins from the other; less that neither has gained
RESTICKS = (None, 0.2)  # %/s; the base's own, and a stem that sticks again

NAMED = "named"
DROPPED = "found, and dropped afterwards"
BOTH = "lost by the search: passes by trajectories"
LIKELIHOOD = "lost by the search: passes by the likelihood alone"
REFUSED = "the recording was not asked, and could not have shown it"
NOWHERE = "below the limits of both from the truth"
LEFT = "the likelihood shows it, but leaves something, for which it may stand"
OUTCOMES = (NAMED, DROPPED, BOTH, LIKELIHOOD, REFUSED, LEFT, NOWHERE)


@dataclass(frozen=True)
class FromTruth:
    """What an effect reaches beside the other one, both begun at the truth: the strength of its
    trajectories and its likelihood; ``asked`` is whether the recording was asked for it."""

    asked: bool
    strength: float
    likelihood: LikelihoodEvidence
    leaves: bool  # even with both, breakaways or readings scatter more than those of real stems

    @property
    def passes(self) -> bool:
        """Whether either shows it."""
        likely = self.likelihood.strength >= 1.0
        return self.strength >= 1.0 or (likely and not self.doubtful)

    @property
    def doubtful(self) -> bool:
        """Whether something else may still be hidden, for which the effect may stand."""
        return self.leaves and self.likelihood.t < ALL_OVER


def own_sizes(case: HiddenCase, slug: str) -> dict[str, float]:
    """The drawn sizes of one effect, by their own names."""
    return {
        name.split(".", 1)[1]: size
        for name, size in case.sizes.items()
        if name.split(".", 1)[0] == slug
    }


def true_values(case: HiddenCase, slug: str, evaluator: Evaluator) -> list[list[float]]:
    """Sizes of an effect, as the coordinates of its term, among which is the truth."""
    own = own_sizes(case, slug)
    if slug in COORDINATES:
        return OF_READING[slug](own)
    if slug == "sensor_drift" and not own["drift_percent"]:
        # A walk has no sizes that the term could begin from, so it begins from its own grid.
        return [list(row) for row in catalogue()[slug].starts(evaluator.summary)]
    return SIZES[slug](own)


def at_truth(case: HiddenCase, prepared: PreparedRecording) -> tuple[CoordinateLayout, Floats]:
    """The base with both effects, and candidates (m, size) about their true sizes, S and J."""
    base = prepared.base
    terms = [catalogue()[slug] for slug in case.hidden if slug not in COORDINATES]
    layout = base.evaluator.layout(TermSet(tuple(terms)))
    sizes = [true_values(case, slug, base.evaluator) for slug in case.hidden]
    rows = []
    for both, (S, J), plain, restick in product(product(*sizes), S_AND_J, (False, True), RESTICKS):
        row = about_truth(layout, base, case, (S, J), plain, restick)
        for slug, values in zip(case.hidden, both, strict=True):
            row[places_of(layout, slug)] = values
        rows.append(row)
    return layout, layout.bounds.clip(np.array(rows))


def places_of(layout: CoordinateLayout, slug: str) -> slice:
    """Where a layout has the coordinates of an effect, of the reading or of a term."""
    if slug in COORDINATES:
        return slice(COORDINATES[slug][0], COORDINATES[slug][0] + 1)
    return layout.places[slug]


def lacking(evaluator: Evaluator, layout: CoordinateLayout, slug: str) -> CoordinateLayout:
    """A layout without one effect."""
    if slug in COORDINATES:
        return pinned(layout, *COORDINATES[slug])
    return evaluator.layout(layout.hypothesis.without(slug))


def fitted_from(evaluator: Evaluator, layout: CoordinateLayout, starts: Floats) -> Fitted:
    """The best trajectories that a careful search finds from ``starts`` (m, size)."""
    fitted = conclude(evaluator, crossfit(evaluator, layout, starts, EFFORT))
    return conclude(evaluator, refit(evaluator, fitted, POLISH))


def fitted_without(evaluator: Evaluator, rich: Fitted, slug: str, starts: Floats) -> Fitted:
    """The best trajectories without one effect: from the fit with it, and from all ``starts``
    (m, size)."""
    layout = lacking(evaluator, rich.layout, slug)
    reduced = [carried_over(on_both(rich.layout, row), layout)[0] for row in starts]
    simple = fitted_from(evaluator, layout, np.array(reduced))
    return conclude(evaluator, refit(evaluator, simple, CAREFUL, *without(rich, layout)))


def likelihood_of(
    evaluator: Evaluator, rich: Fitted, simple: Fitted, starts: Floats, slug: str
) -> tuple[LikelihoodEvidence, bool]:
    """How much more likely the record is with one effect, and whether it leaves something even so.
    Both are begun at the truth, and then from where the other has ended, until neither gains."""
    likelihood = RecordLikelihood(evaluator)
    first = likelihood.first_of_record
    of_both, of_one = rich.layout, simple.layout
    at_truth = [np.append(row, first) for row in starts]
    with_it = likelihood.maximised(of_both, [*points_at(rich, first), *at_truth])
    reduced = [_carried(of_both, point, of_one) for point in at_truth]
    without_it = likelihood.maximised(of_one, [*points_at(simple, first), *reduced])
    for _ in range(EXCHANGES):
        before = with_it.total, without_it.total
        less = _carried(of_both, with_it.point, of_one)
        without_it = _better(without_it, likelihood.maximised(of_one, [less]))
        nothing = _carried(of_one, without_it.point, of_both)
        same_size = nothing.copy()
        same_size[places_of(of_both, slug)] = with_it.point[places_of(of_both, slug)]
        for point in (nothing, same_size):
            with_it = _better(with_it, likelihood.maximised(of_both, [point]))
        if with_it.total + without_it.total - sum(before) < SETTLED:
            break
    rarely = RARELY_ACTS.get(slug, 1.0)
    evidence = evidence_of(with_it, without_it, rarely)
    return evidence, leaves_something(with_it, evaluator)


def _better(one: Likeliest, other: Likeliest) -> Likeliest:
    """The more likely of two."""
    return max(one, other, key=lambda at: at.total)


def _carried(of: CoordinateLayout, point: Floats, layout: CoordinateLayout) -> Floats:
    """(size + 2,) a point in the coordinates of another layout."""
    row = carried_over(on_both(of, point[:-OF_RECORD]), layout)[0]
    return np.append(row, point[-OF_RECORD:])


def from_truth(case: HiddenCase, recording: Recording, missed: list[str]) -> dict[str, FromTruth]:
    """What each of the ``missed`` effects reaches beside the other one."""
    recording = on_own_clock(recording)
    measured = measured_record(recording)
    prepared = prepare(recording, measured, None, problem_of(recording, measured))
    evaluator, (layout, starts) = prepared.base.evaluator, at_truth(case, prepared)
    rich = fitted_from(evaluator, layout, starts)
    return {slug: _of_one(prepared, rich, starts, catalogue()[slug]) for slug in missed}


def _of_one(prepared: PreparedRecording, rich: Fitted, starts: Floats, term: Term) -> FromTruth:
    """What one effect reaches, of a fit with both."""
    evaluator, slug = prepared.base.evaluator, term.slug
    simple = fitted_without(evaluator, rich, slug, starts)
    nothing = conclude(evaluator, scored(rich.layout, carried_over(simple, rich.layout)))
    best = better(evaluator, nothing, rich)
    values = best.candidates.mean(axis=0)[places_of(best.layout, slug)]
    reached = 0.0
    if term.material(values, evaluator.summary):
        number = 0 if slug in COORDINATES else 1
        counts = evaluator.measured_counts
        reached = strength(gain(evaluator, simple, best), counts, slug, number)
    likelihood, leaves = likelihood_of(evaluator, best, simple, starts, slug)
    return FromTruth(slug not in prepared.refused, reached, likelihood, leaves)


def outcome_of(slug: str, mismatch: Mismatch, reached: FromTruth) -> str:
    """What became of an effect that is not named."""
    found = max((score.strength for score in mismatch.scores if score.slug == slug), default=0.0)
    if found >= 1.0:
        return DROPPED
    if not reached.asked and not reached.passes:
        return REFUSED
    if reached.strength >= 1.0:
        return BOTH
    if reached.passes:
        return LIKELIHOOD
    return LEFT if reached.likelihood.strength >= 1.0 else NOWHERE


def of_the_catalogue(case: HiddenCase) -> bool:
    """Whether a case hides two effects of physics."""
    return len(case.hidden) == 2 and case.hidden == case.effects


def main() -> None:
    """Explain the valves, and say of each missed effect why."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=2119)
    parser.add_argument("--cases", type=int, default=400)
    requested = parser.parse_args()
    counts, pairs = Counter[str](), Counter[str]()
    for drawn in filter(of_the_catalogue, draw_hidden(requested.cases, requested.seed)):
        case, run = simulate_hidden(drawn)
        if not case.excited:
            continue
        recording = stored(run.recording)
        mismatch = explain(recording)
        said = {slug for effect in mismatch.effects for slug in effect.members}
        missed = [slug for slug in case.hidden if slug not in said]
        counts[NAMED] += len(case.hidden) - len(missed)
        reached = from_truth(case, recording, missed) if missed else {}
        for slug, of_it in reached.items():
            outcome = outcome_of(slug, mismatch, of_it)
            counts[outcome] += 1
            (other,) = set(case.hidden) - {slug}
            print(
                f"{slug} beside {other}, {case.concealment}: {outcome} (trajectories "
                f"{of_it.strength:.2f}, likelihood {of_it.likelihood.strength:.2f} of the limits"
                f"{', something left' if of_it.doubtful else ''})",
                flush=True,
            )
        could = all(of_it.passes for of_it in reached.values())
        pairs[NAMED if not missed else "could be" if could else "not in the record"] += 1
    for outcome in OUTCOMES:
        print(f"{counts[outcome]:4d}  {outcome}")
    print("pairs:", dict(pairs))


if __name__ == "__main__":
    main()
