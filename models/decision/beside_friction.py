"""What acts on the stem beside its friction, in the words of the verdict."""

from __future__ import annotations

from typing import TypeGuard

from stemwatch.models.mismatch.findings import Finding, Mismatch
from stemwatch.models.preparation.own_clock import duration, rate
from stemwatch.models.stickslip import parameters as coordinate
from stemwatch.models.stickslip.fit import StickSlipFit
from stemwatch.models.stickslip.parameters import S_and_J
from stemwatch.models.stickslip.speed_limits import shown_speed_limits

# A delay below this is usual for good valves and is not mentioned.
WORTH_SAYING_S = 0.5
SLOW_PERCENT_PER_S = 10.0
MISREAD = 1.5  # ratio by which S and J alone must be wrong to be mentioned
MISREAD_PERCENT = 0.5
# The gain of the actuator over friction alone on held-out data that makes it certain.
CERTAIN_MEAN, CERTAIN_T = 0.1, 2.4


def beside_friction(fit: StickSlipFit, mismatch: Mismatch | None) -> str:
    """A sentence with a leading blank on the effects that were named, or where nothing else was
    asked or needed, on the actuator of the fit; empty where only friction is certain.
    """
    return _named_effects(mismatch) if _effects_were_asked(mismatch) else _actuator(fit)


def actuator_takes_s(fit: StickSlipFit, mismatch: Mismatch | None) -> float:
    """True seconds of the lag of which ``beside_friction`` tells by the fit; 0 where it tells of
    none.
    """
    lag = _longer_lag(fit)
    if _effects_were_asked(mismatch) or lag < 2.0 * WORTH_SAYING_S or not _actuator(fit):
        return 0.0
    return lag * fit.evaluator.problem.unit_s


def _effects_were_asked(mismatch: Mismatch | None) -> TypeGuard[Mismatch]:
    """Whether more than S, J and the actuator of the fit was asked and could be tested."""
    return mismatch is not None and mismatch.finding is not Finding.NOT_TESTABLE


def _actuator(fit: StickSlipFit) -> str:
    """Lags and speed limits of the fit. Rising and falling are those of the position; which of
    them opens the valve is not known here.
    """
    if fit.hypothesis != "both":
        return ""
    if fit.of_actuator.mean < CERTAIN_MEAN or fit.of_actuator.t < CERTAIN_T:
        return ""
    parts = [*_late(fit), *_limited(fit)]
    if not parts:
        return ""
    alone = _by_S_and_J_alone(S_and_J(fit.naive)[0], S_and_J(fit.candidate)[0])
    return f" Beside friction, {' and '.join(parts)}{alone and f'; {alone}'}."


def _named_effects(mismatch: Mismatch) -> str:
    if not mismatch.effects:
        return ""
    sentence = f" Beside friction: {' '.join(effect.sentence for effect in mismatch.effects)}"
    naive, restated = mismatch.naive.S.value, mismatch.restated.S.value
    if naive is None or restated is None:
        return sentence
    alone = _by_S_and_J_alone(naive, restated)
    return f"{sentence} {alone}." if alone else sentence


def _by_S_and_J_alone(naive: float, S: float) -> str:
    """What S would be without what acts beside friction, where it is far more than ``S``; both in
    percent."""
    if naive > MISREAD * S and naive - S > MISREAD_PERCENT:
        return f"S and J alone would have read S as {naive:.1f} %"
    return ""


def _longer_lag(fit: StickSlipFit) -> float:
    return float(max(fit.candidate[coordinate.LAG_UP_S], fit.candidate[coordinate.LAG_DOWN_S]))


def _late(fit: StickSlipFit) -> list[str]:
    dead_time, unit_s = fit.candidate[coordinate.DEAD_TIME_S], fit.evaluator.problem.unit_s
    parts = []
    if dead_time >= WORTH_SAYING_S:
        late = duration(dead_time, unit_s, ".1f")
        parts.append(f"the command arrives {late} late (or the clocks differ)")
    lag = _longer_lag(fit)
    if lag >= 2.0 * WORTH_SAYING_S:
        parts.append(f"the actuator takes about {duration(lag, unit_s, '.1f')}")
    return parts


def _limited(fit: StickSlipFit) -> list[str]:
    return [
        f"the position moves at no more than {rate(speed, fit.evaluator.problem.unit_s)} {name}"
        for name, speed in shown_speed_limits(fit).items()
        if speed < SLOW_PERCENT_PER_S
    ]
