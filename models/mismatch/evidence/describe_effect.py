"""Accepted terms in words: the sentence, where it shows, what to check, and which test would
separate it from its rivals.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.acceptance_limits import strength
from stemwatch.models.mismatch.evidence.locate import locate
from stemwatch.models.mismatch.findings import Effect, EffectEvidence, Finding, ResidualMap
from stemwatch.models.mismatch.fit.evaluator import CoordinateLayout, Evaluator
from stemwatch.models.mismatch.fit.uncertainty import estimate
from stemwatch.models.mismatch.likelihood.likelihood_evidence import LikelihoodEvidence
from stemwatch.models.mismatch.search.breakaway_levels import DWELL, LEAST_Z, BreakawayEvidence
from stemwatch.models.mismatch.term import Term
from stemwatch.models.mismatch.terms import catalogue
from stemwatch.models.preparation.own_clock import SpokenEstimate, estimate_in_seconds
from stemwatch.models.recording import Floats, Recording, Role
from stemwatch.models.stickslip.advantage import Advantage
from stemwatch.models.words import counted

FLOW_UNITS = ("/h", "/s", "/min", "gpm", "scfm", "lpm")
MODEL_ERROR = 0.03  # one sigma, share of a parameter
WITHIN_SAMPLE = 0.1  # one sigma, samples
GOES_WITH = 0.5  # correlation of flow and position, from which the flow shows which direction opens


@dataclass(frozen=True)
class Directions:
    """Words for the two directions of the position."""

    rising: str = "rising"
    falling: str = "falling"


def directions(recording: Recording) -> Directions:
    """ "opening" and "closing" where a flow goes with the position, else "rising" and "falling"."""
    pv, mv = recording.get(Role.PV), recording.mv
    if pv is None or mv is None or not pv.unit.lower().endswith(FLOW_UNITS):
        return Directions()
    both_usable = recording.usable & pv.usable
    if np.count_nonzero(both_usable) < 100:
        return Directions()
    a, b = mv.values[both_usable], pv.values[both_usable]
    if np.std(a) == 0.0 or np.std(b) == 0.0:
        return Directions()
    correlation = float(np.corrcoef(a, b)[0, 1])
    if correlation > GOES_WITH:
        return Directions("opening", "closing")
    return Directions("closing", "opening") if correlation < -GOES_WITH else Directions()


def estimates(
    term: Term, values: Floats, candidate_draws: Floats, interval_s: float
) -> dict[str, Estimate]:
    """The term's parameters from its best coordinates (k,) and draws (m, k), on the own clock.

    Widened by two errors that no bootstrap sees: the term is only a model of the valve, and OP and
    MV are read somewhere within the sampling interval. A parameter at the end of what the record
    could show has a lower bound only.
    """
    best = term.parameters(values)
    spread = [term.parameters(candidate) for candidate in candidate_draws]
    named = {}
    for name, (value, unit) in best.items():
        error = MODEL_ERROR * abs(value) + (WITHIN_SAMPLE * interval_s if unit == "s" else 0.0)
        named[name] = estimate(
            np.array([parameters[name][0] for parameters in spread]), value, unit, error
        )
    for name, reason in term.only_at_least(values).items():
        named[name] = replace(named[name], value=None, high=None, reason=reason)
    return named


def effect(
    evaluator: Evaluator,
    term: Term,
    members: tuple[str, ...],
    values: Floats,
    candidate_draws: Floats,
    advantage: Advantage,
    share: float,
    without_term: tuple[CoordinateLayout, Floats],
    found_directions: Directions,
) -> Effect:
    """One accepted term as an ``Effect`` in words. ``without_term`` is the best model that lacks
    it.
    """
    unit_s = evaluator.problem.unit_s
    own_estimates = estimates(term, values, candidate_draws, evaluator.problem.interval_s)
    spoken_estimates = {
        name: SpokenEstimate.of(own_estimate, unit_s)
        for name, own_estimate in own_estimates.items()
    }
    inherent = term.inherent(values, evaluator.summary)
    sentence = term.sentence(spoken_estimates, found_directions.rising, found_directions.falling)
    return Effect(
        slug=term.slug,
        members=members,
        sentence=_without_work(sentence) if inherent else sentence,
        where=_places_in_record(evaluator, *without_term),
        check=term.words.check,
        decide=term.words.decide,
        parameters={name: estimate_in_seconds(one, unit_s) for name, one in own_estimates.items()},
        evidence=EffectEvidence(
            mean=advantage.mean,
            t=advantage.t,
            share=share,
            strength=strength(advantage, evaluator.measured_counts, term.slug),
            note=_note(advantage, members),
        ),
        inherent=inherent,
    )


def _without_work(sentence: str) -> str:
    """``sentence`` without what it says to check: what belongs to the machine asks for no work."""
    told, check, _ = sentence.partition(": check ")
    return f"{told}." if check else sentence


def in_order_of_work(effects: Iterable[Effect]) -> tuple[Effect, ...]:
    """``effects`` with the one to mend first at the front; every output keeps this order.

    Defects come before what such a machine is made with, and what is at the valve before what
    clocks or a calibration may have made. Among these the order is that of the share of the squared
    residual: control suffers from how far the position is off, while the gain that names an effect
    is robust and counts rather how often.
    """
    terms = catalogue()

    def rank(one: Effect) -> tuple[bool, bool, float]:
        return one.inherent, terms[one.slug].words.of_record, -one.evidence.share

    return tuple(sorted(effects, key=rank))


def by_events(
    found_effect: Effect, seen: BreakawayEvidence, term: Term, found_directions: Directions
) -> Effect:
    """``found_effect`` with the evidence and the interval from its breakaways in place of those
    from the residual.
    """
    note = (
        f"The {seen.events} breakaways together tell it ({seen.z:.1f} standard errors); in the "
        "residual it is small, for each of them scatters as well."
    )
    if seen.slug == DWELL and seen.rate_z >= LEAST_Z[DWELL]:
        note += (
            " They also come earlier the quicker OP moves, as those of a packing that gives before "
            "it lets go; part of the rise may be that. Holds of different lengths before the same "
            "ramp tell which."
        )
    evidence = replace(
        found_effect.evidence, events_z=seen.z, strength=seen.z / LEAST_Z[seen.slug], note=note
    )
    fitted = found_effect.parameters["b"]
    assert fitted.low is not None
    assert fitted.high is not None
    either = 2.0 * seen.error
    low, high = min(fitted.low, seen.size - either), max(fitted.high, seen.size + either)
    parameters = {**found_effect.parameters, "b": replace(fitted, low=max(low, 0.0), high=high)}
    sentence = term.sentence(parameters, found_directions.rising, found_directions.falling)
    return replace(found_effect, sentence=sentence, evidence=evidence, parameters=parameters)


def by_likelihood(found_effect: Effect, seen: LikelihoodEvidence) -> Effect:
    """``found_effect`` with the evidence of the whole record's likelihood."""
    note = (
        "The record as a whole tells it: over all moments at which the stem may have let go, it is "
        f"more likely with this effect than without it, by {seen.t:.1f} standard errors over the "
        "blocks of time. Simulated runs alone show it no clearer than chance would."
    )
    if len(found_effect.members) > 1:
        others = ", ".join(slug.replace("_", " ") for slug in found_effect.members[1:])
        note += f" This recording cannot tell it from {others}."
    evidence = replace(
        found_effect.evidence, likelihood_gain=seen.gain, strength=seen.strength, note=note
    )
    return replace(found_effect, evidence=evidence)


def with_what_tells(found_effect: Effect, tells: str) -> Effect:
    """``found_effect`` with a sentence on what would tell it from the others of its class."""
    note = f"{found_effect.evidence.note} {tells}".rstrip()
    return replace(found_effect, evidence=replace(found_effect.evidence, note=note))


def residual_map(
    evaluator: Evaluator,
    simulated: Floats,
    stem: Floats | None = None,
    sigma: float | None = None,
) -> ResidualMap:
    """Where ``simulated`` (n,), percent, differs from the reading of the evaluator's record.

    ``stem`` (n,), percent, is the run that gives the place and the motion of the stem: near to the
    recording, but without its noise. ``simulated`` takes its place where it is not given. ``sigma``
    is the noise of MV in percent, where it is better known than the problem knows it.
    """
    problem = evaluator.problem
    return locate(
        problem.op,
        problem.mv,
        simulated,
        evaluator.measured,
        problem.block,
        problem.interval_s,
        problem.sigma if sigma is None else sigma,
        problem.unit_s,
        stem=stem,
    )


def _places_in_record(evaluator: Evaluator, layout: CoordinateLayout, candidate: Floats) -> str:
    """The place of the largest residual that is left without the effect."""
    simulated, _ = evaluator.assimilated(layout, candidate)
    places = residual_map(evaluator, simulated)
    return places.hot[0].sentence if places.hot else "Spread over the record, no single place."


def _note(advantage: Advantage, members: tuple[str, ...]) -> str:
    lower = 100.0 * (1.0 - float(np.exp(-advantage.mean)))
    note = (
        f"It lowers the error on unseen blocks of time by {lower:.0f} % "
        f"({advantage.t:.1f} standard errors)"
    )
    if len(members) > 1:
        others = ", ".join(slug.replace("_", " ") for slug in members[1:])
        return f"{note}; this recording cannot tell it from {others}."
    return f"{note}; no other effect of the catalogue does as well in its place."


def sentence_of(
    finding: Finding,
    effects: tuple[Effect, ...],
    refused: Mapping[str, str],
    before: ResidualMap,
    doubt: str,
    missed: str,
) -> str:
    """The sentence about the recording. ``refused`` are terms that could not be tested; ``before``
    is the map of S and J alone; ``doubt`` says why it is not known whether something is left out;
    ``missed`` says, after a leading blank, what S and J leave unexplained where nothing else is
    needed.
    """
    if finding is Finding.NONE:
        untested = counted(len(refused), "effect")
        tail = f" {untested} could not be tested here." if refused else ""
        return f"S and J explain this recording; nothing else is needed.{missed}{tail}"
    if finding is Finding.UNKNOWN and doubt:
        return f"{doubt}: it cannot be told whether anything is left out, and nothing is named."
    if finding is Finding.UNKNOWN:
        place_clause = (
            "the residual map shows where it differs"
            if before.hot
            else "it differs all over the record, in no single place"
        )
        return (
            "S and J do not explain this recording, and nothing in the catalogue does; "
            f"{place_clause}."
        )
    return " ".join(effect.sentence for effect in effects)
