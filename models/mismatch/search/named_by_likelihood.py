"""The effect that the likelihood of the whole record shows, where no trajectory does: which term is
named, and which of those that were named before the record does as well without.

A trajectory lets go where the record shows the stem let go, or else where the force has reached its
level. Behind noise, coarse steps or an archive few breakaways are seen, each of the others comes
early or late by chance, and what an effect changes is lost in that. The likelihood knows of that
chance (``breakaway_filter``). Each term is compared with S, J and the reading alone
(``compared_by_likelihood``); it must be more likely by more than chance reaches, and material.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from stemwatch.models.mismatch.acceptance_limits import RARELY_ACTS
from stemwatch.models.mismatch.fit.batched_search import conclude
from stemwatch.models.mismatch.fit.crossfit import on_both, scored
from stemwatch.models.mismatch.fit.evaluator import Evaluator, TermSet
from stemwatch.models.mismatch.likelihood.likelihood_evidence import LEAST_GAIN, more_likely
from stemwatch.models.mismatch.likelihood.maximum_likelihood import (
    OF_STEMS,
    RELEASED,
    Likeliest,
    RecordLikelihood,
)
from stemwatch.models.mismatch.search.breakaway_scatter import (
    ALL_OVER,
    leaves_something,
    released,
    scatters_as_no_stem,
    scatters_most,
    too_noisy,
)
from stemwatch.models.mismatch.search.compared_by_likelihood import Compared, tried_by_likelihood
from stemwatch.models.mismatch.search.named_at_likeliest import named_with
from stemwatch.models.mismatch.search.named_terms import Named
from stemwatch.models.mismatch.search.other_coordinates import carried_over
from stemwatch.models.mismatch.term import ActsOn, Term
from stemwatch.models.stickslip.parameters import Bounds

# Of 192 valves with nothing hidden (`draw_nulls`, seeds 4063 and 4064) play reaches 19 and a t of
# 3.3, and once 730 with a t of 1.0; of 96 of them other terms 23 and 2.0, but for dwell, which five
# show clearly: a stem that goes on after it has stood still for a moment lets go as if it needed
# time to stick. Dwell is left to the breakaways.
BESIDE = 1.5  # least strength beside what trajectories have shown
# Difference of two terms, and its t over the blocks, below which neither is more likely.
AS_LIKELY, AS_GOOD = 4.0, 1.5
# Parts of a size, of which the largest that is not material is compared with it.
LESS = tuple(np.linspace(0.98, 0.02, 49))


def named_by_likelihood(named: Named, terms: Sequence[Term]) -> Named:
    """``named`` with one more of ``terms``, if the likelihood shows it; else as it was."""
    likelihood = RecordLikelihood(named.evaluator)
    tried = [_released(likelihood, one) for one in tried_by_likelihood(likelihood, named, terms)]
    passing = [one for one in tried if _passes(one, named.evaluator)]
    if not passing:
        return named
    passing = _with_more_likely(passing, tried, named.evaluator)
    best, *others = sorted(passing, key=lambda one: -one.rich.total)
    for simpler in others:
        if simpler.term.slug in best.term.contains and _as_likely(best, simpler):
            best, others = simpler, [best, *(one for one in others if one is not simpler)]
            break
    if named.needed and best.evidence.strength < BESIDE:
        return named
    if not named.needed and scatters_as_no_stem(likelihood, best.rich):
        return named
    if not _told_from_harmless(likelihood, best):
        return named
    dispensable, left = _dispensable(likelihood, named, best)
    if dispensable:
        lacking = _lacking(named, dispensable, left)
        return named_with(likelihood, lacking, [replace(best, rich=left)], best.evidence)
    members = [best, *(one for one in others if _as_likely(best, one))]
    return named_with(likelihood, named, members, best.evidence)


def strongest_by_likelihood(named: Named, terms: Sequence[Term]) -> float:
    """The strength of the strongest term by the likelihood whose size is material, 0 without one,
    before anything is named by it: what chance reaches on a record with nothing hidden.
    """
    tried = tried_by_likelihood(RecordLikelihood(named.evaluator), named, terms)
    material = [one for one in tried if _is_material(one, named.evaluator)]
    return max((one.evidence.strength for one in material), default=0.0)


def _released(likelihood: RecordLikelihood, one: Compared) -> Compared:
    """A term whose scatter is at the limit of the searches, if that is all that speaks against it:
    with the scatter of a real stem, if it is strong enough with that; else without and with it at a
    wider limit, for the breakaways of one record may scatter more than those of the stem.
    """
    at_limit = scatters_most(one.rich) and not too_noisy(likelihood.evaluator, one.rich)
    strong = one.evidence.strength >= 1.0 and one.evidence.t < ALL_OVER
    if not (at_limit and strong and _is_material(one, likelihood.evaluator)):
        return one
    narrow = replace(one, rich=replace(likelihood, widest=OF_STEMS).again(one.rich))
    if narrow.evidence.strength >= 1.0:
        return narrow
    return Compared(one.term, *released(likelihood, one.simple, one.rich), RELEASED)


def _passes(one: Compared, evaluator: Evaluator) -> bool:
    """Whether a term is more likely than on records with nothing hidden, and material."""
    if leaves_something(one.rich, evaluator, one.widest) and one.evidence.t < ALL_OVER:
        return False
    return one.evidence.strength >= 1.0 and _is_material(one, evaluator)


def _with_more_likely(
    passing: Sequence[Compared], tried: Sequence[Compared], evaluator: Evaluator
) -> list[Compared]:
    """The terms that pass, and before them those that are more likely than any of these, though
    the scatter or the readings leave something over: what is less likely is not named alone.
    """
    least = max(one.rich.total for one in passing)
    stronger = (
        one
        for one in tried
        if one.rich.total > least and one.evidence.strength >= 1.0 and _is_material(one, evaluator)
    )
    return [*stronger, *passing]


def _is_material(one: Compared, evaluator: Evaluator) -> bool:
    values = one.rich.candidate[one.rich.layout.places[one.term.slug]]
    return one.term.material(values, evaluator.summary)


def _told_from_harmless(likelihood: RecordLikelihood, one: Compared) -> bool:
    """Whether the record tells what slows the command from the same in a size that is not material,
    at its most likely parameters. The air of a good valve takes some tenths of a second; a few
    samples after quick moves show that, and hardly how long.
    """
    if one.term.acts_on is not ActsOn.COMMAND:
        return True  # a good valve has none of it
    at, places = one.rich, one.rich.layout.places[one.term.slug]
    size, summary = at.candidate[places], likelihood.evaluator.summary
    harmless = next(
        (part * size for part in LESS if not one.term.material(part * size, summary)), None
    )
    if harmless is None:
        return True
    point, low, high = at.point.copy(), at.layout.bounds.low.copy(), at.layout.bounds.high.copy()
    point[places] = low[places] = high[places] = harmless
    layout = replace(at.layout, bounds=Bounds(low, high))
    more, t = more_likely(at, replace(likelihood, widest=one.widest).maximised(layout, [point]))
    return more >= AS_LIKELY and t >= AS_GOOD * RARELY_ACTS.get(one.term.slug, 1.0)


def _as_likely(best: Compared, other: Compared) -> bool:
    """Whether the record does not tell two terms apart."""
    more, t = more_likely(best.rich, other.rich)
    return more < AS_LIKELY or t < AS_GOOD


def _dispensable(
    likelihood: RecordLikelihood, named: Named, best: Compared
) -> tuple[set[str], Likeliest]:
    """Which of the terms that were named before the record is as likely without, now that there is
    the ``best``, and the record without them.
    """
    slugs, left = set[str](), best.rich
    for needed in named.needed:
        slug = needed.term.slug
        layout = likelihood.evaluator.layout(left.layout.hypothesis.without(slug))
        less = carried_over(on_both(left.layout, left.candidate), layout)[0]
        lacking = likelihood.maximised(layout, [np.append(less, left.of_record)])
        if left.total - lacking.total < LEAST_GAIN:
            slugs, left = slugs | {slug}, lacking
    return slugs, left


def _lacking(named: Named, slugs: set[str], left: Likeliest) -> Named:
    """``named`` without some terms, at a point that has one more than what remains."""
    needed = tuple(one for one in named.needed if one.term.slug not in slugs)
    if not needed:
        return replace(named, fitted=named.base, needed=())
    terms = {one.term.slug for one in needed}
    layout = named.evaluator.layout(
        TermSet(tuple(term for term in left.layout.hypothesis.terms if term.slug in terms))
    )
    candidate = carried_over(on_both(left.layout, left.candidate), layout)
    fitted = conclude(named.evaluator, scored(layout, candidate))
    return replace(named, fitted=fitted, needed=needed)
