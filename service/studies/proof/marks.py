"""``mark``: compares one case's truth with the answer, by the rules of the blind trial."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import permutations

from stemwatch.service.studies.proof.answers import BlindAnswer, NamedEffect
from stemwatch.service.studies.proof.truth import CaseKind, CaseTruth


class CaseOutcome(StrEnum):
    """How one case ended."""

    EXACT = "exact"  # the first name is the truth
    CLASS = "by class"  # the truth is among those that the first name cannot be told from
    WRONG = "wrong"  # the first name's class holds no truth
    MISS = "missed"  # nothing was named
    BOTH = "both"  # both of a pair by class, each by a name of its own
    ONE = "one of two"
    QUIET = "quiet"  # nothing hidden, nothing named
    FALSE_ALARM = "false alarm"
    CAUGHT = "caught"  # outside the catalogue, and said to be unknown
    MISNAMED = "misnamed"  # outside the catalogue, and given a name of the catalogue


@dataclass(frozen=True, kw_only=True)
class CaseMark:
    """Truth, answer and outcome of one case.

    ``wrong_names`` are all names whose class holds no truth, further ones included. ``right_name``
    tells whether the first name is right by class, ``None`` where nothing was named.
    """

    truth: CaseTruth
    answer: BlindAnswer
    outcome: CaseOutcome
    wrong_names: tuple[str, ...]
    right_name: bool | None

    @property
    def named(self) -> bool:
        """Whether any physics was named."""
        return bool(self.answer.names)


def mark(truth: CaseTruth, answer: BlindAnswer) -> CaseMark:
    """The outcome by the kind of the case; record effects are counted apart."""
    rules = {
        CaseKind.NULL: _null,
        CaseKind.SINGLE: _single,
        CaseKind.PAIR: _pair,
        CaseKind.UNKNOWN: _unknown,
    }
    wrong = tuple(
        name.slug for name in answer.names if not any(name.holds(slug) for slug in truth.physics)
    )
    first = answer.names[0].slug if answer.names else None
    return CaseMark(
        truth=truth,
        answer=answer,
        outcome=rules[truth.kind](truth.physics, answer),
        wrong_names=wrong,
        right_name=None if first is None else first not in wrong,
    )


def _null(_physics: Sequence[str], answer: BlindAnswer) -> CaseOutcome:
    return CaseOutcome.FALSE_ALARM if answer.names else CaseOutcome.QUIET


def _single(physics: Sequence[str], answer: BlindAnswer) -> CaseOutcome:
    if not answer.names:
        return CaseOutcome.MISS
    (slug,), first = physics, answer.names[0]
    if first.slug == slug:
        return CaseOutcome.EXACT
    return CaseOutcome.CLASS if first.holds(slug) else CaseOutcome.WRONG


def _pair(physics: Sequence[str], answer: BlindAnswer) -> CaseOutcome:
    if not answer.names:
        return CaseOutcome.MISS
    named = _count_found(physics, answer.names)
    return (CaseOutcome.WRONG, CaseOutcome.ONE, CaseOutcome.BOTH)[min(named, 2)]


def _count_found(physics: Sequence[str], names: Sequence[NamedEffect]) -> int:
    """The largest number of truths that are named, each name counting for one truth."""
    wide = [*names, *[None] * len(physics)]
    return max(
        sum(
            name is not None and name.holds(slug) for slug, name in zip(physics, order, strict=True)
        )
        for order in permutations(wide, len(physics))
    )


def _unknown(_physics: Sequence[str], answer: BlindAnswer) -> CaseOutcome:
    if answer.names:
        return CaseOutcome.MISNAMED
    return CaseOutcome.CAUGHT if answer.verdict == "unknown" else CaseOutcome.MISS
