"""Which terms explain what the base leaves: a first screening, a refined search, checks against
false discoveries, and no more terms than needed.

A term enters a hypothesis where it improves the prediction of blocks of time that it was not fitted
to by more than recordings with nothing hidden show (``acceptance_limits``), and where its size is
material. The simpler of two equally good terms is taken. Then the next one is looked for on top of
it, three at most.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stemwatch.models.mismatch.acceptance_limits import (
    convincing,
    not_little_left,
    something_left,
)
from stemwatch.models.mismatch.fit.base_coordinate import S_and_J
from stemwatch.models.mismatch.fit.base_fit import AGAIN, BaseFit, sticking_again
from stemwatch.models.mismatch.fit.batched_search import Search, conclude, run_together
from stemwatch.models.mismatch.fit.crossfit import (
    CAREFUL,
    GLANCE,
    LOOK,
    POLISH,
    FitEffort,
    Fitted,
    better,
    from_best,
    gain,
    own_losses,
    ranked,
    refit,
    scored,
    widened,
)
from stemwatch.models.mismatch.fit.evaluator import Evaluator, TermSet
from stemwatch.models.mismatch.fit.starting_points import beginnings
from stemwatch.models.mismatch.likelihood.maximum_likelihood import LikelihoodEvidence
from stemwatch.models.mismatch.search.breakaway_levels import (
    LEAST_T,
    PLAY,
    BreakawayEvidence,
    breakaway_evidence,
    refit_with_size,
)
from stemwatch.models.mismatch.search.other_coordinates import (
    best_together,
    carried_over,
    in_bounds_of,
    without,
)
from stemwatch.models.mismatch.term import Term
from stemwatch.models.recording import Floats
from stemwatch.models.stickslip.fit import Advantage

MOST_TERMS = 3
LEAST_JUMP_SHARE, LEAST_JUMP_PERCENT = 0.15, 0.3  # of S and play; of travel; less is not visible
REFINED = 3  # candidates of a stage that are searched with care
PROMISING = 0.02  # mean advantage at the first look; less has never become a finding
AS_GOOD = 1.5  # paired t below which two explanations cannot be separated
ATTEMPTS = 2  # looks at the terms of a stage, each on a base that was restarted from the last
# Terms that are looked at again where the base has moved, the best of the look before.
LOOKED_AT_AGAIN = 7
MOVED = 0.03  # mean advantage of a restarted base over itself from which all is done again
NEARLY = 0.03  # mean advantage that a richer term must have over a simpler one that it contains
PUT_BESIDE = 5  # terms that are put beside a hypothesis as they were fitted alone


@dataclass(frozen=True)
class TermScore:
    """One more term on top of what was accepted before.

    ``further`` (2, size) are the best starts for each fold that the first look did not begin from.
    """

    term: Term
    fitted: Fitted
    advantage: Advantage
    further: tuple[Floats, ...] = ()

    @property
    def slug(self) -> str:
        """The slug of the term."""
        return self.term.slug

    @property
    def values(self) -> Floats:
        """(k,) the term's coordinates, the mean of both folds."""
        return np.asarray(self.fitted.values(self.slug).mean(axis=0))


@dataclass(frozen=True)
class SelectionStage:
    """One round: what stood before, the scores of all terms on top of it, best first, and those
    accepted as explaining it, the chosen one first; ``promising`` where it was taken for the sake
    of a second term alone."""

    before: Fitted
    scores: tuple[TermScore, ...]
    accepted: tuple[TermScore, ...]
    promising: bool = False


@dataclass(frozen=True)
class Needed:
    """A term of the final hypothesis: the stage that brought it, the best fit that lacks it, and
    how much better unseen blocks are predicted with it."""

    stage: SelectionStage
    without: Fitted
    advantage: Advantage
    events: BreakawayEvidence | None = None  # that showed it, where the trajectories did not
    of_pair: bool = False  # was found together with another, without which it gains little
    likelihood: LikelihoodEvidence | None = None  # that showed it, where trajectories did not

    @property
    def term(self) -> Term:
        """The term that was chosen in its stage."""
        return self.stage.accepted[0].term

    @property
    def members(self) -> tuple[str, ...]:
        """Slugs of the terms that explain it as well, its own first."""
        return tuple(score.slug for score in self.stage.accepted)


@dataclass(frozen=True)
class Named:
    """The hypothesis that was reached, what it needs, and the stages on the way to it;
    ``sticks_again`` is what the likelihood shows of a stem that sticks again after its slips."""

    evaluator: Evaluator
    base: Fitted
    fitted: Fitted
    needed: tuple[Needed, ...]
    stages: tuple[SelectionStage, ...]
    sticks_again: LikelihoodEvidence | None = None


def screened(
    evaluator: Evaluator, simple: Fitted, terms: Iterable[Term], effort: FitEffort = LOOK
) -> Search[list[TermScore]]:
    """Every term on top of ``simple``, best first."""
    scores = yield from run_together(_looked_at(evaluator, simple, term, effort) for term in terms)
    return _ordered(scores)


def _looked_at(
    evaluator: Evaluator, simple: Fitted, term: Term, effort: FitEffort
) -> Search[TermScore]:
    """A first look at one term on top of ``simple``."""
    rich = simple.layout.hypothesis.plus(term)
    losses_of_simple = own_losses(evaluator, simple)
    starts, layout = _starts(evaluator, simple, term, rich), evaluator.layout(rich)
    begun = yield from ranked(evaluator, layout, starts, effort.keep + CAREFUL.keep - 1)
    fitted = yield from from_best(evaluator, layout, begun, effort, losses_of_simple)
    neutral_fit = yield from neutral(evaluator, simple, rich)
    fitted = better(evaluator, neutral_fit, fitted)
    further = tuple(
        np.vstack((even.candidate, odd.candidate))
        for even, odd in zip(*(best[effort.keep :] for best in begun), strict=True)
    )
    return TermScore(term, fitted, gain(evaluator, simple, fitted), further)


def _starts(evaluator: Evaluator, simple: Fitted, term: Term, rich: TermSet) -> Floats:
    """(m, size) where the search for one more term begins."""
    S, J = S_and_J(simple.candidates.mean(axis=0))
    return widened(evaluator, rich, simple, term, beginnings(term, S, J))


def _ordered(scores: Iterable[TermScore]) -> list[TermScore]:
    return sorted(scores, key=lambda score: -score.advantage.mean)


def neutral(evaluator: Evaluator, simple: Fitted, rich: TermSet) -> Search[Fitted]:
    """``simple`` written in the coordinates of ``rich``, its new terms neutral."""
    layout = evaluator.layout(rich)
    fitted = yield from scored(layout, carried_over(simple, layout))
    return fitted


def reduced(evaluator: Evaluator, rich: Fitted, simple: TermSet) -> Floats:
    """(2, size) the candidates of ``rich`` in the coordinates of ``simple``."""
    return carried_over(rich, evaluator.layout(simple))


def refined(
    evaluator: Evaluator, simple: Fitted, terms: Sequence[Term], effort: FitEffort = LOOK
) -> Search[tuple[Fitted, list[TermScore]]]:
    """All ``terms`` on top of ``simple``, the best of them searched with care, and ``simple``
    restarted from each of these.

    A local minimum of the simple hypothesis is the commonest cause of a false discovery: where a
    restart finds a better one, the whole stage is repeated from there.
    """
    to_look_at, scores = list(terms), list[TermScore]()
    for _ in range(ATTEMPTS):
        first_looks = yield from screened(evaluator, simple, to_look_at, effort)
        first_looks += scores[LOOKED_AT_AGAIN:]
        promising = [score for score in first_looks[:REFINED] if score.advantage.mean >= PROMISING]
        careful = yield from run_together(_careful(evaluator, score) for score in promising)
        scores = [*careful, *first_looks[len(promising) :]]
        restarted = yield from _restarted(evaluator, simple, scores[:REFINED])
        moved = gain(evaluator, simple, restarted).mean
        simple = restarted
        if moved < MOVED:
            break
        to_look_at = [score.term for score in scores[:LOOKED_AT_AGAIN]]
    nested = yield from run_together(_nested(evaluator, simple, score) for score in scores)
    return simple, _ordered(nested)


def _careful(evaluator: Evaluator, score: TermScore) -> Search[TermScore]:
    """A score refined by a longer search: from the result of the first look, and from the starts
    that it did not use.
    """
    fitted = yield from refit(evaluator, score.fitted, CAREFUL, *score.further)
    return TermScore(score.term, fitted, score.advantage)


def _restarted(evaluator: Evaluator, simple: Fitted, scores: Sequence[TermScore]) -> Search[Fitted]:
    """``simple`` searched again from the results of richer hypotheses."""
    if not scores:
        return simple
    restarts = [start for score in scores for start in without(score.fitted, simple.layout)]
    fitted = yield from refit(evaluator, simple, CAREFUL, *restarts)
    fitted = yield from refit(evaluator, fitted, POLISH)
    return fitted


def _nested(evaluator: Evaluator, simple: Fitted, score: TermScore) -> Search[TermScore]:
    """A score against the refined ``simple``, which the richer hypothesis contains."""
    neutral_fit = yield from neutral(evaluator, simple, score.fitted.layout.hypothesis)
    fitted = better(evaluator, neutral_fit, score.fitted)
    return TermScore(score.term, fitted, gain(evaluator, simple, fitted))


def passes(score: TermScore, evaluator: Evaluator, stage: int, beside: bool = False) -> bool:
    """True where the gain is larger than recordings with nothing hidden show, and the size is
    material; ``beside`` as of ``convincing``.
    """
    counts = evaluator.measured_counts
    is_convincing = convincing(score.advantage, counts, score.slug, stage, beside)
    return (
        is_convincing
        and (score.slug != PLAY or jump_is_visible(score.fitted, evaluator))
        and score.term.material(score.values, evaluator.summary)
    )


def jump_is_visible(fitted: Fitted, evaluator: Evaluator) -> bool:
    """False for a stem that hardly jumps: then play and friction make one dead band, and cannot be
    separated.
    """
    S, J = S_and_J(fitted.candidates.mean(axis=0))
    dead_band = S + float(fitted.values(PLAY).mean())
    return bool(
        J >= max(LEAST_JUMP_SHARE * dead_band, 4.0 * evaluator.summary.sigma, LEAST_JUMP_PERCENT)
    )


def accepted(
    evaluator: Evaluator, scores: list[TermScore], stage: int, beside: bool = False
) -> list[TermScore]:
    """The terms that explain the recording: first the one to take, then those that are as good."""
    passing = [score for score in scores if passes(score, evaluator, stage, beside)]
    if not passing:
        return []
    best = passing[0]
    for simpler in passing[1:]:
        if simpler.slug in best.term.contains and _nearly(evaluator, simpler, best):
            best = simpler
            break
    rivals = [score for score in passing if score is not best and _as_good(evaluator, score, best)]
    # A second lag on top of a lag is what another delay looks like.
    unrelated = next((score for score in rivals if not _related(score)), None)
    if unrelated is not None and _related(best):
        return [unrelated, *(score for score in (best, *rivals) if score is not unrelated)]
    return [best, *rivals]


def _related(score: TermScore) -> bool:
    """True where the term contains one that stands before it, or is contained in one."""
    terms = [term for term in score.fitted.layout.hypothesis.terms if term.slug != score.slug]
    return any(term.slug in score.term.contains or score.slug in term.contains for term in terms)


def _nearly(evaluator: Evaluator, simple: TermScore, rich: TermScore) -> bool:
    """True where the richer term is not clearly better than the simpler one that it contains."""
    gain_of_both = gain(evaluator, simple.fitted, rich.fitted)
    return gain_of_both.mean < NEARLY or gain_of_both.t < 1.0


def _as_good(evaluator: Evaluator, rival: TermScore, best: TermScore) -> bool:
    return gain(evaluator, rival.fitted, best.fitted).t < AS_GOOD


def name_terms(base: BaseFit, terms: Sequence[Term]) -> Named:
    """Build the hypothesis up from the base with the ``terms`` that the recording can show.

    Where a stem that sticks again fits clearly better than the base, both are built up, for a dead
    time or a lag looks like such a stem at first; the latter is taken where it predicts unseen
    blocks better beyond chance, or with fewer terms.
    """
    named = _named_from(base, terms)
    if base.sticks_again is None:
        return named
    again = _named_from(base.sticks_again, terms)
    nearer = gain(base.evaluator, named.fitted, again.fitted)
    simpler = len(again.needed) < len(named.needed) and nearer.mean > 0.0
    return again if simpler or nearer.t >= AS_GOOD else named


def _named_from(base: BaseFit, terms: Sequence[Term]) -> Named:
    """The hypothesis that is reached from the fit of one base."""
    evaluator, simple = base.evaluator, base.fitted
    terms_left = list(terms)
    stages: list[SelectionStage] = []
    while len(stages) < MOST_TERMS:
        stage = _stage(evaluator, simple, terms_left, stages)
        stages.append(stage)
        simple = stage.before
        if not stage.accepted:
            break
        chosen = stage.accepted[0]
        simple = conclude(evaluator, refit(evaluator, chosen.fitted, POLISH))
        terms_left = [term for term in terms_left if term.slug != chosen.slug]
        if _is_weak_second(evaluator, stages):
            break  # nothing is built on it
    simple = conclude(evaluator, _sticking_again(evaluator, simple))
    fitted, needed = pruned(evaluator, simple, [stage for stage in stages if stage.accepted])
    if len(needed) < 2 and _is_weak_second(evaluator, stages):
        stages[-1] = replace(stages[-1], accepted=())
        fitted, needed = pruned(evaluator, stages[-1].before, stages[:1])
    has_play = any(term_needed.term.slug == PLAY for term_needed in needed)
    if has_play and not jump_is_visible(fitted, evaluator):
        # A later term has taken away the jump that separated play from friction.
        return _named_from(base, [term for term in terms if term.slug != PLAY])
    if not needed:
        fitted, needed = named_by_breakaways(evaluator, fitted, terms)
    return Named(
        evaluator=evaluator,
        base=stages[0].before,
        fitted=fitted,
        needed=tuple(needed),
        stages=tuple(stages),
    )


def _is_weak_second(evaluator: Evaluator, stages: Sequence[SelectionStage]) -> bool:
    """True where the last of ``stages`` brought a second term that is below the limits of one
    beside any other."""
    if not beside_another(stages[:-1]) or not stages[-1].accepted:
        return False
    return not passes(stages[-1].accepted[0], evaluator, len(stages) - 1)


def _sticking_again(evaluator: Evaluator, fitted: Fitted) -> Search[Fitted]:
    """A hypothesis with terms, or the same of a stem that sticks again where that is clearly
    better.

    No descent from a stem that slides finds such a one, and the base did not show it where a term
    has taken the largest part of what was left. It is looked for last, for what lacks a lag or a
    delay looks like it.
    """
    if not fitted.slugs or not something_left(evaluator, fitted):
        return fitted
    variants = sticking_again(fitted.layout, fitted.candidates)
    again = yield from refit(evaluator, fitted, AGAIN, *variants)
    more = gain(evaluator, fitted, again)
    return again if more.mean >= NEARLY and more.t >= AS_GOOD else fitted


def _stage(
    evaluator: Evaluator,
    simple: Fitted,
    terms: Sequence[Term],
    stages: Sequence[SelectionStage],
) -> SelectionStage:
    """The round after ``stages``: one more of ``terms`` on top of ``simple``."""
    number = len(stages)
    effort, beside = GLANCE if stages else LOOK, beside_another(stages)
    before, scores = conclude(evaluator, refined(evaluator, simple, terms, effort))
    explaining = accepted(evaluator, scores, number, beside)
    if stages and not explaining:
        scores = conclude(evaluator, _put_beside(evaluator, before, scores, stages[0].scores))
        explaining = accepted(evaluator, scores, number, beside)
    look_for_two = not explaining and number == 0 and not_little_left(evaluator, before)
    if not look_for_two:
        return SelectionStage(before, tuple(scores), tuple(explaining))
    # Two terms that explain it together may gain nothing one by one; whether both are needed is
    # tested at the end.
    best_guess = [score for score in scores[:1] if score.advantage.mean >= PROMISING]
    return SelectionStage(before, tuple(scores), tuple(best_guess), promising=True)


def beside_another(stages: Sequence[SelectionStage]) -> bool:
    """True where ``stages`` are a single one whose term was accepted for its own sake."""
    return len(stages) == 1 and not stages[0].promising


def _put_beside(
    evaluator: Evaluator,
    simple: Fitted,
    scores: Sequence[TermScore],
    alone: Sequence[TermScore],
) -> Search[list[TermScore]]:
    """The ``scores`` of terms on top of ``simple``, the best of them searched again from where
    ``simple`` and the fits of the terms ``alone`` are put together.

    Searched on top of ``simple``, a term ends where that was, which has taken its part as well.
    """
    known = {score.slug: score for score in scores}
    others = [score for score in alone if score.slug in known and score.advantage.mean >= PROMISING]
    found = yield from run_together(
        _beside(evaluator, simple, score) for score in others[:PUT_BESIDE]
    )
    better_ones = {
        score.slug: score
        for score in found
        if score.advantage.mean > known[score.slug].advantage.mean
    }
    return _ordered((known | better_ones).values())


def _beside(evaluator: Evaluator, simple: Fitted, alone: TermScore) -> Search[TermScore]:
    """A term beside ``simple``, searched from where both are put together."""
    layout = evaluator.layout(simple.layout.hypothesis.plus(alone.term))
    begun = yield from best_together(evaluator, layout, (simple, alone.fitted), LOOK.keep)
    fitted = yield from from_best(evaluator, layout, begun, LOOK, own_losses(evaluator, simple))
    return TermScore(alone.term, fitted, gain(evaluator, simple, fitted))


def named_by_breakaways(
    evaluator: Evaluator, simple: Fitted, terms: Sequence[Term]
) -> tuple[Fitted, list[Needed]]:
    """Dwell or play, where the breakaways together show it although no trajectory needs a term."""
    by_slug = {term.slug: term for term in terms}
    for evidence in breakaway_evidence(evaluator, simple):
        if not evidence.convincing or evidence.slug not in by_slug:
            continue
        needed = with_breakaways(evaluator, simple, by_slug[evidence.slug], evidence)
        if needed.advantage.t >= LEAST_T[evidence.slug]:  # else something else moves the levels
            return needed.stage.accepted[0].fitted, [needed]
    return simple, []


def with_breakaways(
    evaluator: Evaluator, simple: Fitted, term: Term, evidence: BreakawayEvidence
) -> Needed:
    """``simple`` with a term of the size that the breakaways show."""
    neutral_fit = conclude(
        evaluator, neutral(evaluator, simple, simple.layout.hypothesis.plus(term))
    )
    fitted = refit_with_size(evaluator, neutral_fit, evidence)
    score = TermScore(term, fitted, gain(evaluator, simple, fitted))
    stage = SelectionStage(simple, (score,), (score,))
    return Needed(stage, simple, score.advantage, evidence)


def lacking(named: Named, slugs: Collection[str]) -> Named:
    """What was named without some terms, refitted, and what is still needed of the others."""
    stages = [needed.stage for needed in named.needed if needed.term.slug not in slugs]
    if len(stages) == len(named.needed):
        return named
    if not stages:
        return replace(named, fitted=named.base, needed=())
    remaining = TermSet(
        tuple(term for term in named.fitted.layout.hypothesis.terms if term.slug not in slugs)
    )
    evaluator = named.evaluator
    kept = tuple(needed for needed in named.needed if needed.term.slug not in slugs)
    if any(needed.likelihood is not None for needed in kept):
        # Trajectories have not shown it, and decide neither its size nor whether it is needed.
        fitted = _still_held(named, remaining)
        return replace(named, fitted=fitted, needed=kept)
    fitted = _refitted_with(evaluator, named.fitted, remaining)
    if len(stages) == 1:
        # Its own stage may have had a term before it that is gone now.
        stages = [replace(stages[0], before=named.base)]
    fitted, needed = pruned(evaluator, fitted, stages)
    return replace(named, fitted=fitted, needed=tuple(needed))


def _still_held(named: Named, remaining: TermSet) -> Fitted:
    """The fit to no more than the ``remaining`` terms that leaves S, J and sizes where they are
    held: as it was before the last one was named, or the one of now without the others.
    """
    evaluator, before = named.evaluator, named.needed[-1].without
    if set(before.slugs) == set(remaining.slugs):
        return before
    layout = in_bounds_of(evaluator.layout(remaining), named.fitted.layout)
    start = conclude(evaluator, scored(layout, carried_over(named.fitted, layout)))
    return conclude(evaluator, refit(evaluator, start, POLISH))


def pruned(
    evaluator: Evaluator, fitted: Fitted, stages: list[SelectionStage]
) -> tuple[Fitted, list[Needed]]:
    """Drop each term, in the order in which they were found, that is not needed any more beside the
    later ones.

    The first term of two has often stood in for both.
    """
    if len(stages) == 1:
        return _only_if_needed(evaluator, fitted, stages[0])
    needed: list[Needed] = []
    for number, stage in enumerate(stages):
        beside = number < 2 and beside_another(stages[:1])
        fewer = fitted.layout.hypothesis.without(stage.accepted[0].slug)
        without_term = _refitted_with(evaluator, fitted, fewer, _known(stages, fewer))
        advantage = gain(evaluator, without_term, fitted)
        if _is_needed(evaluator, fitted, stage, advantage, 1, beside):
            needed.append(Needed(stage, without_term, advantage))
        else:
            fitted = without_term
    if len(needed) == 1:
        return pruned(evaluator, fitted, [needed[0].stage])
    return fitted, needed


def _only_if_needed(
    evaluator: Evaluator, fitted: Fitted, stage: SelectionStage
) -> tuple[Fitted, list[Needed]]:
    """``fitted``, which has the term of one stage alone, or what stood before where it is not
    needed.
    """
    before = stage.before
    if before.layout.hypothesis.terms:
        # It was found behind a term that has been dropped since.
        before = _refitted_with(evaluator, fitted, TermSet())
    advantage = gain(evaluator, before, fitted)
    if _is_needed(evaluator, fitted, stage, advantage):
        return fitted, [Needed(stage, before, advantage)]
    # What was polished on both folds predicts less than it did at its first look, or was taken for
    # the sake of a second term that was not found.
    return before, []


def _known(stages: Sequence[SelectionStage], terms: TermSet) -> list[Fitted]:
    """The fits of a hypothesis with just these ``terms`` that the search has come by."""
    fits = [fit for stage in stages for fit in (stage.before, *(s.fitted for s in stage.scores))]
    return [fit for fit in fits if fit.slugs == terms.slugs]


def _refitted_with(
    evaluator: Evaluator, fitted: Fitted, terms: TermSet, known: Sequence[Fitted] = ()
) -> Fitted:
    """``fitted`` with no more than some of its ``terms``, searched anew, also from fits that are
    ``known`` of these: what a term has taken over from them is not found again beside it."""
    layout = evaluator.layout(terms)
    first, *more = without(fitted, layout)
    more += [layout.bounds.clip(fit.candidates) for fit in known]
    start = conclude(evaluator, scored(layout, first))
    return conclude(evaluator, refit(evaluator, start, CAREFUL, *more))


def _is_needed(
    evaluator: Evaluator,
    fitted: Fitted,
    stage: SelectionStage,
    advantage: Advantage,
    number: int = 0,
    beside: bool = False,
) -> bool:
    """True where the hypothesis gains by the term of a stage beyond what chance reaches in round
    ``number``, ``beside`` as of ``convincing``; where that was only promising, and has passed no
    test of its size, its size must be material as well.
    """
    term = stage.accepted[0].term
    if not convincing(advantage, evaluator.measured_counts, term.slug, number, beside):
        return False
    values = fitted.values(term.slug).mean(axis=0)
    return not stage.promising or term.material(values, evaluator.summary)
