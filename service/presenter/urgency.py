"""How urgent a valve is: its priority, and the one order of valves in every output.

First the valves with a work order, by priority; then those to watch, those that cannot be judged,
and those without work. Of one priority what needs work comes before what is to be found out, then
the larger score: severity times the weight of the valve's criticality.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import date, datetime, timedelta, tzinfo
from functools import lru_cache

from stemwatch.models.screening_result import Screening
from stemwatch.service.presenter.suspicion_words import score_of_suspicion
from stemwatch.service.presenter.wording import finite
from stemwatch.service.presenter.work_decision import WorkDecision, WorkState

WEIGHT_OF_CRITICALITY = {"1": 0.6, "2": 0.8, "3": 1.0}
USUAL_CRITICALITY = "2"  # the plant file's default for a valve without a criticality
CLASSES = ((0.80, 1), (0.55, 2), (0.30, 3), (0.0, 4))
WORDS = {1: "within a week", 2: "within a month", 3: "within three months", 4: "at the next stop"}
DAYS = {1: 7, 2: 30, 3: 90, 4: 180}
CLASSES_IN_WORDS = ", ".join(f"{code} {words}" for code, words in WORDS.items())

# Group, priority, whether it is work or to be found out, score, suspicion, tag: the smallest first.
UrgencyKey = tuple[int, int, int, float, float, str]
_GROUP_OF = {
    WorkState.NEEDS_WORK: 0,
    WorkState.WATCH: 1,
    WorkState.NOT_JUDGED: 2,
    WorkState.NO_WORK: 3,
}
_NOT_SCREENED = 4


@dataclass(frozen=True, kw_only=True)
class Priority:
    """``code`` 1 (most urgent) to 4, its ``words``, the ``score`` 0 to 1 and the ``reason``."""

    code: int
    words: str
    score: float
    reason: str

    def due(self, reported: datetime, zone: tzinfo) -> date:
        """The end date to propose, a day in ``zone``."""
        return (reported.astimezone(zone) + timedelta(days=DAYS[self.code])).date()


def priority(severity: float | None, criticality: str) -> Priority:
    """The class of a finding, with its two factors as the reason; one not known counts as 0.

    It is calculated from the rounded severity that is printed, so that a reader comes to the same
    class.
    """
    return _priority(round(finite(severity) or 0.0), criticality)


@lru_cache(maxsize=1024)  # a ranking asks for each of thousands of valves
def _priority(severity: int, criticality: str) -> Priority:
    level = criticality if criticality in WEIGHT_OF_CRITICALITY else USUAL_CRITICALITY
    score = round(severity / 100.0 * WEIGHT_OF_CRITICALITY[level], 6)
    code = next(code for least, code in CLASSES if score >= least)
    stated = f"criticality {level} of 3"
    if level != criticality:
        stated += f" (plant says {criticality!r})" if criticality else " (none is given)"
    reason = f"severity {severity} of 100, {stated}"
    return Priority(code=code, words=WORDS[code], score=score, reason=reason)


def priority_of(decision: WorkDecision, criticality: str) -> Priority | None:
    """How urgent the work order of a valve is; ``None`` where it has none."""
    return priority(decision.severity, criticality) if decision.has_order else None


def urgency_key(
    decision: WorkDecision | None, criticality: str, suspicion: float, valve: str
) -> UrgencyKey:
    """A key that sorts the valve to work on first to the front; without a ``decision``, which a
    valve has that was not screened yet, to the end.

    ``suspicion`` is the score that OP and PV alone give a loop without a position; it decides
    between equals.
    """
    if decision is None:
        return _NOT_SCREENED, 0, 0, 0.0, 0.0, valve
    group = 0 if decision.has_order else _GROUP_OF[decision.state]
    urgency = priority(decision.severity, criticality)
    to_find_out = int(not decision.needs_work)
    return group, urgency.code, to_find_out, -urgency.score, -suspicion, valve


def urgency_of(screening: Screening, decision: WorkDecision, criticality: str) -> UrgencyKey:
    """``urgency_key`` of a screening."""
    suspicion = score_of_suspicion(screening.verdict, screening.without_position)
    return urgency_key(decision, criticality, suspicion, screening.valve)
