"""What our network, started from the fitted S and J, was meant to reach, and whether it does."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from stemwatch.models.paper.study import CLOSE, OURS, CaseResult, Result
from stemwatch.models.verdict import Shape

SINE = 0.005
MEDIAN = 0.005
# Overshoot: the stem jumps past its command, so one slip a sample late costs the most there.
MEDIAN_OVERSHOOT = 0.02


@dataclass(frozen=True, kw_only=True)
class Target:
    """``found`` was to be at most ``limit``; both RMSE in amplitudes of the sine."""

    shape: Shape
    what: str
    found: float
    limit: float

    @property
    def met(self) -> bool:
        return self.found <= self.limit


def targets(case: CaseResult) -> list[Target]:
    """Every target of one case: the sine, and for each family the median and four in five."""
    own = next(result for result in case.results if result.network == OURS)
    return [
        Target(shape=case.case.shape, what=what, found=found, limit=limit)
        for what, found, limit in _limits(case.case.shape, own)
    ]


def _limits(shape: Shape, own: Result) -> Iterator[tuple[str, float, float]]:
    yield "the paper's sine", own.rmse[own.chosen], SINE
    overshoot = shape is Shape.OVERSHOOT
    for family in own.unseen:
        limit = MEDIAN_OVERSHOOT if overshoot else MEDIAN
        yield f"{family.family}, median", family.median, limit
        if not overshoot:
            yield f"{family.family}, four in five", family.eightieth, CLOSE
