"""Which terms explain what the base leaves: screened, refined, guarded, and no more than needed.

A term enters a hypothesis where it predicts blocks of time that it was not fitted to better than
the hypothesis without it, by more than recordings with nothing hidden ever show (``limits``), and
where it is large enough to matter. The simpler of two that are as good is taken. Then the next one
is looked for on top of it, three at most.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from stemwatch.models.mismatch import bench as at
from stemwatch.models.mismatch import dwell
from stemwatch.models.mismatch.base import Base
from stemwatch.models.mismatch.beginnings import beginnings
from stemwatch.models.mismatch.bench import Bench, Hypothesis
from stemwatch.models.mismatch.crossfit import (
    CAREFUL,
    LOOK,
    POLISH,
    Fitted,
    again,
    better,
    crossfit,
    gain,
    own_losses,
    ranked,
    scored,
    widened,
)
from stemwatch.models.mismatch.instep import Search, conclude, together
from stemwatch.models.mismatch.limits import convincing
from stemwatch.models.mismatch.term import Term
from stemwatch.models.recording import Floats
from stemwatch.models.stickslip.fit import Advantage

MOST_TERMS = 3
PLAY = "lost_motion"
LEAST_JUMP_SHARE, LEAST_JUMP_PERCENT = 0.15, 0.3
REFINED = 6  # candidates of a stage that are searched with care
PROMISING = 0.02  # mean advantage at the first look; less has never become a finding
AS_GOOD = 1.5  # paired t below which two explanations cannot be told apart
ATTEMPTS = 2
MOVED = 0.03  # mean advantage of a restarted base over itself from which all is done again
NEARLY = 0.03  # mean advantage that a richer term must have over a simpler one that it contains


@dataclass(frozen=True)
class Score:
    """One more term on top of what was accepted before."""

    term: Term
    fitted: Fitted
    advantage: Advantage

    @property
    def slug(self) -> str:
        return self.term.slug

    @property
    def values(self) -> Floats:
        """(k,) the term's coordinates, the mean of both folds."""
        return np.asarray(self.fitted.values(self.slug).mean(axis=0))


@dataclass(frozen=True)
class Stage:
    """One round: what stood before, the scores of all terms on top of it, best first, and those
    accepted as explaining it, the chosen one first."""

    before: Fitted
    scores: tuple[Score, ...]
    accepted: tuple[Score, ...]


@dataclass(frozen=True)
class Needed:
    """A term of the final hypothesis: the stage that brought it, the best fit that lacks it, and
    how much better unseen blocks are predicted with it."""

    stage: Stage
    without: Fitted
    advantage: Advantage
    events: dwell.Dwelling | None = None  # that told it, where the trajectories did not

    @property
    def term(self) -> Term:
        return self.stage.accepted[0].term

    @property
    def members(self) -> tuple[str, ...]:
        return tuple(one.slug for one in self.stage.accepted)


@dataclass(frozen=True)
class Named:
    """The hypothesis that was reached, what it needs, and the stages on the way to it."""

    bench: Bench
    base: Fitted
    fitted: Fitted
    needed: tuple[Needed, ...]
    stages: tuple[Stage, ...]


def screened(bench: Bench, simple: Fitted, terms: Iterable[Term]) -> Search[list[Score]]:
    """Every term on top of ``simple``, best first."""
    found = yield from together(_looked_at(bench, simple, term) for term in terms)
    return _ordered(found)


def _looked_at(bench: Bench, simple: Fitted, term: Term) -> Search[Score]:
    """A first look at one term on top of ``simple``."""
    rich = simple.layout.hypothesis.plus(term)
    own = own_losses(bench, simple)
    fitted = yield from crossfit(
        bench, bench.layout(rich), _starts(bench, simple, term, rich), LOOK, own
    )
    plain = yield from neutral(bench, simple, rich)
    fitted = better(bench, plain, fitted)
    return Score(term, fitted, gain(bench, simple, fitted))


def _starts(bench: Bench, simple: Fitted, term: Term, rich: Hypothesis) -> Floats:
    """(m, size) where the search for one more term begins."""
    middle = simple.candidates.mean(axis=0)
    S, J = float(middle[at.S_PERCENT]), float(middle[at.S_PERCENT] * middle[at.RATIO])
    return widened(bench, rich, simple, term, beginnings(term, S, J))


def _ordered(scores: Iterable[Score]) -> list[Score]:
    return sorted(scores, key=lambda score: -score.advantage.mean)


def neutral(bench: Bench, simple: Fitted, rich: Hypothesis) -> Search[Fitted]:
    """``simple`` written in the coordinates of ``rich``, its new terms neutral."""
    layout = bench.layout(rich)
    candidates = np.zeros((2, layout.size))
    candidates[:, : at.N_BASE] = simple.candidates[:, : at.N_BASE]
    for slug, place in simple.layout.places.items():
        candidates[:, layout.places[slug]] = simple.candidates[:, place]
    if at.DEAD_TIME in layout.places and at.DEAD_TIME not in simple.layout.places:
        candidates[:, layout.places[at.DEAD_TIME]] = simple.candidates[:, [at.DELAY]]
    fitted = yield from scored(layout, layout.bounds.clip(candidates))
    return fitted


def reduced(bench: Bench, rich: Fitted, simple: Hypothesis) -> Floats:
    """(2, size) the candidates of ``rich`` in the coordinates of ``simple``."""
    layout = bench.layout(simple)
    candidates = np.zeros((2, layout.size))
    candidates[:, : at.N_BASE] = rich.candidates[:, : at.N_BASE]
    for slug, place in layout.places.items():
        candidates[:, place] = rich.candidates[:, rich.layout.places[slug]]
    if at.DEAD_TIME in rich.layout.places and at.DEAD_TIME not in layout.places:
        candidates[:, [at.DELAY]] = rich.candidates[:, rich.layout.places[at.DEAD_TIME]]
    return layout.bounds.clip(candidates)


def refined(
    bench: Bench, simple: Fitted, terms: Sequence[Term]
) -> Search[tuple[Fitted, list[Score]]]:
    """All ``terms`` on top of ``simple``, the best of them searched with care, and ``simple``
    restarted from each of these.

    A local minimum of the simple hypothesis is the commonest false discovery: where a restart
    finds a better one, everything is done once more from there.
    """
    for _ in range(ATTEMPTS):
        looked = yield from screened(bench, simple, terms)
        promising = [one for one in looked[:REFINED] if one.advantage.mean >= PROMISING]
        careful = yield from together(_careful(bench, simple, one) for one in promising)
        scores = [*careful, *looked[len(promising) :]]
        restarted = yield from _restarted(bench, simple, scores[:REFINED])
        moved = gain(bench, simple, restarted).mean
        simple = restarted
        if moved < MOVED:
            break
    nested = yield from together(_nested(bench, simple, one) for one in scores)
    return simple, _ordered(nested)


def _careful(bench: Bench, simple: Fitted, one: Score) -> Search[Score]:
    """A score searched with care.

    The first look began from the best starts; this also begins from those that come next.
    """
    layout = one.fitted.layout
    starts = _starts(bench, simple, one.term, layout.hypothesis)
    even, odd = yield from ranked(bench, layout, starts)
    more = [
        np.vstack((a.candidate, b.candidate))
        for a, b in zip(even[LOOK.keep :], odd[LOOK.keep :], strict=True)
    ]
    fitted = yield from again(bench, one.fitted, CAREFUL, *more[: CAREFUL.keep - 1])
    return Score(one.term, fitted, one.advantage)


def _restarted(bench: Bench, simple: Fitted, scores: Sequence[Score]) -> Search[Fitted]:
    """``simple`` searched again from where richer hypotheses have led."""
    if not scores:
        return simple
    restarts = [reduced(bench, one.fitted, simple.layout.hypothesis) for one in scores]
    fitted = yield from again(bench, simple, CAREFUL, *restarts)
    fitted = yield from again(bench, fitted, POLISH)
    return fitted


def _nested(bench: Bench, simple: Fitted, one: Score) -> Search[Score]:
    """A score against what ``simple`` has become; a richer hypothesis contains it."""
    plain = yield from neutral(bench, simple, one.fitted.layout.hypothesis)
    fitted = better(bench, plain, one.fitted)
    return Score(one.term, fitted, gain(bench, simple, fitted))


def passes(score: Score, bench: Bench, stage: int) -> bool:
    """True where the gain is beyond what nothing hidden shows, and the size matters."""
    enough = convincing(score.advantage, bench.told, score.slug, stage)
    return enough and _tells(score, bench) and score.term.material(score.values, bench.look)


def _tells(score: Score, bench: Bench) -> bool:
    """False for play behind a stem that does not jump: the two make one dead band, and which part
    of it is friction cannot be told."""
    if score.slug != PLAY:
        return True
    middle = score.fitted.candidates.mean(axis=0)
    S, J = middle[at.S_PERCENT], middle[at.S_PERCENT] * middle[at.RATIO]
    return bool(J >= max(LEAST_JUMP_SHARE * S, 4.0 * bench.look.sigma, LEAST_JUMP_PERCENT))


def accepted(bench: Bench, scores: list[Score], stage: int) -> list[Score]:
    """The terms that explain the recording, the one to take first; those after it as good."""
    passing = [one for one in scores if passes(one, bench, stage)]
    if not passing:
        return []
    best = passing[0]
    for simpler in passing[1:]:
        if simpler.slug in best.term.contains and _nearly(bench, simpler, best):
            best = simpler
            break
    rivals = [one for one in passing if one is not best and _as_good(bench, one, best)]
    return [best, *rivals]


def _nearly(bench: Bench, simple: Score, rich: Score) -> bool:
    """True where the richer term is not clearly better than the simpler one that it contains."""
    more = gain(bench, simple.fitted, rich.fitted)
    return more.mean < NEARLY or more.t < 1.0


def _as_good(bench: Bench, rival: Score, best: Score) -> bool:
    return gain(bench, rival.fitted, best.fitted).t < AS_GOOD


def name(base: Base, terms: Sequence[Term]) -> Named:
    """Build the hypothesis up from the base with the ``terms`` that the recording can show."""
    bench, simple = base.bench, base.fitted
    left = list(terms)
    stages: list[Stage] = []
    first = simple
    for stage in range(MOST_TERMS):
        simple, scores = conclude(bench, refined(bench, simple, left))
        if stage == 0:
            first = simple
        found = accepted(bench, scores, stage)
        stages.append(Stage(simple, tuple(scores), tuple(found)))
        if not found:
            break
        simple = conclude(bench, again(bench, found[0].fitted, POLISH))
        left = [term for term in left if term.slug != found[0].slug]
    fitted, needed = pruned(bench, simple, [stage for stage in stages if stage.accepted])
    if not needed:
        fitted, needed = told_by_events(bench, fitted, terms)
    return Named(bench=bench, base=first, fitted=fitted, needed=tuple(needed), stages=tuple(stages))


def told_by_events(
    bench: Bench, simple: Fitted, terms: Sequence[Term]
) -> tuple[Fitted, list[Needed]]:
    """Dwell, where no trajectory needs a term but the breakaways together show it."""
    term = next((term for term in terms if term.slug == dwell.SLUG), None)
    seen = dwell.dwelling(bench, simple) if term is not None else None
    if term is None or seen is None or not seen.convincing:
        return simple, []
    plain = conclude(bench, neutral(bench, simple, simple.layout.hypothesis.plus(term)))
    fitted = dwell.begun(bench, plain, seen)
    score = Score(term, fitted, gain(bench, simple, fitted))
    return fitted, [Needed(Stage(simple, (score,), (score,)), simple, score.advantage, seen)]


def pruned(bench: Bench, fitted: Fitted, stages: list[Stage]) -> tuple[Fitted, list[Needed]]:
    """Drop each term, first come first, that is no longer needed now that the later ones are there.

    The first term of two has often stood in for both.
    """
    if len(stages) == 1:
        only = stages[0]
        return fitted, [Needed(only, only.before, gain(bench, only.before, fitted))]
    needed: list[Needed] = []
    for stage in stages:
        lacking = fitted.layout.hypothesis.without(stage.accepted[0].slug)
        layout = bench.layout(lacking)
        begun = conclude(bench, scored(layout, reduced(bench, fitted, lacking)))
        without = conclude(bench, again(bench, begun, CAREFUL))
        advantage = gain(bench, without, fitted)
        if convincing(advantage, bench.told, stage.accepted[0].slug, 1):
            needed.append(Needed(stage, without, advantage))
        else:
            fitted = without
    if len(needed) == 1:
        return pruned(bench, fitted, [needed[0].stage])
    return fitted, needed
