"""``mark``: one case's truth against what was said of it. The rules of the count stand here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import permutations

from stemwatch.service.proof.said import Name, Said
from stemwatch.service.proof.truth import CaseTruth, Kind


class Outcome(StrEnum):
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
class Mark:
    """Truth, answer and outcome of one case.

    ``wrong_names`` are all names whose class holds no truth, further ones included. ``right_name``
    tells whether the first name is right by class, ``None`` where nothing was named.
    """

    truth: CaseTruth
    said: Said
    outcome: Outcome
    wrong_names: tuple[str, ...]
    right_name: bool | None

    @property
    def named(self) -> bool:
        """Whether any physics was named."""
        return bool(self.said.names)


def mark(truth: CaseTruth, said: Said) -> Mark:
    """The outcome by the kind of the case; record effects are counted apart."""
    rules = {
        Kind.NULL: _null,
        Kind.SINGLE: _single,
        Kind.PAIR: _pair,
        Kind.UNKNOWN: _unknown,
    }
    wrong = tuple(
        name.slug for name in said.names if not any(name.holds(slug) for slug in truth.physics)
    )
    first = said.names[0].slug if said.names else None
    return Mark(
        truth=truth,
        said=said,
        outcome=rules[truth.kind](truth.physics, said),
        wrong_names=wrong,
        right_name=None if first is None else first not in wrong,
    )


def _null(_physics: Sequence[str], said: Said) -> Outcome:
    return Outcome.FALSE_ALARM if said.names else Outcome.QUIET


def _single(physics: Sequence[str], said: Said) -> Outcome:
    if not said.names:
        return Outcome.MISS
    (slug,), first = physics, said.names[0]
    if first.slug == slug:
        return Outcome.EXACT
    return Outcome.CLASS if first.holds(slug) else Outcome.WRONG


def _pair(physics: Sequence[str], said: Said) -> Outcome:
    if not said.names:
        return Outcome.MISS
    found = _found(physics, said.names)
    return (Outcome.WRONG, Outcome.ONE, Outcome.BOTH)[min(found, 2)]


def _found(physics: Sequence[str], names: Sequence[Name]) -> int:
    """The most truths that names can be given to, each name to one truth."""
    wide = [*names, *[None] * len(physics)]
    return max(
        sum(
            name is not None and name.holds(slug) for slug, name in zip(physics, order, strict=True)
        )
        for order in permutations(wide, len(physics))
    )


def _unknown(_physics: Sequence[str], said: Said) -> Outcome:
    if said.names:
        return Outcome.MISNAMED
    return Outcome.CAUGHT if said.verdict == "unknown" else Outcome.MISS
