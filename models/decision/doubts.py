"""What takes confidence from a verdict, or the verdict itself: another range that OP may be stored
in, an archive of averages, tags that may be exchanged, a reading that wanders.
"""

from __future__ import annotations

from dataclasses import replace

from stemwatch.models.decision.decision import Decision, percent
from stemwatch.models.decision.decision_evidence import DecisionEvidence
from stemwatch.models.decision.no_verdict import cannot_tell
from stemwatch.models.limits import Limits
from stemwatch.models.mismatch.terms._common import CALIBRATE_FROM_PERCENT
from stemwatch.models.preparation.own_clock import duration
from stemwatch.models.verdict import NoVerdict, Verdict

EITHER_WAY = 0.5  # confidence where the archive may have stored them otherwise, and S is another
CHECK_TRANSMITTER = (
    "Check the position transmitter: clamp or magnet, terminals and moisture, heat from the bonnet "
    "or the sun. In manual mark the stem and compare its reading hours later."
)
AVERAGED = "have samples archived, or step OP by 1 % in manual and see whether the stem follows."


def unless_averaged(decision: Decision, evidence: DecisionEvidence, limits: Limits) -> Decision:
    """``decision`` with half the confidence at most, and with the S that averages may hide, where
    that is sticky: whether a slow archive keeps averages is not seen on a stem that follows."""
    hidden, confidence = evidence.S_averaged, decision.confidence
    if hidden < limits.sticky_S_percent or confidence is None:
        return decision
    every = duration(evidence.every_s, evidence.unit_s, "g")
    return replace(
        decision,
        reason=(
            f"{decision.reason} If the archive keeps averages over {every}, noise of OP within "
            f"them may hide an S of up to {percent(hidden)}."
        ),
        advice=f"If it keeps averages: {AVERAGED} {decision.advice}",
        confidence=min(confidence, EITHER_WAY),
    )


def unless_stored_so(decision: Decision, evidence: DecisionEvidence, limit: float) -> Decision:
    """``decision`` with half the confidence at most, and with the ranges to give, where OP, or OP
    and position, may be stored in another range, in which S reaches ``limit``, percent.
    """
    stored, S = evidence.both_in or evidence.op_in, float(evidence.S.value or 0.0)
    if stored is None or decision.confidence is None or stored.times * S < limit:
        return decision
    doubted = replace(decision, confidence=min(decision.confidence, EITHER_WAY))
    return in_either_range(doubted, evidence)


def in_either_range(decision: Decision, evidence: DecisionEvidence) -> Decision:
    """``decision`` with the S of the other range, and what to give in the plant file."""
    stored = evidence.both_in or evidence.op_in
    assert stored is not None
    in_range, S = f"{stored.low:g} to {stored.high:g}", float(evidence.S.value or 0.0)
    give = f"{stored.unit}, give low = {stored.low:g}, high = {stored.high:g}"
    if evidence.both_in is not None:
        seen = f"OP and position both stay within {in_range}: if they are"
        ask = f"Check whether OP and position are in percent. If they are in {give} for both"
    else:
        seen = f"OP stays within {in_range}, far from where the position is: if it is"
        ask = f"Check whether OP is in percent. If it is in {give} for it"
    return replace(
        decision,
        reason=(
            f"{decision.reason} {seen} stored in {stored.unit}, S is {percent(stored.times * S)}."
        ),
        advice=f"{ask} in the plant file, else low = 0, high = 100. {decision.advice}",
    )


def unless_exchanged(decision: Decision, evidence: DecisionEvidence) -> Decision:
    """``decision`` with half the confidence at most, and with a doubt, where the position moves
    before its command and either clocks differ or the two tags are exchanged."""
    if evidence.leads_s <= 0.0 or decision.confidence is None:
        return decision
    return replace(
        decision,
        reason=(
            f"{decision.reason} The position moves {duration(evidence.leads_s, evidence.unit_s)} "
            "before OP: OP is stored late, or the two tags are exchanged."
        ),
        advice=(
            "Check which tag is OP and which is the position: step OP by hand and see which moves "
            f"first. {decision.advice}"
        ),
        confidence=min(decision.confidence, EITHER_WAY),
    )


def unless_it_wanders(decision: Decision, evidence: DecisionEvidence) -> Decision:
    """``decision``, or none where the reading wanders: S and J then stand for that as well. What a
    stroke check lets pass takes no healthy valve its verdict, and no wander rests and jumps."""
    wander = evidence.wander
    if wander is None or evidence.jumps_evident or evidence.rests:
        return decision
    said = wander.sentence(evidence.unit_s)
    if decision.verdict is Verdict.HEALTHY and wander.percent < CALIBRATE_FROM_PERCENT:
        return replace(
            decision,
            reason=f"{decision.reason} {said[0].upper()}{said[1:]}.",
            advice=f"{decision.advice} {CHECK_TRANSMITTER}",
        )
    return cannot_tell(
        f"{said}, so S and J would mean nothing",
        CHECK_TRANSMITTER,
        NoVerdict.READING_WANDERS,
        numbers_hold=False,
    )
