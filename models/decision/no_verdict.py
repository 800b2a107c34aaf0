"""No verdict, each with the reason and what would tell."""

from __future__ import annotations

from stemwatch.models.decision.decision import Decision, S_text, percent
from stemwatch.models.decision.decision_evidence import DecisionEvidence
from stemwatch.models.preparation.own_clock import period
from stemwatch.models.record_checks.data_quality import Obstacle
from stemwatch.models.record_checks.on_a_stop import STOP_REMEDY, Stop
from stemwatch.models.record_checks.own_swing import OwnSwing
from stemwatch.models.record_checks.pulsing_stem import Pulses
from stemwatch.models.stickslip.change_of_stiction import ChangeOfStiction
from stemwatch.models.verdict import NoVerdict, Verdict

LONGER = "Record a longer window, or one in which OP reverses more often."
STEPPED = (
    "Check that OP is what this valve is told (its own tag, in percent of its stroke) and that the "
    "position is its own. If so, record a stretch in which OP is stepped up and down, each step "
    "held until the stem rests, and screen that."
)
FINER = (
    "Step OP by 0.5 to 1 % at a time, a few steps up and a few down, each held until the stem "
    "rests, and screen that."
)
FASTER = (
    "Have OP and position archived faster, without averages and exception reports, and screen it "
    "again."
)
SLOW_OR_STICKING = (
    "Step OP by 1 % and then by 5 %: a slow actuator follows both, a sticking stem only the larger "
    "one."
)
QUIET_OP = (
    "Set the loop to manual, so that OP rests, and step it by 1 % and then by 5 %, each step held "
    "until the stem rests: a good stem follows both, a sticking one only the larger."
)
MORE = " (and {} more, see data quality)"  # obstacles that the sentence does not name


def undetermined(obstacles: tuple[Obstacle, ...]) -> Decision:
    """No verdict; the reason names the first obstacle and how many more there are."""
    first = obstacles[0]
    and_more = MORE.format(len(obstacles) - 1) if obstacles[1:] else ""
    return Decision(
        verdict=Verdict.UNDETERMINED,
        reason=f"Cannot tell: {first.reason}{and_more}.",
        advice=first.remedy,
        severity=15.0,
        no_verdict=NoVerdict.of(first.slug),
    )


def cannot_tell(
    reason: str,
    advice: str,
    no_verdict: NoVerdict = NoVerdict.S_UNCERTAIN,
    *,
    numbers_hold: bool = True,
) -> Decision:
    """No verdict, for a ``reason`` that is a clause; ``numbers_hold`` as in ``Decision``."""
    return Decision(
        verdict=Verdict.UNDETERMINED,
        reason=f"Cannot tell: {reason}.",
        advice=advice,
        severity=20.0,
        no_verdict=no_verdict,
        numbers_hold=numbers_hold,
    )


def not_described(unexplained: str, sampling: str) -> Decision:
    """No verdict where S and J do not describe the valve; ``sampling`` names slow sampling."""
    if sampling:
        return cannot_tell(
            f"{unexplained}: {sampling}", FASTER, NoVerdict.SLOW_SAMPLING, numbers_hold=False
        )
    return cannot_tell(
        f"{unexplained}, so S and J would mean nothing",
        "Something else moves this stem (positioner, actuator, air supply, the reading "
        "itself): look at the residual plots, and do a stroke test with small steps.",
        NoVerdict.FRICTION_DOES_NOT_EXPLAIN,
        numbers_hold=False,
    )


def slow_actuator_fits_as_well(evidence: DecisionEvidence) -> Decision:
    """No verdict where a large S is not needed."""
    return cannot_tell(
        f"S of {S_text(evidence)} would fit, but a slow actuator without friction fits as well",
        SLOW_OR_STICKING,
        NoVerdict.SLOW_ACTUATOR,
    )


def neither_follows(evidence: DecisionEvidence) -> Decision:
    """No verdict where a lag took the place of friction, and follows no better than friction."""
    assert evidence.following is not None
    return cannot_tell(
        "a slow actuator without friction would explain how the stem lags behind OP, and so "
        f"would an S of {percent(evidence.without_lag)}; neither follows the part of the "
        "recording that was not fitted (on average "
        f"{percent(evidence.following.rmse)} of travel off)",
        f"{SLOW_OR_STICKING} {FASTER}",
        NoVerdict.SLOW_ACTUATOR,
        numbers_hold=False,
    )


def curve_fits_as_well(evidence: DecisionEvidence) -> Decision:
    """No verdict where what a curve from OP to stroke is off by looks like a dead band."""
    return cannot_tell(
        f"S of {S_text(evidence)} would fit, but a curve from OP to stroke that is a little "
        "different, without friction, fits as well",
        f"Give the valve's curve in the plant file if it is known. {LONGER}",
    )


def shaken_loose(evidence: DecisionEvidence) -> Decision:
    """No verdict where friction and a slow actuator look alike from sample to sample."""
    return cannot_tell(
        "the stem follows OP as if the actuator took many seconds, and few are that slow; a stem "
        f"with an S of {percent(evidence.shaken)} that OP shakes loose between two samples of the "
        "archive would look the same",
        f"{SLOW_OR_STICKING} {FASTER}",
        NoVerdict.SLOW_ACTUATOR,
        numbers_hold=False,
    )


def hidden_by_noise(evidence: DecisionEvidence) -> Decision:
    """No verdict where noise of OP hides a dead band from the archive."""
    return cannot_tell(
        f"the archive shows an S of {percent(evidence.S.value)}, but OP moves to and fro between "
        f"its samples, and a stem with an S of {percent(evidence.S_unseen)} that this shakes "
        "loose would look the same",
        f"{QUIET_OP} {FASTER}",
        NoVerdict.SLOW_SAMPLING,
        numbers_hold=False,
    )


def hunts(swings: OwnSwing, unit_s: float) -> Decision:
    """No verdict on a stem that does not stick, and does not stand where its command stands."""
    return cannot_tell(
        f"the position swings by {percent(swings.percent)} from peak to peak every "
        f"{period(swings.period_s, unit_s)} while OP does not: the positioner hunts, or something "
        "shakes the stem or its transmitter, and S and J would mean nothing beside that",
        "Set the loop to manual, hold OP and watch the stem itself. If it swings on, lower the "
        "positioner's gain and integral action or tune it anew, then check its air supply and the "
        "packing; if the stem rests, look at the bracket of the position transmitter.",
        NoVerdict.POSITION_SWINGS,
        numbers_hold=False,
    )


def pulses_by_itself(pulses: Pulses) -> Decision:
    """No verdict on a stem that goes out and comes back while its command rests."""
    return cannot_tell(
        f"the position goes out and back by {percent(pulses.percent)}, {pulses.count} times, "
        "while OP rests or moves slowly: the positioner hunts or leaks, its "
        "feedback arm is loose, something pushes the stem, or it is the transmitter's noise, so S "
        "and J would mean nothing",
        "Set the loop to manual, hold OP and watch the stem itself. If it moves, check the "
        "positioner's feedback arm and its tuning, its pilot and the air supply; if the stem rests "
        "while the reading moves, look at the position transmitter.",
        NoVerdict.POSITION_SWINGS,
        numbers_hold=False,
    )


def changed_within(changed: ChangeOfStiction, unit_s: float) -> Decision:
    """No verdict on a stem whose S changed at once: no one S is that of the whole recording."""
    return cannot_tell(
        f"S changed: of what was fitted it is about {percent(changed.before)} in the first "
        f"{period(changed.at_s, unit_s)} and about {percent(changed.after)} after that, as by a "
        "repair or a packing that was tightened",
        "Screen both parts of the recording by themselves; what holds now is the later one.",
        NoVerdict.S_CHANGED,
        numbers_hold=False,
    )


def stands_on_a_stop(stop: Stop) -> Decision:
    """No verdict on a stem that follows, but not beyond a place."""
    return cannot_tell(stop.sentence(), STOP_REMEDY, NoVerdict.STANDS_ON_A_STOP)


def why_wide(evidence: DecisionEvidence) -> tuple[str, str]:
    """Why the interval of S is wide, a clause that may be empty, and which recording would help."""
    if evidence.sampling:
        return f": {evidence.sampling}", FASTER
    if evidence.steps > 0.0:
        stepped = f"OP was stepped by {percent(evidence.steps)} at a time"
        return f": {stepped}, which moves a stem that sticks by less as well", FINER
    return "", LONGER
