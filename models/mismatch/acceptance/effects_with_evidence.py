"""The effects of a hypothesis, each with its size, its interval and what speaks for it."""

from __future__ import annotations

import numpy as np

from stemwatch.models.mismatch.acceptance.one_cause import of_one_kind
from stemwatch.models.mismatch.evidence.describe_effect import (
    Directions,
    by_events,
    by_likelihood,
    directions,
    effect,
    with_what_tells,
)
from stemwatch.models.mismatch.findings import Effect
from stemwatch.models.mismatch.fit.crossfit import Fitted
from stemwatch.models.mismatch.fit.evaluator import CoordinateLayout
from stemwatch.models.mismatch.search.named_terms import Named, Needed
from stemwatch.models.mismatch.search.reading_errors import (
    STICKS_AGAIN,
    UNEVEN,
    ReadingError,
    values_of,
    zero_or_uneven_friction,
)
from stemwatch.models.mismatch.search.reading_rivals import ZERO
from stemwatch.models.mismatch.terms import catalogue
from stemwatch.models.recording import Floats, Recording


def effects_with_evidence(
    recording: Recording,
    named: Named,
    reading_errors: list[ReadingError],
    layout: CoordinateLayout,
    best: Floats,
    candidate_draws: Floats,
) -> tuple[Effect, ...]:
    """The accepted terms and the reading's errors, strongest first."""
    evaluator, in_directions = named.evaluator, directions(recording)
    effects = [
        _needed_effect(named, needed, layout, best, candidate_draws, in_directions)
        for needed in named.needed
    ]
    off = zero_or_uneven_friction(evaluator, named.fitted, catalogue()[ZERO])
    effects = [with_what_tells(one, off) if one.slug == UNEVEN else one for one in effects]
    for reading in reading_errors:
        share = _share(reading.without, named.fitted)
        error = effect(
            evaluator,
            reading.term,
            reading.members,
            values_of(reading.term.slug, best),
            np.array([values_of(reading.term.slug, row) for row in candidate_draws]),
            reading.advantage,
            share,
            (reading.without.layout, reading.without.candidates.mean(axis=0)),
            in_directions,
        )
        if named.sticks_again is not None and reading.term.slug in STICKS_AGAIN:
            error = by_likelihood(error, named.sticks_again)
        effects.append(with_what_tells(error, reading.tells))
    return tuple(sorted(effects, key=lambda accepted: -accepted.evidence.mean))


def _needed_effect(
    named: Named,
    needed: Needed,
    layout: CoordinateLayout,
    best: Floats,
    candidate_draws: Floats,
    in_directions: Directions,
) -> Effect:
    """A needed term as an effect; where breakaways showed it, with their evidence."""
    own, coordinate_slice = needed.term.slug, layout.places[needed.term.slug]
    # What is needed beside it is no rival; two of one kind become one effect afterwards.
    beside = {slug for slug in layout.places if slug != own and not of_one_kind(slug, own)}
    alike = [slug for slug in needed.term.alike if slug not in layout.places]
    members = dict.fromkeys((*needed.members, *alike))
    of_trajectories = effect(
        named.evaluator,
        needed.term,
        tuple(slug for slug in members if slug not in beside),
        best[coordinate_slice],
        candidate_draws[:, coordinate_slice],
        needed.advantage,
        _share(needed.without, named.fitted),
        (needed.without.layout, needed.without.candidates.mean(axis=0)),
        in_directions,
    )
    if needed.likelihood is not None:
        return by_likelihood(of_trajectories, needed.likelihood)
    if needed.events is None:
        return of_trajectories
    return by_events(of_trajectories, needed.events, needed.term, in_directions)


def _share(before: Fitted, after: Fitted) -> float:
    """The share of the held-out loss that goes."""
    return float(np.clip(1.0 - after.heldout.sum() / max(before.heldout.sum(), 1e-12), -1.0, 1.0))
