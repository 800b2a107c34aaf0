"""A limit of the product compared with recordings that must not exceed it (nulls) and others that
should.

A check reports only where several limits are all met. A limit holds where at most a given share of
the nulls meets all of them. The least value for which it would hold is derived from the nulls that
meet all other limits.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from stemwatch.models.recording import Recording

MAY_PASS = 0.05  # of nulls that may lie beyond all limits that belong together
Evidence = TypeVar("Evidence")


def every_second_piece(recording: Recording, samples: int) -> Iterator[Recording]:
    """Pieces of so many ``samples``, with as many left out between them."""
    for first in range(0, len(recording) - samples + 1, 2 * samples):
        yield recording.part(first, first + samples)


@dataclass(frozen=True)
class Limit:
    """A limit of the product: it is met beyond ``limit`` (``above`` it or below).

    ``worst`` is the null that comes nearest, of the ``nulls`` that meet all limits beside it, and
    ``nulls_beyond`` of them lie beyond it. It must lie beyond ``needed`` for no more than the share
    that may of ``all_nulls`` to meet them all; NaN where the others see to that. ``beyond`` of
    ``of`` recordings with the effect lie beyond it. It ``holds`` where some null came so far, and
    no more than that share lies beyond it.
    """

    name: str
    limit: float
    above: bool
    worst: float
    needed: float
    nulls: int
    nulls_beyond: int
    all_nulls: int
    beyond: int
    of: int
    holds: bool


@dataclass(frozen=True)
class JointCondition:
    """One of the limits that must all be met: a ``field`` of the evidence beyond ``limit``; its
    name in ``words``."""

    words: str
    field: str
    limit: float
    above: bool = True

    def met(self, case: object) -> bool:
        """Whether a recording meets the limit; one without a value does not."""
        value = getattr(case, self.field)
        return bool(value >= self.limit if self.above else value <= self.limit)


@dataclass(frozen=True)
class Tested(Generic[Evidence]):
    """Evidence of recordings without the effect, and of others that have it; ``may_pass`` is the
    share of the first that may meet all limits that belong together."""

    nulls: Sequence[Evidence]
    others: Sequence[Evidence]
    may_pass: float = MAY_PASS

    def limit(
        self,
        name: str,
        field: str,
        limit: float,
        beside: Callable[[Evidence], bool] = lambda _: True,
        *,
        above: bool = True,
    ) -> Limit:
        """The limit of a ``field``, of those recordings that meet the limits ``beside`` it."""
        sign = 1.0 if above else -1.0
        nulls, others = (
            np.sort([-sign * getattr(case, field) for case in group if beside(case)])
            for group in (self.nulls, self.others)
        )
        nulls, others = nulls[np.isfinite(nulls)], others[np.isfinite(others)]
        may_pass = int(self.may_pass * len(self.nulls))
        nearest = np.append(-sign * nulls, np.full(may_pass + 1, np.nan))
        nulls_beyond = int(np.count_nonzero(nulls <= -sign * limit))
        return Limit(
            name=name,
            limit=limit,
            above=above,
            worst=float(nearest[0]),
            needed=float(nearest[may_pass]) if nulls.size > may_pass else float("nan"),
            nulls=nulls.size,
            nulls_beyond=nulls_beyond,
            all_nulls=len(self.nulls),
            beyond=int(np.count_nonzero(others <= -sign * limit)),
            of=others.size,
            holds=nulls.size > 0 and nulls_beyond <= self.may_pass * len(self.nulls),
        )

    def together(
        self,
        name: str,
        limits: Sequence[JointCondition],
        asked: Callable[[Evidence], bool] = lambda _: True,
    ) -> Iterator[Limit]:
        """Each of the ``limits`` that must all be met, of those that meet the others; only where
        ``asked`` is true anything is asked at all."""
        for limit in limits:
            others = [other for other in limits if other is not limit]

            def meets_the_others(case: Evidence, others: Sequence[JointCondition] = others) -> bool:
                return asked(case) and all(other.met(case) for other in others)

            full_name = f"{name}: {limit.words}"
            yield self.limit(
                full_name, limit.field, limit.limit, meets_the_others, above=limit.above
            )
