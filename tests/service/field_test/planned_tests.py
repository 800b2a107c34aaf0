"""Plans made by hand for the tests of sheets, pages and commands."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from stemwatch.models.closed_loop.process_response import ProcessResponse
from stemwatch.models.estimate import Estimate
from stemwatch.models.field_test.plan import FieldTestPlan, plan_test
from stemwatch.models.field_test.programme import TestLimits
from stemwatch.models.mismatch.open_question import OpenQuestion, RivalModel

PROCESS = ProcessResponse(
    gain=Estimate(value=2.0, low=1.8, high=2.2), unit="t/h", pv_low=90.0, pv_high=110.0
)


def rival(slug: str, **terms: tuple[float, ...]) -> RivalModel:
    """A model with S of 2 % and J of 0.6 % whose numbers are known well."""
    base = (2.0, 0.3, 0.0, 0.0, 0.0, 0.0)
    return RivalModel(slug=slug, base=(base, base), terms={k: (v, v) for k, v in terms.items()})


RIVALS = (rival("actuator_lag", actuator_lag=(4.0,)), rival("dead_time", dead_time=(4.0,)))
QUESTION = OpenQuestion(
    models=RIVALS, duration=3600.0, sigma=0.05, scatter=0.1, op=47.0, process=PROCESS
)


@cache
def plan_that_tells() -> FieldTestPlan:
    """Lag and dead time within five minutes."""
    return plan_test(QUESTION, TestLimits(duration_s=300.0))


@cache
def plan_without_room() -> FieldTestPlan:
    """No move keeps PV within so little."""
    return plan_test(QUESTION, TestLimits(pv_upset=0.05, duration_s=120.0))


@cache
def plan_of_nothing() -> FieldTestPlan:
    """One model is no question."""
    return plan_test(replace(QUESTION, models=RIVALS[:1]))


@cache
def plan_of_a_bump() -> FieldTestPlan:
    """A valve without a verdict, its OP and PV unknown."""
    return plan_test(None, TestLimits(duration_s=300.0), judged=False)
