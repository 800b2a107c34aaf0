"""What a search for terms has found: the terms that were tried on top of a hypothesis, those that
were taken, and the hypothesis that needs them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stemwatch.models.mismatch.fit.crossfit import Fitted
from stemwatch.models.mismatch.fit.evaluator import Evaluator
from stemwatch.models.mismatch.likelihood.likelihood_evidence import LikelihoodEvidence
from stemwatch.models.mismatch.search.breakaway_levels import BreakawayEvidence
from stemwatch.models.mismatch.term import Term
from stemwatch.models.recording import Floats
from stemwatch.models.stickslip.advantage import Advantage


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


def beside_another(stages: Sequence[SelectionStage]) -> bool:
    """True where ``stages`` are a single one whose term was accepted for its own sake."""
    return len(stages) == 1 and not stages[0].promising


def shown_by_likelihood(named: Named) -> bool:
    """Whether the likelihood has shown any of what is named."""
    return any(needed.likelihood is not None for needed in named.needed)
