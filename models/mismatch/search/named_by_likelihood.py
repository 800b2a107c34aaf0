"""The effect that the likelihood of the whole record shows, where no trajectory does.

A trajectory lets go where the record shows the stem let go, or else where the force has reached its
level. Behind noise, coarse steps or an archive few breakaways are seen, each of the others comes
early or late by chance, and what an effect changes is lost in that. The likelihood knows of that
chance (``breakaway_filter``). Here it compares S, J and the reading with the same and one more
term, both at their most likely parameters.

What looks like physics may be a search that has ended too soon. So either of the two is begun from
where the other has ended, until neither gains. Play has an S and J of its own for each size, by
which the reading comes to rest in the same places, and without it others do so as well: either is
begun from several of these.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from stemwatch.models.mismatch.acceptance_limits import RARELY_ACTS
from stemwatch.models.mismatch.fit.base_coordinate import RATIO, S_PERCENT, S_and_J
from stemwatch.models.mismatch.fit.batched_search import conclude
from stemwatch.models.mismatch.fit.crossfit import Fitted, gain, on_both, scored, widened
from stemwatch.models.mismatch.fit.evaluator import CoordinateLayout, Evaluator, TermSet
from stemwatch.models.mismatch.fit.starting_points import (
    PARTS_OF_PLAY,
    beginnings,
    play_beginnings,
)
from stemwatch.models.mismatch.likelihood.maximum_likelihood import (
    LEAST_GAIN,
    LEAST_PRODUCT,
    LEAST_T,
    OF_STEMS,
    RELEASED,
    SCATTERS,
    Likeliest,
    LikelihoodEvidence,
    RecordLikelihood,
)
from stemwatch.models.mismatch.search.breakaway_levels import DWELL, PLAY
from stemwatch.models.mismatch.search.other_coordinates import carried_over
from stemwatch.models.mismatch.search.reading_errors import STICKS_AGAIN
from stemwatch.models.mismatch.search.term_selection import (
    MOST_TERMS,
    Named,
    Needed,
    SelectionStage,
    TermScore,
)
from stemwatch.models.mismatch.term import Term
from stemwatch.models.recording import Floats
from stemwatch.models.stickslip.parameters import Bounds

# Of 192 valves with nothing hidden (`draw_nulls`, seeds 4063 and 4064) play reaches 19 and a t of
# 3.3, and once 730 with a t of 1.0; of 96 of them other terms 23 and 2.0, but for dwell, which five
# show clearly: a stem that goes on after it has stood still for a moment lets go as if it needed
# time to stick. Dwell is left to the breakaways.
BESIDE = 1.5  # least strength beside what trajectories have shown
LEAST_LEVEL, LEAST_LEVEL_IN_NOISE = 0.25, 2.0  # percent; standard deviations of the noise
FEW_COURSES = 4  # of a first look
# Starts of a term, about, beside where its trajectories ended; of them with another S and J than
# before, at least.
STARTS, FROM_OTHERS = 20, 8
# Terms that are climbed from their best start: the most likely, of those that begin no further
# below what S and J alone reach; and how many rounds after the first. Of 120 valves (`draw_hidden`,
# seed 4090) every term that was strong enough in the end was among the first four by its start, and
# began 62 below at most: on the even ones, which chose this, and on the odd ones.
AHEAD, MOST_BELOW, MORE_ROUNDS = 6, 100.0, 2
# Times the gain of the first step that a later round may gain: of 475 looks on 84 valves
# (`draw_cases`, seed 4090, `draw_nulls`, 4064, `draw_unknown`, 4063, development) 256 are left
# there, none of the 96 that become worth a search; at twice the gain one of these would be.
QUICKER = 3.0
WORTH, MOST = 8.0, 4  # least gain at the first look, and how many terms are looked at again
EXCHANGES = 2
# Of what a first look at play found, where it is searched on.
TIMES_PLAY, TIMES_J = (0.7, 0.85, 1.0, 1.2, 1.4), (0.7, 0.85, 1.0, 1.2, 1.5)
BEATEN = 30.0  # a term that is so much less likely than one that passes is not searched on
# Share of the limit of the scatter that is at the limit, and least t there. Of valves with physics
# outside the catalogue four were named at the limit, with t up to 3.9; of those with an effect that
# trajectories miss four, with 5.6 and more (seeds 4063 and 2108).
WIDEST, ALL_OVER = 0.95, 5.0
# Where a smaller scatter is looked for: shares of the breakaway level, and J/S.
LEVELS_OF_LESS_SCATTER, RATIOS_OF_LESS_SCATTER = (0.85, 1.0, 1.15, 1.3, 1.5), (0.05, 0.2, 0.4, 0.7)
LOOKS_OF_LESS_SCATTER, CLIMBED_OF_LESS_SCATTER = 6, 2
MORE_THAN_NOISE = 1.5
# Share of the level by which breakaways may scatter where friction is not one number: five times
# what simulated stems do at most, four times the limit of the searches.
OF_NO_STEM = 0.6
CONTRADICTED = -1.0  # t of the trajectories, below which they speak against a term
# Difference of two terms, and its t over the blocks, below which neither is more likely.
AS_LIKELY, AS_GOOD = 4.0, 1.5
HELD_WITHIN, LEAST_WITHIN = 2.0, 0.02  # standard errors; share of S, of J/S and of a size


@dataclass(frozen=True)
class Compared:
    """The record without and with a term, each at its most likely parameters; breakaways scatter by
    ``widest`` at most."""

    term: Term
    simple: Likeliest
    rich: Likeliest
    widest: float = SCATTERS[1]

    @property
    def evidence(self) -> LikelihoodEvidence:
        """How much more likely the record is with the term."""
        rarely = RARELY_ACTS.get(self.term.slug, 1.0)
        return evidence_of(self.rich, self.simple, rarely)


def evidence_of(rich: Likeliest, simple: Likeliest, rarely: float = 1.0) -> LikelihoodEvidence:
    """How much more likely the record is by ``rich`` than by ``simple``: at the limits, of which
    that of t is ``rarely`` times as high, the strength is 1.
    """
    gained, t = _more_likely(rich, simple)
    strength = min(
        gained / LEAST_GAIN, t / (LEAST_T * rarely), gained * t / (LEAST_PRODUCT * rarely)
    )
    return LikelihoodEvidence(gained, t, strength)


def _more_likely(one: Likeliest, other: Likeliest) -> tuple[float, float]:
    """By how much one is more likely than another, as a logarithm, and its t over the blocks."""
    by_block = one.by_block - other.by_block
    enough = by_block.size > 2
    error = float(by_block.std(ddof=1) * np.sqrt(by_block.size)) if enough else np.inf
    total = float(by_block.sum())
    return total, total / max(error, 1e-9)


def named_by_likelihood(named: Named, terms: Sequence[Term]) -> Named:
    """``named`` with one more of ``terms``, if the likelihood shows it; else as it was."""
    likelihood = RecordLikelihood(named.evaluator)
    tried = [_released(likelihood, one) for one in _tried(likelihood, named, terms)]
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
    dispensable, left = _dispensable(likelihood, named, best)
    if dispensable:
        lacking = _lacking(named, dispensable, left)
        return named_with(likelihood, lacking, [replace(best, rich=left)], best.evidence)
    members = [best, *(one for one in others if _as_likely(best, one))]
    return named_with(likelihood, named, members, best.evidence)


def shown_by_likelihood(named: Named) -> bool:
    """Whether the likelihood has shown any of what is named."""
    return any(needed.likelihood is not None for needed in named.needed)


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


def likelihood_with(named: Named, score: TermScore) -> Compared | None:
    """``named`` without and with one more term, begun from the fit of its ``score``; ``None`` where
    the scatter of the breakaways hides nothing.
    """
    likelihood, simple = RecordLikelihood(named.evaluator), named.fitted
    if not scatter_matters(named.evaluator, simple):
        return None
    alone = likeliest_of(likelihood, simple)
    points = [
        point
        for of_record in (likelihood.first_of_record, alone.of_record)
        for point in points_at(score.fitted, of_record)
    ]
    look = likelihood.ranked(score.fitted.layout, points)[0]
    return _compared(likelihood, alone, look, score.term)


def strongest_by_likelihood(named: Named, terms: Sequence[Term]) -> float:
    """The strength of the strongest term by the likelihood whose size is material, 0 without one,
    before anything is named by it: what chance reaches on a record with nothing hidden.
    """
    tried = _tried(RecordLikelihood(named.evaluator), named, terms)
    material = [one for one in tried if _is_material(one, named.evaluator)]
    return max((one.evidence.strength for one in material), default=0.0)


def _tried(likelihood: RecordLikelihood, named: Named, terms: Sequence[Term]) -> list[Compared]:
    """The terms by which the record may be more likely, each compared with the record without."""
    evaluator, simple = named.evaluator, named.fitted
    if shown_by_likelihood(named):
        # Held near to their most likely, its coordinates could not move as those of a richer one.
        simple = replace(simple, layout=evaluator.layout(simple.layout.hypothesis))
    sticks_again = named.sticks_again is not None
    sticks_again = sticks_again or any(one.term.slug in STICKS_AGAIN for one in named.needed)
    if sticks_again or len(named.needed) >= MOST_TERMS or not scatter_matters(evaluator, simple):
        # Of a stem that sticks again after short slips, any term takes up what is misfitted.
        return []
    terms = [term for term in terms if term.slug not in (*simple.slugs, DWELL)]
    quick, points = (
        RecordLikelihood(evaluator, FEW_COURSES),
        points_at(simple, likelihood.first_of_record),
    )
    first = less_scattered(quick, quick.maximised(simple.layout, points))
    looks = _worth_a_search(quick, first, named, terms)
    if not looks:
        return []
    alone = likelihood.maximised(simple.layout, [first.point, *points])
    compared = _all_compared(likelihood, alone, looks, named, terms)
    nearer = max((alone, *(one.simple for one in compared)), key=lambda one: one.total)
    if nearer.total - alone.total >= LEAST_GAIN:
        # S and J alone had ended far from their best, and with them the first looks.
        looks = _worth_a_search(quick, nearer, named, terms)
        compared = _all_compared(likelihood, nearer, looks, named, terms)
        nearer = max((nearer, *(one.simple for one in compared)), key=lambda one: one.total)
    return [replace(one, simple=nearer) for one in compared]


def _all_compared(
    likelihood: RecordLikelihood,
    alone: Likeliest,
    looks: Sequence[Likeliest],
    named: Named,
    terms: Sequence[Term],
) -> list[Compared]:
    """The terms that were worth more than a first look, each with the best it reaches, and those
    that are like the most likely one begun from that as well.
    """
    by_slug = {term.slug: term for term in terms}
    compared = list[Compared]()
    for look in looks:
        passing = (one.rich.total for one in compared if one.evidence.strength >= 1.0)
        beaten = max(passing, default=-np.inf) - BEATEN
        term = by_slug[_added(look, named.fitted)]
        compared.append(_compared(likelihood, alone, look, term, beaten))
    best = max(compared, key=lambda one: one.rich.total, default=None)
    if best is None or best.evidence.strength < 1.0:
        return compared
    return [one if one is best else _from_rival(likelihood, one, best) for one in compared]


def _from_rival(likelihood: RecordLikelihood, one: Compared, rival: Compared) -> Compared:
    """A term searched again from S, J and the reading of a more likely one; where one is a special
    case of the other, from each of its sizes too.
    """
    layout, slug = one.rich.layout, one.term.slug
    row = carried_over(on_both(rival.rich.layout, rival.rich.candidate), layout)[0]
    row[layout.places[slug]] = one.rich.candidate[layout.places[slug]]
    rows = [row]
    if slug in rival.term.contains or rival.term.slug in one.term.contains:
        for size in rival.rich.candidate[rival.rich.layout.places[rival.term.slug]]:
            rows.append(row.copy())
            rows[-1][layout.places[slug]] = size
    points = [np.append(row, rival.rich.of_record) for row in rows]
    again = likelihood.maximised(layout, points)
    return replace(one, rich=max(one.rich, again, key=lambda at: at.total))


def scatter_matters(evaluator: Evaluator, fitted: Fitted) -> bool:
    """Whether breakaways reach so far beyond the noise that their scatter hides anything; of a stem
    that hardly sticks trajectories show all there is.
    """
    S, ratio = fitted.candidates.mean(axis=0)[[S_PERCENT, RATIO]]
    level = 0.5 * float(S * (1.0 + ratio))
    return level >= max(LEAST_LEVEL, LEAST_LEVEL_IN_NOISE * evaluator.problem.sigma)


def points_at(fitted: Fitted, of_record: Floats) -> list[Floats]:
    """Points (size + 2,) at the fits to both folds and between them."""
    rows = np.vstack((fitted.candidates, fitted.candidates.mean(axis=0)))
    return [np.append(row, of_record) for row in rows]


def likeliest_of(likelihood: RecordLikelihood, fitted: Fitted) -> Likeliest:
    """Where the record is most likely by the hypothesis that is ``fitted``, begun from its fits."""
    return likelihood.maximised(fitted.layout, points_at(fitted, likelihood.first_of_record))


def _added(look: Likeliest, simple: Fitted) -> str:
    """The slug of the term that a look has on top of ``simple``."""
    return next(slug for slug in look.layout.places if slug not in simple.layout.places)


def _worth_a_search(
    likelihood: RecordLikelihood, alone: Likeliest, named: Named, terms: Sequence[Term]
) -> list[Likeliest]:
    """The terms by which the record may be more likely, the most likely first: some steps from the
    best start of each of those that are ahead by it.
    """
    nothing = likelihood.at(alone.layout, alone.point).total
    begun = [_best_start(likelihood, alone, named, term) for term in terms]
    hopeful = (one for one in begun if one.total >= nothing - MOST_BELOW)
    ahead = sorted(hopeful, key=lambda one: -one.total)[:AHEAD]
    stepped = [likelihood.climbed(one, 1) for one in ahead]
    # Begun anew, for the first step may have been a short one.
    looks = sorted(
        (
            likelihood.climbed(one, MORE_ROUNDS)
            for one, begun_at in zip(stepped, ahead, strict=True)
            if _may_be_worth(one.total - nothing, one.total - begun_at.total)
        ),
        key=lambda one: -one.total,
    )
    return [look for look in looks[:MOST] if look.total - nothing >= WORTH]


def _may_be_worth(reached: float, gained: float) -> bool:
    """Whether a term that has ``reached`` so much over S and J alone, and ``gained`` this in its
    first step, may become worth a search in the rounds that follow."""
    return reached + MORE_ROUNDS * QUICKER * gained >= WORTH


def _best_start(
    likelihood: RecordLikelihood, alone: Likeliest, named: Named, term: Term
) -> Likeliest:
    """The most likely start of one more term: of its search, or from where that ended."""
    evaluator, simple = likelihood.evaluator, on_both(alone.layout, alone.candidate)
    rich = named.fitted.layout.hypothesis.plus(term)
    layout = evaluator.layout(rich)
    S, J = S_and_J(alone.candidate)
    begun_from = play_beginnings(S, J) if term.slug == PLAY else beginnings(term, S, J)
    rows = widened(evaluator, rich, simple, term, begun_from)
    # Where trajectories ended comes first: starts that fall far behind are soon given up.
    rows = _spread(rows, term.starts(evaluator.summary).shape[0])
    for stage in named.stages:
        for score in stage.scores:
            if score.fitted.layout.hypothesis.slugs == rich.slugs:
                rows = np.vstack((score.fitted.candidates, rows))
    # With the right term noise and scatter are less, and a search that begins with those of S and J
    # alone ends where they stand for it.
    begun = likelihood.ranked(layout, [np.append(row, likelihood.first_of_record) for row in rows])
    again = likelihood.at(layout, np.append(begun[0].candidate, alone.of_record))
    return max(begun[0], again, key=lambda one: one.total)


def _spread(rows: Floats, sizes: int) -> Floats:
    """Of rows (m, size), which hold the ``sizes`` of a term one after the other for each S and J to
    begin with: all of the first, and of the others as many as are worth it, of each other sizes.
    """
    others = rows[sizes:]
    number = np.arange(others.shape[0])
    every = max(-(-others.shape[0] // max(STARTS - sizes, FROM_OTHERS)), 1)
    return np.vstack((rows[:sizes], others[(number + number // sizes) % every == 0]))


def _compared(
    likelihood: RecordLikelihood,
    alone: Likeliest,
    look: Likeliest,
    term: Term,
    beaten: float = -np.inf,
) -> Compared:
    """Without and with a term, each begun from where the other has ended, until neither gains;
    where the term is less likely than ``beaten``, which another reaches, as it is.
    """
    simple, rich = alone, likelihood.maximised(look.layout, _about(look, term))
    hopeful = rich.total - alone.total >= LEAST_GAIN and not _too_noisy(likelihood.evaluator, rich)
    if hopeful:
        rich = less_scattered(likelihood, rich)
    for _ in range(EXCHANGES):
        if rich.total < max(simple.total + LEAST_GAIN, beaten):
            break
        before = simple.total, rich.total
        again = likelihood.maximised(simple.layout, _lacking_term(likelihood, rich, simple, term))
        simple = max(simple, again, key=lambda one: one.total)
        nothing = carried_over(on_both(simple.layout, simple.candidate), rich.layout)[0]
        same_size = nothing.copy()
        places = rich.layout.places[term.slug]
        same_size[places] = rich.candidate[places]
        rows = nothing, same_size
        points = [np.append(row, one.of_record) for row in rows for one in (simple, rich)]
        again = likelihood.maximised(rich.layout, points)
        rich = max(rich, again, key=lambda one: one.total)
        if (simple.total, rich.total) == before:
            break
    return Compared(term, simple, rich)


def _about(look: Likeliest, term: Term) -> list[Floats]:
    """Points (size + 2,) from which a term is searched on from a first ``look`` at it: that, and of
    play others by which the reading comes to rest in the same places. Between these lie ridges that
    no climb crosses.
    """
    points = [look.point]
    if term.slug != PLAY:
        return points
    S, J = S_and_J(look.candidate)
    place = look.layout.places[PLAY].start
    band = S - J + look.candidate[place]
    for of_play, of_J in product(TIMES_PLAY, TIMES_J):
        row = look.point.copy()
        row[place] *= of_play
        row[S_PERCENT] = band + of_J * J - row[place]
        row[RATIO] = of_J * J / max(row[S_PERCENT], LEAST_LEVEL)
        points.append(row)
    return points


def _lacking_term(
    likelihood: RecordLikelihood, rich: Likeliest, simple: Likeliest, term: Term
) -> list[Floats]:
    """Points (size + 2,) of the ``simple`` hypothesis from which the record without a ``term`` is
    searched again: those of the ``rich`` one; without play with S and J that let the reading come
    to rest where it did, and with breakaways that scatter little too.
    """
    less = carried_over(on_both(rich.layout, rich.candidate), simple.layout)[0]
    if term.slug != PLAY:
        return [np.append(less, rich.of_record)]
    S, J = S_and_J(rich.candidate)
    play = float(rich.candidate[rich.layout.places[PLAY]][0])
    rows = []
    for part in PARTS_OF_PLAY:
        row = less.copy()
        row[S_PERCENT] = S + part * play
        row[RATIO] = max(J + (part - 1.0) * play, 0.0) / row[S_PERCENT]
        rows.append(row)
    scales = rich.of_record, likelihood.first_of_record
    return [np.append(row, of_record) for row in rows for of_record in scales]


def less_scattered(likelihood: RecordLikelihood, at: Likeliest) -> Likeliest:
    """A point that leaves something in scatter or noise, or a better one that is found from small
    scatters, other levels and other J: these also stand for what S and J are wrong by.
    """
    if not leaves_something(at, likelihood.evaluator):
        return at
    layout, quick = at.layout, replace(likelihood, courses=FEW_COURSES)
    S, J = S_and_J(at.candidate)
    points = []
    for level, ratio in product(LEVELS_OF_LESS_SCATTER, RATIOS_OF_LESS_SCATTER):
        row = at.candidate.copy()
        row[S_PERCENT], row[RATIO] = level * (S + J) / (1.0 + ratio), ratio
        points.append(np.concatenate((row, at.of_record[:1], likelihood.first_of_record[1:])))
    begun = quick.ranked(layout, points)[:LOOKS_OF_LESS_SCATTER]
    begun = sorted((quick.climbed(one, MORE_ROUNDS) for one in begun), key=lambda one: -one.total)
    points = [one.point for one in begun[:CLIMBED_OF_LESS_SCATTER]]
    return max(at, likelihood.maximised(layout, points), key=lambda at: at.total)


def _released(likelihood: RecordLikelihood, one: Compared) -> Compared:
    """A term whose scatter is at the limit of the searches, if that is all that speaks against it:
    with the scatter of a real stem, if it is strong enough with that; else without and with it at a
    wider limit, for the breakaways of one record may scatter more than those of the stem.
    """
    at_limit = scatters_most(one.rich) and not _too_noisy(likelihood.evaluator, one.rich)
    strong = one.evidence.strength >= 1.0 and one.evidence.t < ALL_OVER
    if not (at_limit and strong and _is_material(one, likelihood.evaluator)):
        return one
    narrow = replace(one, rich=replace(likelihood, widest=OF_STEMS).again(one.rich))
    if narrow.evidence.strength >= 1.0:
        return narrow
    return Compared(one.term, *released(likelihood, one.simple, one.rich), RELEASED)


def released(
    likelihood: RecordLikelihood, simple: Likeliest, rich: Likeliest
) -> tuple[Likeliest, Likeliest]:
    """Two points searched again at a wider limit of the scatter."""
    wide = replace(likelihood, widest=RELEASED)
    return wide.again(simple), wide.again(rich)


def _passes(one: Compared, evaluator: Evaluator) -> bool:
    """Whether a term is more likely than on records with nothing hidden, and material."""
    if leaves_something(one.rich, evaluator, one.widest) and one.evidence.t < ALL_OVER:
        return False
    return one.evidence.strength >= 1.0 and _is_material(one, evaluator)


def _too_noisy(evaluator: Evaluator, at: Likeliest) -> bool:
    """Whether the readings lie about the stem by more than their noise."""
    return at.noise > MORE_THAN_NOISE * evaluator.problem.sigma


def leaves_something(at: Likeliest, evaluator: Evaluator, widest: float = SCATTERS[1]) -> bool:
    """Whether the breakaways scatter more than those of real stems, or the readings more than their
    noise. Something else is hidden then, for which a term may stand, and samples are not
    independent: it must be more likely all over the record.
    """
    return scatters_most(at, widest) or _too_noisy(evaluator, at)


def scatters_most(at: Likeliest, widest: float = SCATTERS[1]) -> bool:
    """Whether the scatter is at its limit, which is ``widest``."""
    return at.scatter > WIDEST * widest


def scatters_as_no_stem(likelihood: RecordLikelihood, at: Likeliest) -> bool:
    """Whether a scatter beyond that of any stem makes the record more likely than ``at`` by as much
    as a term that is named does. Friction that comes and goes, or a force from outside, is left
    then, whatever else is there; a smaller scatter elsewhere must not do as well.
    """
    if at.scatter <= WIDEST * OF_STEMS:
        return False
    wide = replace(likelihood, widest=OF_NO_STEM).again(at)
    return wide.scatter > at.scatter and evidence_of(wide, at).strength >= 1.0


def _is_material(one: Compared, evaluator: Evaluator) -> bool:
    values = one.rich.candidate[one.rich.layout.places[one.term.slug]]
    return one.term.material(values, evaluator.summary)


def _as_likely(best: Compared, other: Compared) -> bool:
    """Whether the record does not tell two terms apart."""
    more, t = _more_likely(best.rich, other.rich)
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


def named_with(
    likelihood: RecordLikelihood,
    named: Named,
    members: Sequence[Compared],
    evidence: LikelihoodEvidence,
) -> Named:
    """``named`` with one more term for which there is ``evidence``, unless trajectories contradict
    it; ``members`` are those that the record does not tell apart.
    """
    evaluator, best = named.evaluator, members[0]
    places = best.rich.layout.places[best.term.slug]
    layout = held(likelihood, best.rich, (S_PERCENT, RATIO, *range(places.start, places.stop)))
    fitted = scored_at(evaluator, layout, best.rich.candidate)
    scores = []
    for one in members:
        of_term = (
            fitted if one is best else scored_at(evaluator, one.rich.layout, one.rich.candidate)
        )
        scores.append(TermScore(one.term, of_term, gain(evaluator, named.fitted, of_term)))
    against = scores[0].advantage.t < CONTRADICTED
    if against and len(named.needed) <= 1:
        # They are scored at the most likely parameters without the term as well: those that were
        # fitted to them are nearer anyhow. Beside two effects, a third one was wrong then.
        simple = scored_at(evaluator, best.simple.layout, best.simple.candidate)
        against = gain(evaluator, simple, fitted).t < CONTRADICTED
    if against and evidence.t < ALL_OVER:
        return named
    stage = SelectionStage(named.fitted, tuple(scores), tuple(scores))
    needed = Needed(stage, named.fitted, scores[0].advantage, likelihood=evidence)
    return replace(named, fitted=fitted, needed=(*named.needed, needed))


def scored_at(evaluator: Evaluator, layout: CoordinateLayout, candidate: Floats) -> Fitted:
    """A candidate as the fit to both folds, with its losses."""
    return conclude(evaluator, scored(layout, on_both(layout, candidate).candidates))


def held(
    likelihood: RecordLikelihood, at: Likeliest, coordinates: Sequence[int]
) -> CoordinateLayout:
    """The layout of a point with some coordinates, such as S, J and the size of a term, held near
    to it: trajectories would trade them for each other.
    """
    layout, low, high = at.layout, at.layout.bounds.low.copy(), at.layout.bounds.high.copy()
    errors = likelihood.standard_errors(at)
    for place in coordinates:
        value = at.candidate[place]
        within = max(HELD_WITHIN * errors[place], LEAST_WITHIN * abs(value))
        low[place] = max(low[place], value - within)
        high[place] = min(high[place], value + within)
    return replace(layout, bounds=Bounds(low, high))
