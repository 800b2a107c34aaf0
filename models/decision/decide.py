"""The verdict on a valve from the evidence of its fits: which question is asked first, and what
each answer means.
"""

from __future__ import annotations

from stemwatch.models.decision.decision import Decision, S_text, percent, share_of
from stemwatch.models.decision.decision_evidence import DecisionEvidence
from stemwatch.models.decision.doubts import (
    in_either_range,
    unless_exchanged,
    unless_it_wanders,
    unless_stored_so,
)
from stemwatch.models.decision.no_verdict import (
    FASTER,
    STEPPED,
    cannot_tell,
    changed_within,
    curve_fits_as_well,
    hidden_by_noise,
    hunts,
    neither_follows,
    not_described,
    pulses_by_itself,
    shaken_loose,
    slow_actuator_fits_as_well,
    stands_on_a_stop,
    why_wide,
)
from stemwatch.models.decision.verdicts import by_bound, healthy, sticky, watch
from stemwatch.models.limits import Limits
from stemwatch.models.stickslip.change_of_stiction import ChangeOfStiction
from stemwatch.models.verdict import NoVerdict, Verdict

# Below this gain over a valve without friction a large S is not trusted (held-out log ratio).
FRICTION_MEAN, FRICTION_T = 0.05, 2.0
# From these gains on, friction is certain, however much its slips scatter in time.
BEYOND_DOUBT_MEAN, BEYOND_DOUBT_T = 0.5, 4.0
EXPLAINS_AS_WELL = 2.5  # times the residual of the better of noise and NARX
NEGLIGIBLE_PERCENT = 0.5  # a residual below this is small for a valve whatever its share


def decide(evidence: DecisionEvidence, limits: Limits) -> Decision:
    """The verdict from the evidence of a recording that has no obstacle.

    sticky: even the low end of S reaches the limit, and a valve without friction fits worse on data
    that neither model was fitted to. watch: S itself reaches the lower limit, or the valve has
    moved away from its baseline. healthy: even the high end of S stays below the sticky limit, and
    a free run follows the part that was not fitted, or its residual has a named cause, and the
    position neither swings nor pulses by itself.
    """
    decision = unless_it_wanders(_by_the_stem(evidence, limits), evidence)
    if evidence.stop is None or decision.verdict is Verdict.STICKY:
        return decision
    return stands_on_a_stop(evidence.stop)


def _by_the_stem(evidence: DecisionEvidence, limits: Limits) -> Decision:
    """The verdict by what the stem did off any stop, if its reading is true."""
    if evidence.changed is not None and _matters(evidence.changed, limits):
        return changed_within(evidence.changed, evidence.unit_s)
    unexplained = _unexplained(evidence, limits)
    if unexplained is not None:
        return not_described(unexplained, evidence.sampling)
    fits_better = evidence.friction_mean >= FRICTION_MEAN and evidence.friction_t >= FRICTION_T
    friction = fits_better or evidence.jumps_evident or evidence.rests
    bound = evidence.S.at_least
    if bound is not None:
        return by_bound(evidence, bound, limits, friction=friction)
    S, low, high = evidence.S.value, evidence.S.low, evidence.S.high
    if S is None or low is None or high is None:
        return cannot_tell(evidence.S.reason or "S is not known", "Record more movement.")
    if low >= limits.sticky_S_percent:
        return _large_S(evidence, limits, friction=friction)
    if evidence.may_stick_unseen(limits):
        return shaken_loose(evidence)
    if S >= limits.watch_S_percent:
        return _some_friction(evidence, low, high, limits)
    if _moved_away(evidence, limits):
        cause = (
            f"The stem still follows (S {S_text(evidence)}), but {evidence.baseline_ratio:.1f} "
            "times worse than in its baseline window."
        )
        return watch(evidence, limits, cause, 0.5)
    open_above = _open_above(evidence, S, high, limits)
    return open_above or _moved_otherwise(evidence, limits) or healthy(evidence, limits)


def _open_above(
    evidence: DecisionEvidence, S: float, high: float, limits: Limits
) -> Decision | None:
    """What to say where a small S fits best, but one that sticks cannot be excluded; ``None`` where
    it can.
    """
    because, advice = why_wide(evidence)
    best = f"an S of {percent(S)} fits best"
    decision = cannot_tell(f"{best}, but {percent(high)} cannot be excluded{because}", advice)
    if high >= limits.sticky_S_percent and not evidence.is_hidden(limits):
        return decision
    stored = evidence.both_in or evidence.op_in
    # What the archive leaves open may be enough in the other range that OP may be stored in.
    if evidence.sampling and stored and stored.times * high >= limits.sticky_S_percent:
        return in_either_range(decision, evidence)
    return None


def _matters(changed: ChangeOfStiction, limits: Limits) -> bool:
    """Whether the verdict before the change is another one than after it."""
    least, most = sorted((changed.before, changed.after))
    return least < limits.sticky_S_percent and most >= limits.watch_S_percent


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


def _large_S(evidence: DecisionEvidence, limits: Limits, *, friction: bool) -> Decision:
    """Sticky, unless something without friction fits as well."""
    if evidence.curve_is_enough:
        return curve_fits_as_well(evidence)
    if friction:
        return sticky(evidence, limits)
    return slow_actuator_fits_as_well(evidence)


def _some_friction(evidence: DecisionEvidence, low: float, high: float, limits: Limits) -> Decision:
    """S reaches the watch limit, but its low end is below the sticky one."""
    if evidence.sampling and low < limits.watch_S_percent:
        return cannot_tell(f"S is at most {percent(high)}: {evidence.sampling}", FASTER)
    if high > 3.0 * limits.sticky_S_percent and low < limits.watch_S_percent:
        because, advice = why_wide(evidence)
        between = f"S lies anywhere between {percent(low)} and {percent(high)}"
        return cannot_tell(f"{between}{because}", advice)
    if evidence.curve_is_enough:
        return curve_fits_as_well(evidence)
    if evidence.pulses is not None and evidence.pulses.percent > float(evidence.S.value or 0.0):
        return pulses_by_itself(evidence.pulses)
    share = share_of(evidence.S_draws >= limits.watch_S_percent)
    decision = watch(evidence, limits, f"Some friction: S is {S_text(evidence)}.", share)
    decision = unless_stored_so(decision, evidence, limits.sticky_S_percent)
    return unless_exchanged(decision, evidence)


def _moved_away(evidence: DecisionEvidence, limits: Limits) -> bool:
    """True where the valve differs materially from its baseline window."""
    ratio, residual = evidence.baseline_ratio, evidence.baseline
    if ratio is None or residual is None:
        return False
    return ratio > limits.baseline_ratio_watch and residual.rmse > NEGLIGIBLE_PERCENT


def _moved_otherwise(evidence: DecisionEvidence, limits: Limits) -> Decision | None:
    """No verdict where S is small and something else moves the stem, else ``None``."""
    if evidence.swings is not None and evidence.swings.percent >= limits.watch_S_percent:
        return hunts(evidence.swings, evidence.unit_s)
    if evidence.pulses is not None:
        return pulses_by_itself(evidence.pulses)
    if evidence.is_hidden(limits):
        return hidden_by_noise(evidence)
    if _lag_hides_friction(evidence, limits):
        return neither_follows(evidence)
    not_followed = _not_followed(evidence, limits)
    if not_followed is not None:
        return cannot_tell(not_followed, STEPPED, NoVerdict.NOT_FOLLOWED, numbers_hold=False)
    return None


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
