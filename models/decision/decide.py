"""The verdict on a valve from the evidence of its fits, with the reason and the next step."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.limits import Limits
from stemwatch.models.mismatch.terms._common import CALIBRATE_FROM_PERCENT, LAG_AS_BUILT_S
from stemwatch.models.preparation.own_clock import duration, period
from stemwatch.models.record_checks.data_quality import Obstacle
from stemwatch.models.record_checks.on_a_stop import STOP_REMEDY, Stop
from stemwatch.models.record_checks.own_swing import OwnSwing
from stemwatch.models.record_checks.pulsing_stem import Pulses
from stemwatch.models.record_checks.wandering_reading import Wander
from stemwatch.models.recording import Bools, Floats
from stemwatch.models.screening_result import Residual
from stemwatch.models.stickslip.change_of_stiction import ChangeOfStiction
from stemwatch.models.stickslip.stored_range import StoredRange
from stemwatch.models.verdict import NoVerdict, Shape, Verdict

# J/S at which one shape ends and the next begins (Choudhury 2005 names them at 0, 1 exactly).
DEADBAND_BELOW = 0.1
NO_OFFSET = (0.85, 1.15)
# Below this gain over a valve without friction a large S is not trusted (held-out log ratio).
FRICTION_MEAN, FRICTION_T = 0.05, 2.0
MOST_CONFIDENCE = 0.99  # bootstrap draws do not cover what no model here describes
EITHER_WAY = 0.5  # confidence where the archive may have stored them otherwise, and S is another
# From these gains on, friction is certain, however much its slips scatter in time.
BEYOND_DOUBT_MEAN, BEYOND_DOUBT_T = 0.5, 4.0
EXPLAINS_AS_WELL = 2.5  # times the residual of the better of noise and NARX
NEGLIGIBLE_PERCENT = 0.5  # a residual below this is small for a valve whatever its share

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
        "The stem jumps past the command, which friction alone cannot do: check the positioner's "
        "tuning (gain too high) and the actuator's size and air supply, then the packing."
    ),
}

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
NOT_THAT_SLOW = (
    "The stem does not stick, but it is slow: unless it was always so, check the air supply, its "
    "tubing and filter, the positioner's output, and the actuator for leaks."
)
QUIET_OP = (
    "Set the loop to manual, so that OP rests, and step it by 1 % and then by 5 %, each step held "
    "until the stem rests: a good stem follows both, a sticking one only the larger."
)
CHECK_TRANSMITTER = (
    "Check the position transmitter: clamp or magnet, terminals and moisture, heat from the bonnet "
    "or the sun. In manual mark the stem and compare its reading hours later."
)
AVERAGED = "have samples archived, or step OP by 1 % in manual and see whether the stem follows."
MORE = " (and {} more, see data quality)"  # obstacles that the sentence does not name


@dataclass(frozen=True, kw_only=True)
class DecisionEvidence:
    """The evidence on one valve from which ``decide`` derives the verdict. S and J in percent of OP
    span.
    """

    S: Estimate
    J: Estimate
    S_draws: Floats  # bootstrap draws of S
    friction_mean: float  # held-out advantage of a model with friction over one without
    friction_t: float
    jumps_evident: bool  # the stem rests and jumps towards its command, as the recording shows
    following: Residual | None  # stick-slip model, resynchronised at each block of time
    typical_percent: float  # 100 (1 - median |residual| / median |MV - median MV|), the same run
    narx: Residual | None
    unseen: Residual | None  # a free run of S and J alone, where the residual has no named cause
    sigma: float  # measurement noise of the position, percent
    slow: str  # a sentence on lags and speed limits beside friction, or empty
    baseline: Residual | None  # the baseline network's, on this window
    baseline_ratio: float | None
    cycling_s: float | None  # period of the loop's regular oscillation, on the record's own clock
    unit_s: float = 1.0  # seconds in the unit of that, see ``own_clock``
    both_in: StoredRange | None = None  # in which OP and position may both be stored, unscaled
    op_in: StoredRange | None = None  # in which OP alone may be stored, unscaled
    sampling: str = ""  # why the sampling is too slow to show how the stem moved, or empty
    swings: OwnSwing | None = None  # of the position alone, without its command
    pulses: Pulses | None = None  # of the stem, which its command does not have
    steps: float = 0.0  # percent by which OP was stepped, where each of its steps moved the stem
    changed: ChangeOfStiction | None = None  # S within the recording, in percent of OP
    curve_is_enough: bool = False  # another curve from OP to stroke fits as well as friction
    leads_s: float = 0.0  # by which the position moves first, where it may be OP itself
    takes_s: float = 0.0  # true seconds of an actuator that ``slow`` tells of, else 0
    without_lag: float = 0.0  # percent: S where a lag was fitted and is left out, else 0
    rests: bool = False  # the archive shows a dead band, which no actuator without friction has
    # percent: S of friction alone, where OP may shake it loose between its samples so that it looks
    # like the slow actuator that was found; else 0
    shaken: float = 0.0
    S_unseen: float = 0.0  # percent: S that may be there, where noise of OP may shake it loose
    # percent: S that may be there, if the archive keeps averages; ``every_s`` seconds from one to
    # the next
    S_averaged: float = 0.0
    every_s: float = 0.0
    wander: Wander | None = None  # of the position reading, where no effect was named
    stop: Stop | None = None  # on which the stem stood, beside which S and J are; unless named

    def may_stick_unseen(self, limits: Limits) -> bool:
        """Whether the slow actuator that was found may be a stem that sticks after all."""
        return self.shaken >= limits.sticky_S_percent

    def is_hidden(self, limits: Limits) -> bool:
        """Whether noise of OP may hide a sticking stem behind the S that is seen."""
        S = self.S.value
        return (
            S is not None
            and S < limits.watch_S_percent
            and (self.S_unseen >= limits.sticky_S_percent)
        )


@dataclass(frozen=True, kw_only=True)
class Decision:
    """The verdict with its reason, the next step, its rank and its confidence."""

    verdict: Verdict
    reason: str
    advice: str
    shape: Shape | None = None
    severity: float = 0.0
    confidence: float | None = None
    no_verdict: NoVerdict | None = None  # why it is undetermined
    numbers_hold: bool = True  # False where S and J do not describe the valve and must not be shown


def shape_of(S: float, J: float) -> Shape:
    """The shape of the OP-MV loop by its ratio J/S."""
    ratio = J / S if S > 0 else 0.0
    if ratio < DEADBAND_BELOW:
        return Shape.DEADBAND
    if ratio < NO_OFFSET[0]:
        return Shape.UNDERSHOOT
    return Shape.NO_OFFSET if ratio <= NO_OFFSET[1] else Shape.OVERSHOOT


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


def _share(draws: Bools) -> float:
    """The share of ``draws`` that are True, at most ``MOST_CONFIDENCE``."""
    return min(float(np.mean(draws)), MOST_CONFIDENCE)


def _percent(value: float | None) -> str:
    return "?" if value is None else f"{value:.1f} %"


def _width(evidence: DecisionEvidence) -> str:
    S = evidence.S
    return f"{_percent(S.value)} ({_percent(S.low)} to {_percent(S.high)})"


def _unexplained(evidence: DecisionEvidence, limits: Limits) -> str | None:
    """Why S and J do not describe this valve, or ``None`` where they do."""
    residual = evidence.following
    beyond_doubt = evidence.friction_mean >= BEYOND_DOUBT_MEAN
    # A better fit than without friction is not enough: the position of another valve is also fitted
    # best by a stem that hardly moves, but no better than by a constant.
    follows = residual is None or residual.fit_percent > 0.0
    if beyond_doubt and evidence.friction_t >= BEYOND_DOUBT_T and follows:
        return None
    if evidence.jumps_evident:
        return None
    if residual is None or residual.rmse <= max(3.0 * evidence.sigma, NEGLIGIBLE_PERCENT):
        return None
    # Breakaways scatter: while a slip is some samples early or late, the residual is a whole jump.
    # A model that is right most of the time and off by one jump in between does describe the stem.
    if max(residual.fit_percent, evidence.typical_percent - 20.0) >= limits.min_fit_percent:
        return None
    best = evidence.sigma
    text = f"friction explains only {max(residual.fit_percent, 0.0):.0f} % of how the stem moves"
    if evidence.narx is not None:
        best = max(best, evidence.narx.rmse)
        if evidence.narx.fit_percent > residual.fit_percent + 10.0:
            text += f", while a neural network follows {evidence.narx.fit_percent:.0f} %"
    return text if residual.rmse > EXPLAINS_AS_WELL * best or residual.fit_percent < 20 else None


def _sticky(evidence: DecisionEvidence, limits: Limits) -> Decision:
    S, J = float(evidence.S.value or 0.0), float(evidence.J.value or 0.0)
    shape = shape_of(S, J)
    jump = f", then jumps {_percent(J)}" if shape is not Shape.DEADBAND else " and then follows"
    cycle = ""
    if evidence.cycling_s is not None:
        cycle = f"; the loop cycles every {period(evidence.cycling_s, evidence.unit_s)}"
    decision = Decision(
        verdict=Verdict.STICKY,
        reason=(
            f"The stem sticks: after a reversal OP must move {_width(evidence)} before the stem "
            f"lets go{jump}{cycle}.{evidence.slow}"
        ),
        advice=NEXT[shape],
        shape=shape,
        severity=50.0 + 50.0 * float(1.0 - np.exp(-(S + J) / 8.0)),
        confidence=_share(evidence.S_draws >= limits.sticky_S_percent),
    )
    # Sticky in either range; but S and J are not those of the valve.
    return decision if evidence.op_in is None else _in_either_range(decision, evidence)


def _not_described(unexplained: str, sampling: str) -> Decision:
    """No verdict where S and J do not describe the valve; ``sampling`` names slow sampling."""
    if sampling:
        return _cannot_tell(
            f"{unexplained}: {sampling}", FASTER, NoVerdict.SLOW_SAMPLING, numbers_hold=False
        )
    return _cannot_tell(
        f"{unexplained}, so S and J would mean nothing",
        "Something else moves this stem (positioner, actuator, air supply, the reading "
        "itself): look at the residual plots, and do a stroke test with small steps.",
        NoVerdict.FRICTION_DOES_NOT_EXPLAIN,
        numbers_hold=False,
    )


def _large_S(evidence: DecisionEvidence, limits: Limits, *, friction: bool) -> Decision:
    """Sticky, unless something without friction fits as well."""
    if evidence.curve_is_enough:
        return _curve_fits_as_well(evidence)
    if friction:
        return _sticky(evidence, limits)
    return _cannot_tell(
        f"S of {_width(evidence)} would fit, but a slow actuator without friction fits as well",
        SLOW_OR_STICKING,
        NoVerdict.SLOW_ACTUATOR,
    )


def _curve_fits_as_well(evidence: DecisionEvidence) -> Decision:
    """No verdict where what a curve from OP to stroke is off by looks like a dead band."""
    return _cannot_tell(
        f"S of {_width(evidence)} would fit, but a curve from OP to stroke that is a little "
        "different, without friction, fits as well",
        f"Give the valve's curve in the plant file if it is known. {LONGER}",
    )


def _by_bound(
    evidence: DecisionEvidence, bound: float, limits: Limits, *, friction: bool
) -> Decision:
    """The decision where only a lower bound of S is known: sticky if the bound is, else none."""
    if bound < limits.sticky_S_percent or not friction:
        reason = f"S is at least {_percent(bound)}, and may be much more: {evidence.S.reason}"
        return _cannot_tell(reason, FASTER)
    return Decision(
        verdict=Verdict.STICKY,
        reason=(
            f"The stem sticks: after a reversal OP must move at least {_percent(bound)} before "
            f"the stem lets go. How far is not known: {evidence.S.reason}.{evidence.slow}"
        ),
        advice=f"{NEXT[Shape.UNDERSHOOT]} {FASTER}",
        severity=50.0 + 50.0 * float(1.0 - np.exp(-bound / 8.0)),
        confidence=_share(evidence.S_draws >= limits.sticky_S_percent),
    )


def _watch(evidence: DecisionEvidence, limits: Limits, reason: str, confidence: float) -> Decision:
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


def _some_friction(evidence: DecisionEvidence, low: float, high: float, limits: Limits) -> Decision:
    """S reaches the watch limit, but its low end is below the sticky one."""
    if evidence.sampling and low < limits.watch_S_percent:
        return _cannot_tell(f"S is at most {_percent(high)}: {evidence.sampling}", FASTER)
    if high > 3.0 * limits.sticky_S_percent and low < limits.watch_S_percent:
        because, advice = _why_wide(evidence)
        between = f"S lies anywhere between {_percent(low)} and {_percent(high)}"
        return _cannot_tell(f"{between}{because}", advice)
    if evidence.curve_is_enough:
        return _curve_fits_as_well(evidence)
    if evidence.pulses is not None and evidence.pulses.percent > float(evidence.S.value or 0.0):
        return _pulses(evidence.pulses)
    share = _share(evidence.S_draws >= limits.watch_S_percent)
    decision = _watch(evidence, limits, f"Some friction: S is {_width(evidence)}.", share)
    decision = _unless_stored_so(decision, evidence, limits.sticky_S_percent)
    return _unless_exchanged(decision, evidence)


def _why_wide(evidence: DecisionEvidence) -> tuple[str, str]:
    """Why the interval of S is wide, a clause that may be empty, and which recording would help."""
    if evidence.sampling:
        return f": {evidence.sampling}", FASTER
    if evidence.steps > 0.0:
        stepped = f"OP was stepped by {_percent(evidence.steps)} at a time"
        return f": {stepped}, which moves a stem that sticks by less as well", FINER
    return "", LONGER


def _not_followed(evidence: DecisionEvidence, limits: Limits) -> str | None:
    """Why a small S does not prove this valve healthy, or ``None`` where it does.

    S is small, but its free run is far from the part that was not fitted, and the residual has no
    named cause: something else moves the stem, or OP is not its command.
    """
    residual = evidence.unseen
    if residual is None or residual.fit_percent >= limits.min_fit_percent:
        return None
    if residual.rmse <= max(3.0 * evidence.sigma, NEGLIGIBLE_PERCENT):
        return None
    return (
        "a free run with S and J does not follow the part of the recording that was not fitted "
        f"(fit {residual.fit_percent:.0f} %), and nothing that would explain it was found"
    )


def _lag_hides_friction(evidence: DecisionEvidence, limits: Limits) -> bool:
    """Whether a lag took the place of a friction that would be sticky, and does not follow: where
    OP moves between its samples, a stem that creeps behind it looks like a slow one."""
    residual = evidence.following
    if residual is None or evidence.without_lag < limits.sticky_S_percent:
        return False
    return residual.rmse > max(3.0 * evidence.sigma, NEGLIGIBLE_PERCENT)


def _healthy(evidence: DecisionEvidence, limits: Limits) -> Decision:
    text = f"The stem follows: S is {_width(evidence)}.{evidence.slow}"
    advice = "Nothing to do at the valve."
    if evidence.cycling_s is not None:
        cycle_text = period(evidence.cycling_s, evidence.unit_s)
        text += f" The loop oscillates nevertheless, every {cycle_text}."
        advice = "Look for the cause in the controller's tuning or in a disturbance upstream."
    if evidence.takes_s > LAG_AS_BUILT_S:
        first = "Nothing to do at the packing" if evidence.cycling_s is None else advice.rstrip(".")
        advice = f"{first}. {NOT_THAT_SLOW}"
    decision = Decision(
        verdict=Verdict.HEALTHY,
        reason=text,
        advice=advice,
        severity=10.0 * min(float(evidence.S.value or 0.0) / limits.watch_S_percent, 1.0),
        confidence=_share(evidence.S_draws < limits.sticky_S_percent),
    )
    decision = _unless_stored_so(decision, evidence, limits.watch_S_percent)
    decision = _unless_averaged(decision, evidence, limits)
    return _unless_exchanged(decision, evidence)


def _unless_averaged(decision: Decision, evidence: DecisionEvidence, limits: Limits) -> Decision:
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
            f"them may hide an S of up to {_percent(hidden)}."
        ),
        advice=f"If it keeps averages: {AVERAGED} {decision.advice}",
        confidence=min(confidence, EITHER_WAY),
    )


def _unless_stored_so(decision: Decision, evidence: DecisionEvidence, limit: float) -> Decision:
    """``decision`` with half the confidence at most, and with the ranges to give, where OP, or OP
    and position, may be stored in another range, in which S reaches ``limit``, percent.
    """
    stored, S = evidence.both_in or evidence.op_in, float(evidence.S.value or 0.0)
    if stored is None or decision.confidence is None or stored.times * S < limit:
        return decision
    doubted = replace(decision, confidence=min(decision.confidence, EITHER_WAY))
    return _in_either_range(doubted, evidence)


def _in_either_range(decision: Decision, evidence: DecisionEvidence) -> Decision:
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
            f"{decision.reason} {seen} stored in {stored.unit}, S is {_percent(stored.times * S)}."
        ),
        advice=f"{ask} in the plant file, else low = 0, high = 100. {decision.advice}",
    )


def _unless_exchanged(decision: Decision, evidence: DecisionEvidence) -> Decision:
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


def _moved_away(evidence: DecisionEvidence, limits: Limits) -> bool:
    """True where the valve differs materially from its baseline window."""
    ratio, residual = evidence.baseline_ratio, evidence.baseline
    if ratio is None or residual is None:
        return False
    return ratio > limits.baseline_ratio_watch and residual.rmse > NEGLIGIBLE_PERCENT


def _moved_otherwise(evidence: DecisionEvidence, limits: Limits) -> Decision | None:
    """No verdict where S is small and something else moves the stem, else ``None``."""
    if evidence.swings is not None and evidence.swings.percent >= limits.watch_S_percent:
        return _hunts(evidence.swings, evidence.unit_s)
    if evidence.pulses is not None:
        return _pulses(evidence.pulses)
    if evidence.is_hidden(limits):
        return _hidden_by_noise(evidence)
    if _lag_hides_friction(evidence, limits):
        assert evidence.following is not None
        return _cannot_tell(
            "a slow actuator without friction would explain how the stem lags behind OP, and so "
            f"would an S of {_percent(evidence.without_lag)}; neither follows the part of the "
            "recording that was not fitted (on average "
            f"{_percent(evidence.following.rmse)} of travel off)",
            f"{SLOW_OR_STICKING} {FASTER}",
            NoVerdict.SLOW_ACTUATOR,
            numbers_hold=False,
        )
    not_followed = _not_followed(evidence, limits)
    if not_followed is not None:
        return _cannot_tell(not_followed, STEPPED, NoVerdict.NOT_FOLLOWED, numbers_hold=False)
    return None


def _shaken_loose(evidence: DecisionEvidence) -> Decision:
    """No verdict where friction and a slow actuator look alike from sample to sample."""
    return _cannot_tell(
        "the stem follows OP as if the actuator took many seconds, and few are that slow; a stem "
        f"with an S of {_percent(evidence.shaken)} that OP shakes loose between two samples of the "
        "archive would look the same",
        f"{SLOW_OR_STICKING} {FASTER}",
        NoVerdict.SLOW_ACTUATOR,
        numbers_hold=False,
    )


def _hidden_by_noise(evidence: DecisionEvidence) -> Decision:
    """No verdict where noise of OP hides a dead band from the archive."""
    return _cannot_tell(
        f"the archive shows an S of {_percent(evidence.S.value)}, but OP moves to and fro between "
        f"its samples, and a stem with an S of {_percent(evidence.S_unseen)} that this shakes "
        "loose would look the same",
        f"{QUIET_OP} {FASTER}",
        NoVerdict.SLOW_SAMPLING,
        numbers_hold=False,
    )


def _hunts(swings: OwnSwing, unit_s: float) -> Decision:
    """No verdict on a stem that does not stick, and does not stand where its command stands."""
    return _cannot_tell(
        f"the position swings by {_percent(swings.percent)} from peak to peak every "
        f"{period(swings.period_s, unit_s)} while OP does not: the positioner hunts, or something "
        "shakes the stem or its transmitter, and S and J would mean nothing beside that",
        "Set the loop to manual, hold OP and watch the stem itself. If it swings on, lower the "
        "positioner's gain and integral action or tune it anew, then check its air supply and the "
        "packing; if the stem rests, look at the bracket of the position transmitter.",
        NoVerdict.POSITION_SWINGS,
        numbers_hold=False,
    )


def _pulses(pulses: Pulses) -> Decision:
    """No verdict on a stem that goes out and comes back while its command rests."""
    return _cannot_tell(
        f"the position goes out and back by {_percent(pulses.percent)}, {pulses.count} times, "
        "while OP rests or moves slowly: the positioner hunts or leaks, its "
        "feedback arm is loose, something pushes the stem, or it is the transmitter's noise, so S "
        "and J would mean nothing",
        "Set the loop to manual, hold OP and watch the stem itself. If it moves, check the "
        "positioner's feedback arm and its tuning, its pilot and the air supply; if the stem rests "
        "while the reading moves, look at the position transmitter.",
        NoVerdict.POSITION_SWINGS,
        numbers_hold=False,
    )


def _matters(changed: ChangeOfStiction, limits: Limits) -> bool:
    """Whether the verdict before the change is another one than after it."""
    least, most = sorted((changed.before, changed.after))
    return least < limits.sticky_S_percent and most >= limits.watch_S_percent


def _changed_within(changed: ChangeOfStiction, unit_s: float) -> Decision:
    """No verdict on a stem whose S changed at once: no one S is that of the whole recording."""
    return _cannot_tell(
        f"S changed: of what was fitted it is about {_percent(changed.before)} in the first "
        f"{period(changed.at_s, unit_s)} and about {_percent(changed.after)} after that, as by a "
        "repair or a packing that was tightened",
        "Screen both parts of the recording by themselves; what holds now is the later one.",
        NoVerdict.S_CHANGED,
        numbers_hold=False,
    )


def _cannot_tell(
    reason: str,
    advice: str,
    no_verdict: NoVerdict = NoVerdict.S_UNCERTAIN,
    *,
    numbers_hold: bool = True,
) -> Decision:
    return Decision(
        verdict=Verdict.UNDETERMINED,
        reason=f"Cannot tell: {reason}.",
        advice=advice,
        severity=20.0,
        no_verdict=no_verdict,
        numbers_hold=numbers_hold,
    )


def _unless_it_wanders(decision: Decision, evidence: DecisionEvidence) -> Decision:
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
    return _cannot_tell(
        f"{said}, so S and J would mean nothing",
        CHECK_TRANSMITTER,
        NoVerdict.READING_WANDERS,
        numbers_hold=False,
    )


def _stands(stop: Stop) -> Decision:
    """No verdict on a stem that follows, but not beyond a place."""
    return _cannot_tell(stop.sentence(), STOP_REMEDY, NoVerdict.STANDS_ON_A_STOP)


def decide(evidence: DecisionEvidence, limits: Limits) -> Decision:
    """The verdict from the evidence of a recording that has no obstacle.

    sticky: even the low end of S reaches the limit, and a valve without friction fits worse on data
    that neither model was fitted to. watch: S itself reaches the lower limit, or the valve has
    moved away from its baseline. healthy: even the high end of S stays below the sticky limit, and
    a free run follows the part that was not fitted, or its residual has a named cause, and the
    position neither swings nor pulses by itself.
    """
    decision = _unless_it_wanders(_by_the_stem(evidence, limits), evidence)
    if evidence.stop is None or decision.verdict is Verdict.STICKY:
        return decision
    return _stands(evidence.stop)


def _by_the_stem(evidence: DecisionEvidence, limits: Limits) -> Decision:
    """The verdict by what the stem did off any stop, if its reading is true."""
    if evidence.changed is not None and _matters(evidence.changed, limits):
        return _changed_within(evidence.changed, evidence.unit_s)
    unexplained = _unexplained(evidence, limits)
    if unexplained is not None:
        return _not_described(unexplained, evidence.sampling)
    fits_better = evidence.friction_mean >= FRICTION_MEAN and evidence.friction_t >= FRICTION_T
    friction = fits_better or evidence.jumps_evident or evidence.rests
    bound = evidence.S.at_least
    if bound is not None:
        return _by_bound(evidence, bound, limits, friction=friction)
    S, low, high = evidence.S.value, evidence.S.low, evidence.S.high
    if S is None or low is None or high is None:
        return _cannot_tell(evidence.S.reason or "S is not known", "Record more movement.")
    if low >= limits.sticky_S_percent:
        return _large_S(evidence, limits, friction=friction)
    if evidence.may_stick_unseen(limits):
        return _shaken_loose(evidence)
    if S >= limits.watch_S_percent:
        return _some_friction(evidence, low, high, limits)
    if _moved_away(evidence, limits):
        cause = (
            f"The stem still follows (S {_width(evidence)}), but {evidence.baseline_ratio:.1f} "
            "times worse than in its baseline window."
        )
        return _watch(evidence, limits, cause, 0.5)
    if high >= limits.sticky_S_percent:
        because, advice = _why_wide(evidence)
        return _cannot_tell(
            f"S is probably {_percent(S)} but may be {_percent(high)}{because}", advice
        )
    return _moved_otherwise(evidence, limits) or _healthy(evidence, limits)
