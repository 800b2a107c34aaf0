"""``plan_test``: the test that would separate the rivals that a recording left open, or why there
is none.
"""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass, field, replace
from enum import StrEnum

from stemwatch.models.field_test.design import DesignedTest, allowed_upset, design
from stemwatch.models.field_test.programme import MoveKind, TestLimits
from stemwatch.models.mismatch.open_question import OpenQuestion, RivalModel

# Share of the distance from chance to certainty that the probability of a useful test must cover.
LEAST_OVER_CHANCE = 0.5
LEAST_PAIR = 0.7  # probability below which two rivals are not separated
MIDDLE = 50.0  # percent; where OP is not known, the sheet gives changes from the present value
MOST_AMPLITUDE = 20.0  # percent, up to which limits are widened in search of a useful test
HEALTHY, STICKY = (0.3, 0.1), (3.0, 1.0)  # S and J, percent, that a bump test must separate
FREE, STICKS = "moves_freely", "sticks"


class PlanKind(StrEnum):
    """Whether there is a test that separates the rivals, and what it is for."""

    TELLS = "tells"  # a test within the limits separates the rivals
    CANNOT_TELL = "cannot_tell"  # none does; the best one is shown, and wider limits that would do
    NOTHING_LEFT = "nothing_left"  # nothing is left to be separated
    BUMP = "bump"  # there is no verdict yet: a test that would give one


@dataclass(frozen=True, kw_only=True)
class FieldTestPlan:
    """The plan for one valve, within ``limits``, from OP at ``op`` percent.

    ``op_known`` says whether that is where OP was last seen. ``rivals`` are those that the test is
    for, ``too_slow`` those that no test of minutes shows. ``undecided`` are pairs of rivals that
    even this test does not separate; ``wider`` the limits within which one would, with its
    probability, where such were found. ``reason`` says why there is no test.
    """

    kind: PlanKind
    limits: TestLimits
    op: float
    op_known: bool
    rivals: tuple[str, ...] = ()
    too_slow: tuple[str, ...] = ()
    test: DesignedTest | None = None
    undecided: tuple[tuple[str, str], ...] = ()
    wider: TestLimits | None = None
    wider_probability: float | None = None
    allowed_upset: float | None = None
    reason: str = ""
    question: OpenQuestion = field(default_factory=OpenQuestion)


def plan_test(
    question: OpenQuestion | None,
    limits: TestLimits | None = None,
    *,
    judged: bool = True,
    op: float | None = None,
) -> FieldTestPlan:
    """The test for the rivals of ``question``; ``op`` is the present OP, percent, where it is
    known.

    ``judged`` is False where the valve got no verdict because it did not move enough: then the test
    is a bump test that would give one. Never raises for what a question holds.
    """
    limits, open_question = limits or TestLimits(), question or OpenQuestion()
    start_op = open_question.op if op is None else op
    plan = FieldTestPlan(
        kind=PlanKind.NOTHING_LEFT,
        limits=limits,
        op=MIDDLE if start_op is None else round(start_op, 1),
        op_known=start_op is not None,
        rivals=open_question.rivals,
        too_slow=open_question.slow,
        allowed_upset=allowed_upset(open_question, limits),
        question=open_question,
    )
    if len(open_question.quick) > 1:
        rivals = tuple(model.slug for model in open_question.quick)
        planned = _planned(replace(plan, rivals=rivals), open_question.quick)
        return replace(planned, undecided=(*planned.undecided, *_with_slow(open_question)))
    if len(open_question.models) > 1:
        reason = "what grows or drifts over a whole recording does not show in minutes"
        cannot = replace(plan, kind=PlanKind.CANNOT_TELL, reason=reason)
        return replace(cannot, undecided=_with_slow(open_question))
    if judged:
        return plan
    stems = tuple(_stem(slug, *levels) for slug, levels in ((FREE, HEALTHY), (STICKS, STICKY)))
    # Nothing was fitted, so the scatter is the usual one, and no curve is known.
    typical = replace(open_question, scatter=0.08 * 0.5 * sum(STICKY), restick=0.0)
    bump = replace(plan, rivals=(FREE, STICKS), question=typical)
    planned = _planned(bump, stems, (MoveKind.STAIRCASE,))
    return replace(planned, kind=PlanKind.BUMP) if planned.kind is PlanKind.TELLS else planned


def _stem(slug: str, S: float, J: float) -> RivalModel:
    base = (S, J / S, 0.0, 0.0, 0.0, 0.0)
    return RivalModel(slug=slug, base=(base, base), terms={})


def _with_slow(question: OpenQuestion) -> tuple[tuple[str, str], ...]:
    """The pairs that no test separates, because one of the two shows only over a longer time."""
    slugs = question.rivals
    pairs = ((slugs[j], slugs[i]) for i in range(len(slugs)) for j in range(i))
    return tuple(pair for pair in pairs if not set(question.slow).isdisjoint(pair))


def _planned(
    plan: FieldTestPlan,
    models: tuple[RivalModel, ...],
    kinds: Container[MoveKind] = tuple(MoveKind),
) -> FieldTestPlan:
    test = design(plan.question, models, plan.limits, plan.op, kinds)
    if test is None:
        short = replace(plan, kind=PlanKind.CANNOT_TELL, reason=_no_room(plan))
        return _with_wider(short, models, kinds)
    pairs = [(i, j) for i in range(len(models)) for j in range(i)]
    undecided = tuple(
        (models[j].slug, models[i].slug)
        for i, j in pairs
        if test.pair_probability(i, j) < LEAST_PAIR
    )
    if is_worth_its_time(test):
        return replace(plan, kind=PlanKind.TELLS, test=test, undecided=undecided)
    short = replace(plan, kind=PlanKind.CANNOT_TELL, test=test, undecided=undecided)
    return _with_wider(short, models, kinds)


def is_worth_its_time(test: DesignedTest) -> bool:
    """Whether the right rival wins so often that the test is worth its time."""
    chance = 1.0 / len(test.models)
    return test.probability >= chance + LEAST_OVER_CHANCE * (1.0 - chance)


def _no_room(plan: FieldTestPlan) -> str:
    down, up = plan.limits.room(plan.op)
    if down + up < 0.4:
        return (
            f"OP at {plan.op:g} % has no room within {plan.limits.op_low:g} to "
            f"{plan.limits.op_high:g} %"
        )
    if plan.allowed_upset is not None:
        return f"every move upsets PV by more than {plan.allowed_upset:.3g}"
    return f"no move fits into {plan.limits.duration_s / 60.0:g} minutes"


def _with_wider(
    plan: FieldTestPlan, models: tuple[RivalModel, ...], kinds: Container[MoveKind]
) -> FieldTestPlan:
    """The plan with the first of some wider limits within which a test is useful, and its
    probability.
    """
    limits = plan.limits
    more_amplitude = max(min(2.0 * limits.amplitude, MOST_AMPLITUDE), limits.amplitude)
    longer_s = min(3.0 * limits.duration_s, 86400.0)
    wider_plans = (
        (more_amplitude, limits.duration_s),
        (limits.amplitude, longer_s),
        (max(more_amplitude, MOST_AMPLITUDE), longer_s),
    )
    for amplitude, duration_s in dict.fromkeys(wider_plans):
        wider = replace(limits, amplitude=amplitude, duration_s=duration_s)
        test = None if wider == limits else design(plan.question, models, wider, plan.op, kinds)
        if test is not None and is_worth_its_time(test):
            return replace(plan, wider=wider, wider_probability=test.probability)
    return plan
