"""A verdict in words: sticky, watch or healthy, with what to do about it."""

from __future__ import annotations

import numpy as np

from stemwatch.models.decision.decision import Decision, S_text, percent, shape_of, share_of
from stemwatch.models.decision.decision_evidence import DecisionEvidence
from stemwatch.models.decision.doubts import (
    in_either_range,
    unless_averaged,
    unless_exchanged,
    unless_stored_so,
)
from stemwatch.models.decision.no_verdict import FASTER, cannot_tell
from stemwatch.models.decision.reading_off import CHECK_READING
from stemwatch.models.limits import Limits
from stemwatch.models.mismatch.terms._common import LAG_AS_BUILT_S
from stemwatch.models.preparation.own_clock import period
from stemwatch.models.verdict import Shape, Verdict

NEXT = {
    Shape.DEADBAND: (
        "The stem follows late but does not jump: look first for play in the linkage, the "
        "actuator coupling and the positioner's feedback arm, then for tight packing."
    ),
    Shape.UNDERSHOOT: (
        "The stem sticks and jumps: check packing (over-tightened, dry or hardened), stem and "
        "guide for scoring, and the positioner and its air supply."
    ),
    Shape.NO_OFFSET: (
        "The stem sticks and jumps right to the command: static friction is high and sliding "
        "friction low. Check packing and lubrication, then seat and guide."
    ),
    Shape.OVERSHOOT: (
        "The stem jumps past the command, which friction alone does only where little damps the "
        "stem: check the positioner's tuning (gain too high) and the actuator's size and air "
        "supply, then the packing."
    ),
}
NOT_THAT_SLOW = (
    "The stem does not stick, but it is slow: unless it was always so, check the air supply, its "
    "tubing and filter, the positioner's output, and the actuator for leaks."
)


def sticky(evidence: DecisionEvidence, limits: Limits) -> Decision:
    """Sticky: even the low end of S reaches the limit."""
    S, J = float(evidence.S.value or 0.0), float(evidence.J.value or 0.0)
    shape = shape_of(S, J)
    jump = f", then jumps {percent(J)}" if shape is not Shape.DEADBAND else " and then follows"
    cycle = ""
    if evidence.cycling_s is not None:
        cycle = f"; the loop cycles every {period(evidence.cycling_s, evidence.unit_s)}"
    decision = Decision(
        verdict=Verdict.STICKY,
        reason=(
            f"The stem sticks: after a reversal OP must move {S_text(evidence)} before the stem "
            f"lets go{jump}{cycle}.{evidence.slow}"
        ),
        advice=NEXT[shape],
        shape=shape,
        severity=50.0 + 50.0 * float(1.0 - np.exp(-(S + J) / 8.0)),
        confidence=share_of(evidence.S_draws >= limits.sticky_S_percent),
    )
    # Sticky in either range; but S and J are not those of the valve.
    return decision if evidence.op_in is None else in_either_range(decision, evidence)


def by_bound(
    evidence: DecisionEvidence, bound: float, limits: Limits, *, friction: bool
) -> Decision:
    """The decision where only a lower bound of S is known: sticky if the bound is, else none."""
    if bound < limits.sticky_S_percent or not friction:
        reason = f"S is at least {percent(bound)}, and may be much more: {evidence.S.reason}"
        return cannot_tell(reason, FASTER)
    return Decision(
        verdict=Verdict.STICKY,
        reason=(
            f"The stem sticks: after a reversal OP must move at least {percent(bound)} before "
            f"the stem lets go. How far is not known: {evidence.S.reason}.{evidence.slow}"
        ),
        advice=f"{NEXT[Shape.UNDERSHOOT]} {FASTER}",
        severity=50.0 + 50.0 * float(1.0 - np.exp(-bound / 8.0)),
        confidence=share_of(evidence.S_draws >= limits.sticky_S_percent),
    )


def watch(evidence: DecisionEvidence, limits: Limits, reason: str, confidence: float) -> Decision:
    """Watch, for a ``reason`` that is a whole sentence."""
    S, J = float(evidence.S.value or 0.0), float(evidence.J.value or 0.0)
    return Decision(
        verdict=Verdict.WATCH,
        reason=reason + evidence.slow,
        advice=(
            "Screen it again next week; plan a check of packing and positioner if S grows or the "
            "loop begins to cycle."
        ),
        shape=shape_of(S, J) if S >= limits.watch_S_percent else None,
        severity=25.0 + 20.0 * float(1.0 - np.exp(-(S + J) / 3.0)),
        confidence=confidence,
    )


def healthy(evidence: DecisionEvidence, limits: Limits) -> Decision:
    """Healthy, with what makes it doubtful."""
    # A stem beside which something acts is late, slow or slips too far: it does not follow.
    does = "hardly sticks" if evidence.slow else "follows"
    text = f"The stem {does}: S is {S_text(evidence)}.{evidence.slow}"
    advice = "Nothing to do at the valve."
    if evidence.cycling_s is not None:
        cycle_text = period(evidence.cycling_s, evidence.unit_s)
        text += f" The loop oscillates nevertheless, every {cycle_text}."
        advice = "Look for the cause in the controller's tuning or in a disturbance upstream."
    if evidence.takes_s > LAG_AS_BUILT_S:
        first = "Nothing to do at the packing" if evidence.cycling_s is None else advice.rstrip(".")
        advice = f"{first}. {NOT_THAT_SLOW}"
    if evidence.off is not None:
        text += f" {evidence.off.sentence()}"
        first = "Nothing to do at the packing." if advice.startswith("Nothing") else advice
        advice = f"{CHECK_READING} {first}"
    decision = Decision(
        verdict=Verdict.HEALTHY,
        reason=text,
        advice=advice,
        severity=10.0 * min(float(evidence.S.value or 0.0) / limits.watch_S_percent, 1.0),
        confidence=share_of(evidence.S_draws < limits.sticky_S_percent),
    )
    decision = unless_stored_so(decision, evidence, limits.watch_S_percent)
    decision = unless_averaged(decision, evidence, limits)
    return unless_exchanged(decision, evidence)
