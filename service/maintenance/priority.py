"""How urgent a finding is: criticality times severity times trend, in four classes with a reason.

    score = severity / 100 * weight of criticality * weight of trend

    score at least 0.80 -> 1, within a week;  0.55 -> 2, a month;  0.30 -> 3, three months;
    below -> 4, the next planned stop (a date half a year away)

Severity, 0 to 100, is that of the work decision. The classes are a proposal to a planner and no
more.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import date, datetime, timedelta, tzinfo

from stemwatch.service.report.change_since_last_run import Change

WEIGHT_OF_CRITICALITY = {"1": 0.6, "2": 0.8, "3": 1.0}
USUAL_CRITICALITY = "2"  # as the plant file has it where a valve says nothing
WEIGHT_OF_TREND = {"worse": 1.2, "better": 0.85}
CLASSES = ((0.80, 1), (0.55, 2), (0.30, 3), (0.0, 4))
WORDS = {1: "within a week", 2: "within a month", 3: "within three months", 4: "at the next stop"}
DAYS = {1: 7, 2: 30, 3: 90, 4: 180}


@dataclass(frozen=True, kw_only=True)
class Priority:
    """``code`` 1 (most urgent) to 4, its ``words``, the ``score`` 0 to 1.2 and the ``reason``."""

    code: int
    words: str
    score: float
    reason: str

    def due(self, reported: datetime, zone: tzinfo) -> date:
        """The end date to propose, a day in ``zone``."""
        return (reported.astimezone(zone) + timedelta(days=DAYS[self.code])).date()


def priority(severity: float, criticality: str, trend: Change) -> Priority:
    """The class of a finding, with the three factors as its reason."""
    known = criticality if criticality in WEIGHT_OF_CRITICALITY else USUAL_CRITICALITY
    weight = WEIGHT_OF_TREND.get(trend.direction, 1.0)
    score = severity / 100.0 * WEIGHT_OF_CRITICALITY[known] * weight
    code = next(code for least, code in CLASSES if score >= least)
    stated = f"criticality {known} of 3"
    if known != criticality:
        stated += f" (plant says {criticality!r})" if criticality else " (none is given)"
    reason = f"{stated}, severity {severity:.0f} of 100, trend: {trend.words}"
    return Priority(code=code, words=WORDS[code], score=score, reason=reason)
