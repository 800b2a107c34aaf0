"""Dwell that only the likelihood of the whole record shows, where nothing else is named.

Dwell raises the breakaway and leaves the sliding level as it is. So does any breakaway that comes
late by chance: trajectories of S and J, which hold a level as high as after the usual rest, follow
such a stem nearly as well. The breakaways that are seen tell the two apart if they are many and
their moments are known; behind noise, coarse steps or an archive that draws lines they are not. The
likelihood weighs all moments at which the stem may have let go.

What looks like dwell is mostly a search without it that has ended at too low a breakaway level: the
stem holds more than that after most rests, the long ones first. Where the stem comes to rest tells
the sliding level, ``(S - J)/2``, and a search hardly leaves it. So either of the two is begun from
many breakaway levels at the sliding level that was found, and again from where the other ended.

Nor does the record show dwell where it is explained as well by a packing that lets go the sooner
the quicker it is loaded (``quick_loading``), whoever has proposed the dwell.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from stemwatch.models.mismatch.fit.base_coordinate import RATIO, RESTICK, S_PERCENT, S_and_J
from stemwatch.models.mismatch.fit.crossfit import Fitted, on_both
from stemwatch.models.mismatch.fit.evaluator import CoordinateLayout, Evaluator
from stemwatch.models.mismatch.likelihood.likelihood_evidence import LikelihoodEvidence
from stemwatch.models.mismatch.likelihood.maximum_likelihood import (
    FEW_COURSES,
    Likeliest,
    RecordLikelihood,
    points_at,
)
from stemwatch.models.mismatch.search.breakaway_levels import DWELL, breakaway_evidence
from stemwatch.models.mismatch.search.breakaway_scatter import (
    leaves_something,
    less_scattered,
    scatter_matters,
)
from stemwatch.models.mismatch.search.compared_by_likelihood import Compared
from stemwatch.models.mismatch.search.named_at_likeliest import named_with
from stemwatch.models.mismatch.search.named_terms import Named
from stemwatch.models.mismatch.search.needed_terms import lacking
from stemwatch.models.mismatch.search.other_coordinates import carried_over
from stemwatch.models.mismatch.search.quick_loading import QUICK_LOADING
from stemwatch.models.mismatch.search.same_rests import sliding_level, with_breakaway
from stemwatch.models.mismatch.term import Term
from stemwatch.models.recording import Floats

# Least gain and t of dwell alone, and least gain beside what quick loading does:
# `python -m tests.benchmarks.bench_dwell` counts what valves with nothing hidden reach.
LEAST_GAIN, LEAST_T = 8.0, 2.0
# Standard errors of the breakaways, where they tell of dwell, below which they contradict it,
# whatever shows it.
CONTRADICTED_Z = 0.5
# Breakaway levels without and with dwell, times the one that was found.
LEVELS, LEVELS_WITH = (0.8, 0.9, 1.0, 1.1, 1.2, 1.35, 1.5, 1.75), (0.9, 1.0, 1.1, 1.3)
# Speeds below which a stem sticks again, %/s, beside the one that was found: each has its levels.
RESTICKS, RESTICKS_WITH = (0.0, 0.03, 0.06, 0.1, 0.16), (0.03, 0.1)
# Dwell, percent per e-fold of rest, and how many e-folds the usual rest may be.
SIZES, USUAL = (0.1, 0.2, 0.35, 0.6), (0.0, 0.7, 1.4, 2.1, 2.8)
LEAST_J = 0.02  # percent
# Breakaway levels, times the one that was found, and by what share of them a stem lets go sooner at
# 1 %/s.
LEVELS_LOADED, SHARES_LOADED = (0.9, 1.0, 1.15, 1.35, 1.6, 2.0), (0.0, 0.05, 0.15, 0.4, 1.0)
# Share of the least gain that a look at dwell, from so many points, must find. Of the 45 valves
# that hide dwell alone (`draw_hidden`, 4090, 2119, 2124, 2127 and 2128) those on which it is named
# come to 1.2 of it and more.
WORTH, LOOKED_FROM = 0.75, 2
LOOKS, CLIMBED, FEW_ROUNDS = 8, 3, 2  # points that are looked at, and searched on
EXCHANGES, WORTH_ANOTHER = 3, 0.3


def dwell_by_likelihood(named: Named, terms: Sequence[Term]) -> Named:
    """``named``, of which nothing is needed, with dwell if the likelihood shows it; else as it
    was."""
    term = next((term for term in terms if term.slug == DWELL), None)
    if term is None or named.needed or named.sticks_again is not None:
        return named
    evaluator, fitted = named.evaluator, named.fitted
    if not scatter_matters(evaluator, fitted) or _contradicted(evaluator, fitted):
        return named
    likelihood = RecordLikelihood(evaluator)
    one = compared_with_dwell(likelihood, fitted, term, LEAST_GAIN)
    if not shows_dwell(likelihood, one):
        return named
    return named_with(likelihood, named, [one], _by_own_limits(one))


def without_unlikely_dwell(named: Named) -> Named:
    """``named`` without a dwell that trajectories or breakaways have shown, and the breakaways or
    the likelihood contradict; else as it was."""
    needed = next((one for one in named.needed if one.term.slug == DWELL), None)
    if needed is None or needed.likelihood is not None:
        return named
    evaluator, without = named.evaluator, needed.without
    if not scatter_matters(evaluator, without):
        return named
    if not _contradicted(evaluator, without):
        likelihood = RecordLikelihood(evaluator)
        if _stands(likelihood, compared_with_dwell(likelihood, without, needed.term, LEAST_GAIN)):
            return named
    return lacking(named, {DWELL})


def _by_own_limits(one: Compared) -> LikelihoodEvidence:
    """The evidence for dwell, whose strength is 1 at the limits of dwell alone."""
    gain, t = one.evidence.gain, one.evidence.t
    return LikelihoodEvidence(gain, t, min(gain / LEAST_GAIN, t / LEAST_T))


def shows_dwell(likelihood: RecordLikelihood, one: Compared) -> bool:
    """Whether the record is more likely with dwell than records with nothing hidden are, the size
    matters, and it stands against what only looks like it."""
    size = one.rich.candidate[one.rich.layout.places[DWELL]]
    return (
        _by_own_limits(one).strength >= 1.0
        and one.term.material(size, likelihood.evaluator.summary)
        and _stands(likelihood, one)
    )


def _stands(likelihood: RecordLikelihood, one: Compared) -> bool:
    """Whether nothing else is left beside dwell, and the record still shows it where quick loading
    may let the stem go sooner."""
    if leaves_something(one.rich, likelihood.evaluator):
        return False
    return with_quick_loading(likelihood, one).evidence.gain >= LEAST_GAIN


def _contradicted(evaluator: Evaluator, fitted: Fitted) -> bool:
    """Whether the breakaways beside what is ``fitted`` tell of dwell, and show none."""
    scores = (seen.z for seen in breakaway_evidence(evaluator, fitted) if seen.slug == DWELL)
    return next(scores, CONTRADICTED_Z) < CONTRADICTED_Z


def compared_with_dwell(
    likelihood: RecordLikelihood, simple: Fitted, term: Term, least: float
) -> Compared:
    """The record as ``simple`` has it and with dwell, each at the most likely parameters that are
    found; at those of a look where that shows that dwell does not gain ``least``."""
    first = likelihood.first_of_record
    quick, points = replace(likelihood, courses=FEW_COURSES), points_at(simple, first)
    begun = less_scattered(quick, quick.maximised(simple.layout, points))
    look = _looked_at(quick, begun, term)
    if look.evidence.gain < WORTH * least:
        return look
    alone = likelihood.maximised(simple.layout, [begun.point, *points])
    starts = _without(alone.candidate, _scales(alone, first))
    alone = _searched(likelihood, alone.layout, starts, alone)
    look = _looked_at(quick, quick.at(alone.layout, alone.point), term)
    if look.evidence.gain < WORTH * least:
        return look
    return _searched_in_turn(likelihood, alone, term)


def _with_term(likelihood: RecordLikelihood, alone: Likeliest, term: Term) -> CoordinateLayout:
    return likelihood.evaluator.layout(alone.layout.hypothesis.plus(term))


def _looked_at(quick: RecordLikelihood, alone: Likeliest, term: Term) -> Compared:
    """The record ``alone`` and some steps with dwell, from the most likely of its sizes, all else
    as it is without, where its breakaway is that after the usual rest."""
    layout = _with_term(quick, alone, term)
    points = _with(alone, layout, (alone.of_record,), levels=(1.0,), resticks=())
    looks = (quick.climbed(one, FEW_ROUNDS) for one in quick.ranked(layout, points)[:LOOKED_FROM])
    return Compared(term, alone, max(looks, key=lambda one: one.total))


def _searched_in_turn(likelihood: RecordLikelihood, alone: Likeliest, term: Term) -> Compared:
    """The record ``alone`` and with dwell, each searched from where the other has ended."""
    first, layout = likelihood.first_of_record, _with_term(likelihood, alone, term)
    rich = _searched(likelihood, layout, _with(alone, layout, _scales(alone, first)))
    return _exchanged(likelihood, term, alone, rich)


def with_quick_loading(likelihood: RecordLikelihood, one: Compared) -> Compared:
    """The record without and with dwell where the stem may let go the sooner the quicker it is
    loaded."""
    first, begun = likelihood.first_of_record, list[Likeliest]()
    for at in (one.simple, one.rich):
        layout = likelihood.evaluator.layout(at.layout.hypothesis.plus(QUICK_LOADING))
        begun.append(_searched(likelihood, layout, _loaded(at, layout, (at.of_record, first))))
    return _exchanged(likelihood, one.term, *begun)


def _exchanged(
    likelihood: RecordLikelihood, term: Term, alone: Likeliest, rich: Likeliest
) -> Compared:
    """Without and with dwell, each begun from where the other has ended, until neither gains."""
    layout, first = rich.layout, likelihood.first_of_record
    for exchange in range(EXCHANGES):
        before = alone.total
        less = carried_over(on_both(layout, rich.candidate), alone.layout)[0]
        as_with = likelihood.maximised(alone.layout, [np.append(less, rich.of_record)])
        alone = max(alone, as_with, key=lambda one: one.total)
        alone = _searched(likelihood, alone.layout, _without(less, _scales(rich, first)), alone)
        # The record without dwell has the last word: it must have been begun from all with it.
        if alone.total - before < WORTH_ANOTHER or exchange == EXCHANGES - 1:
            break
        starts = _with(alone, layout, (alone.of_record, rich.of_record))
        rich = _searched(likelihood, layout, starts, rich)
    return Compared(term, alone, rich)


def _scales(at: Likeliest, first: Floats) -> tuple[Floats, ...]:
    """Noise and scatter to begin with: as at a point, those to begin any search with, and less
    scatter, which a wrong level has made too large."""
    return at.of_record, first, at.of_record - np.array([0.0, np.log(2.0)])


def _searched(
    likelihood: RecordLikelihood,
    layout: CoordinateLayout,
    points: Iterable[Floats],
    known: Likeliest | None = None,
) -> Likeliest:
    """The most likely point that is found from many, or the one that is ``known``."""
    quick = replace(likelihood, courses=FEW_COURSES)
    looks = (quick.climbed(one, FEW_ROUNDS) for one in quick.ranked(layout, points)[:LOOKS])
    begun = sorted(looks, key=lambda one: -one.total)[:CLIMBED]
    found = [likelihood.maximised(layout, [one.point]) for one in begun]
    return max([*found, *([known] if known else [])], key=lambda one: one.total)


def _at_levels(row: Floats, times: Sequence[float]) -> Iterator[Floats]:
    """A row (size,) at ``times`` its breakaway level, with its sliding level."""
    breakaway, least = 0.5 * sum(S_and_J(row)), sliding_level(row) + LEAST_J
    for part in times:
        yield with_breakaway(row, max(part * breakaway, least))


def _without(row: Floats, scales: Sequence[Floats]) -> Iterator[Floats]:
    """Points (size + 2,) without dwell about a row (size,)."""
    for other in _at_levels(row, LEVELS):
        for restick in {float(row[RESTICK]), *RESTICKS}:
            other[RESTICK] = restick
            for of_record in scales:
                yield np.append(other, of_record)


def _loaded(at: Likeliest, layout: CoordinateLayout, scales: Sequence[Floats]) -> Iterator[Floats]:
    """Points (size + 2,) about ``at`` of a stem that a quick command lets go below its level, which
    may be higher for it."""
    place = layout.places[QUICK_LOADING.slug].start
    none = carried_over(on_both(at.layout, at.candidate), layout)[0]
    for row in _at_levels(none, LEVELS_LOADED):
        breakaway = 0.5 * sum(S_and_J(row))
        for share, of_record in product(SHARES_LOADED, scales):
            other = row.copy()
            other[place] = share * breakaway
            yield np.append(other, of_record)


def _with(
    alone: Likeliest,
    layout: CoordinateLayout,
    scales: Sequence[Floats],
    levels: Sequence[float] = LEVELS_WITH,
    resticks: Sequence[float] = RESTICKS_WITH,
) -> Iterator[Floats]:
    """Points (size + 2,) with dwell about the record ``alone``, whose breakaway is that after the
    usual rest, at ``levels`` times it."""
    place = layout.places[DWELL].start
    none = carried_over(on_both(alone.layout, alone.candidate), layout)[0]
    yield np.append(none, alone.of_record)
    resticks_and_own = {float(none[RESTICK]), *resticks}
    for row, size, usual in product(_at_levels(none, levels), SIZES, USUAL):
        S, J = S_and_J(row)
        J_left = J - usual * size
        if J_left <= LEAST_J:
            continue
        for restick, of_record in product(resticks_and_own, scales):
            other = row.copy()
            other[S_PERCENT] = S - usual * size
            other[RATIO] = J_left / other[S_PERCENT]
            other[place], other[RESTICK] = size, restick
            yield np.append(other, of_record)
