"""The plan for a valve, from its last screening or from a recording that was just explained."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import replace
from datetime import datetime
from threading import Lock

from stemwatch.models.field_test.plan import FieldTestPlan, PlanKind, plan_test
from stemwatch.models.field_test.programme import TestLimits
from stemwatch.models.mismatch import identifiability
from stemwatch.models.mismatch.findings import Finding, Mismatch
from stemwatch.models.mismatch.open_question import OpenQuestion
from stemwatch.models.screening_result import Screening
from stemwatch.models.verdict import Verdict
from stemwatch.service.presenter.work_decision import NO_POSITION, obstacle_kind
from stemwatch.service.store.screenings.restored import screening_of
from stemwatch.service.store.store import Store

KEPT = 64  # plans kept for pages that are requested again
LOOKED_BACK = 50  # screenings searched for the one from which the test was planned


def plan_of(
    mismatch: Mismatch | None,
    limits: TestLimits,
    *,
    unfitted: OpenQuestion | None = None,
    judged: bool = True,
    op: float | None = None,
) -> FieldTestPlan:
    """The plan for the rivals that ``mismatch`` left open; ``judged`` is false without a verdict,
    ``unfitted`` what a test needs of a recording without a ``mismatch``."""
    question = unfitted if mismatch is None else mismatch.open_question
    is_judged = mismatch is not None and mismatch.finding is not Finding.NOT_TESTABLE
    plan = plan_test(question, limits, judged=judged or is_judged, op=op)
    untold = () if mismatch is None or is_judged else mismatch.not_testable
    blind = any(untold_effect.reason == identifiability.NO_POSITION for untold_effect in untold)
    if mismatch is not None and mismatch.finding is Finding.UNKNOWN:
        plan = _nothing_between(plan)
    elif mismatch is not None:
        plan = _by_hand(plan, mismatch)
    return _without_position(plan) if blind else plan


def _by_hand(plan: FieldTestPlan, mismatch: Mismatch) -> FieldTestPlan:
    """``plan``, but where effects are left open between which no test can be designed it says so,
    with the test by hand that their advice has."""
    open_effects = [effect for effect in mismatch.effects if len(effect.members) > 1]
    if plan.kind is not PlanKind.NOTHING_LEFT or not open_effects:
        return plan
    left_open = "; ".join(
        f"{' or '.join(slug.replace('_', ' ') for slug in effect.members)} is left open, and only "
        f"a test by hand tells: {effect.decide.rstrip('.')}"
        for effect in open_effects
    )
    return replace(plan, kind=PlanKind.CANNOT_TELL, rivals=(), test=None, reason=left_open)


def _nothing_between(plan: FieldTestPlan) -> FieldTestPlan:
    """``plan`` of a recording that S and J may not explain, where no two explanations compete."""
    if plan.kind is not PlanKind.NOTHING_LEFT:
        return plan
    reason = (
        "the last recording leaves open whether S and J explain it, but no two explanations "
        "between which a test could tell; screen a window in which OP moves more, and look where "
        "it differs"
    )
    return replace(plan, kind=PlanKind.CANNOT_TELL, rivals=(), test=None, reason=reason)


def _without_position(plan: FieldTestPlan) -> FieldTestPlan:
    reason = (
        "the position (MV), by which its recording would be judged, is not there; a bump test by "
        "hand tells, or an hour with a portable transmitter"
    )
    return replace(plan, kind=PlanKind.CANNOT_TELL, rivals=(), test=None, reason=reason)


def plan_of_screening(
    screening: Screening, limits: TestLimits, op: float | None = None
) -> FieldTestPlan:
    """The plan for a valve as it was screened last."""
    judged = screening.verdict is not Verdict.UNDETERMINED
    plan = plan_of(
        screening.mismatch, limits, unfitted=screening.open_question, judged=judged, op=op
    )
    blind = not judged and obstacle_kind(screening.no_verdict) == NO_POSITION
    return _without_position(plan) if blind else plan


def question_before(
    store: Store, valve: str, begin: datetime | None
) -> tuple[OpenQuestion, datetime] | None:
    """The question left open by the last screening of ``valve`` that ended before ``begin``, and
    the end of its window; of the very last screening where ``begin`` is not known or none ended
    before. ``None`` where the valve has no screening.

    A screening whose window contains the test may already have answered the question.
    """
    screenings = store.screenings(valve, LOOKED_BACK)
    if not screenings:
        return None
    before = [screening for screening in screenings if begin is not None and screening.at <= begin]
    chosen = (before or screenings)[0]
    question = chosen.open_question if chosen.mismatch is None else chosen.mismatch.open_question
    return question or OpenQuestion(), chosen.at


class PlanCache:
    """Plans for valves in a store. A plan takes seconds, so those used last are kept; a new
    screening of a valve gets a new plan."""

    def __init__(self, largest: int = KEPT) -> None:
        self._most = largest
        self._kept: OrderedDict[tuple[object, ...], FieldTestPlan] = OrderedDict()
        self._guard = Lock()

    def plan(
        self, store: Store, valve: str, limits: TestLimits, op: float | None = None
    ) -> FieldTestPlan | None:
        """The plan from the last screening of ``valve``; ``None`` where it has none."""
        latest = store.screenings(valve, 1)
        if not latest:
            return None
        key = (str(store.address), latest[0].id, limits, op)
        with self._guard:
            if key in self._kept:
                self._kept.move_to_end(key)
                return self._kept[key]
            # One at a time: a second reader of the page waits for the first one's plan.
            plan = plan_of_screening(screening_of(latest[0]), limits, op)
            self._kept[key] = plan
            while len(self._kept) > self._most:
                self._kept.popitem(last=False)
            return plan
