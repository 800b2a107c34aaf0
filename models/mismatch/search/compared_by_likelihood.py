"""A record without and with each of the terms, both at their most likely parameters.

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
from stemwatch.models.mismatch.fit.crossfit import Fitted, on_both, widened
from stemwatch.models.mismatch.fit.starting_points import PARTS_OF_PLAY, beginnings, play_beginnings
from stemwatch.models.mismatch.likelihood.likelihood_evidence import (
    LEAST_GAIN,
    LikelihoodEvidence,
    evidence_of,
)
from stemwatch.models.mismatch.likelihood.maximum_likelihood import (
    FEW_COURSES,
    MORE_ROUNDS,
    SCATTERS,
    Likeliest,
    RecordLikelihood,
    likeliest_of,
    points_at,
)
from stemwatch.models.mismatch.search.breakaway_levels import DWELL, PLAY
from stemwatch.models.mismatch.search.breakaway_scatter import (
    LEAST_LEVEL,
    less_scattered,
    scatter_matters,
    too_noisy,
)
from stemwatch.models.mismatch.search.named_terms import Named, TermScore, shown_by_likelihood
from stemwatch.models.mismatch.search.other_coordinates import carried_over
from stemwatch.models.mismatch.search.reading_errors import STICKS_AGAIN
from stemwatch.models.mismatch.search.term_selection import MOST_TERMS
from stemwatch.models.mismatch.term import Term
from stemwatch.models.recording import Floats

# Starts of a term, about, beside where its trajectories ended; of them with another S and J than
# before, at least.
STARTS, FROM_OTHERS = 20, 8
# Terms that are climbed from their best start: the most likely, of those that begin no further
# below what S and J alone reach. Of 120 valves (`draw_hidden`, seed 4090) every term that was
# strong enough in the end was among the first four by its start, and began 62 below at most: on the
# even ones, which chose this, and on the odd ones.
AHEAD, MOST_BELOW = 6, 100.0
# Times the gain of the first step that a later round may gain: of 475 looks on 84 valves
# (`draw_cases`, seed 4090, `draw_nulls`, 4064, `draw_unknown`, 4063, development) 256 are left
# there, none of the 96 that become worth a search; at twice the gain one of these would be.
QUICKER = 3.0
WORTH, MOST = 8.0, 4  # least gain at the first look, and how many terms are looked at again
EXCHANGES = 2  # times that either is begun from where the other has ended
# Of what a first look at play found, where it is searched on.
TIMES_PLAY, TIMES_J = (0.7, 0.85, 1.0, 1.2, 1.4), (0.7, 0.85, 1.0, 1.2, 1.5)
BEATEN = 30.0  # a term that is so much less likely than one that passes is not searched on


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


def tried_by_likelihood(
    likelihood: RecordLikelihood, named: Named, terms: Sequence[Term]
) -> list[Compared]:
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
    quick = RecordLikelihood(evaluator, FEW_COURSES)
    points = points_at(simple, likelihood.first_of_record)
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
    hopeful = rich.total - alone.total >= LEAST_GAIN and not too_noisy(likelihood.evaluator, rich)
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


def _added(look: Likeliest, simple: Fitted) -> str:
    """The slug of the term that a look has on top of ``simple``."""
    return next(slug for slug in look.layout.places if slug not in simple.layout.places)
