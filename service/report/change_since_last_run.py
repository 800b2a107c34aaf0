"""What changed since the run before: better, worse or the same, and by how much."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from stemwatch.models.estimate import Estimate
from stemwatch.models.history.trend_over_weeks import TrendOverWeeks
from stemwatch.models.screening_result import PreviousFinding
from stemwatch.models.verdict import Verdict
from stemwatch.service.presenter.wording import finite
from stemwatch.service.presenter.work_decision import verdict_before

ARROWS = {"worse": "↗", "better": "↘", "same": "→", "new": "•", "unknown": "·"}
_GRAVITY = {Verdict.HEALTHY: 0, Verdict.WATCH: 1, Verdict.DEFECTIVE: 2, Verdict.STICKY: 3}

# A step in S counts only where the present interval excludes the earlier value and the step is
# large enough to show in plant data; without an interval it must be a tenth of the earlier value.
SMALLEST_STEP_PERCENT = 0.2
SMALLEST_SHARE = 0.1
SMALLEST_SEVERITY_STEP = 10.0


@dataclass(frozen=True, kw_only=True)
class Change:
    """``direction`` is worse, better, same, new or unknown; ``words`` says it to a reader."""

    direction: str
    words: str

    @property
    def arrow(self) -> str:
        return ARROWS[self.direction]


class HasSize(Protocol):
    """What a change is seen in: a screening, or its line in a ranking."""

    @property
    def severity(self) -> float:
        """0 to 100, the screening's."""

    @property
    def S(self) -> Estimate:
        """Percent of OP span."""


def change_since_last_run(
    now: HasSize,
    verdict: Verdict | None,
    before: PreviousFinding | None,
    weeks: TrendOverWeeks | None = None,
) -> Change:
    """The change from ``before`` to ``now``, whose verdict on the valve is ``verdict``: by verdict,
    else by the trend of S over ``weeks`` where it has one, else by S, else by severity.

    S may rise over weeks by less than its interval from run to run. Where the verdict and the trend
    of S change in the same direction, both are reported.
    """
    if before is None:
        return Change(direction="new", words="first look")
    previous_verdict = verdict_before(before)
    if verdict not in _GRAVITY or previous_verdict not in _GRAVITY:
        return Change(direction="unknown", words=f"was {previous_verdict.value}")
    if verdict != previous_verdict:
        direction = "worse" if _GRAVITY[verdict] > _GRAVITY[previous_verdict] else "better"
        words = f"{direction}, was {previous_verdict.value}"
        if weeks is not None and weeks.is_change and _direction(weeks) == direction:
            words += f"; {weeks.words}"
        return Change(direction=direction, words=words)
    if weeks is not None and weeks.is_change:
        return Change(direction=_direction(weeks), words=f"{_direction(weeks)}, {weeks.words}")
    return _within_a_verdict(now, before)


def _direction(weeks: TrendOverWeeks) -> str:
    return "worse" if weeks.per_month > 0.0 else "better"


def _within_a_verdict(now: HasSize, before: PreviousFinding) -> Change:
    S, S_before = finite(now.S.value), finite(before.S)
    if S is not None and S_before is not None:
        moved = _has_moved(now.S, S_before)
        return _change(S - S_before if moved else 0.0, f"S {S - S_before:+.2f}")
    step = (finite(now.severity) or 0.0) - before.severity
    moved = abs(step) >= SMALLEST_SEVERITY_STEP
    return _change(step if moved else 0.0, f"severity {step:+.0f}")


def _has_moved(S: Estimate, before: float) -> bool:
    value, low, high = finite(S.value), finite(S.low), finite(S.high)
    if value is None or abs(value - before) < SMALLEST_STEP_PERCENT:
        return False
    if low is not None and high is not None:
        return not low <= before <= high
    return abs(value - before) >= SMALLEST_SHARE * abs(before)


def _change(step: float, detail: str) -> Change:
    if step == 0:
        return Change(direction="same", words="no change")
    direction = "worse" if step > 0 else "better"
    return Change(direction=direction, words=f"{direction}, {detail}".replace("-", "−"))
