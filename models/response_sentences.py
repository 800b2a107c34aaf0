"""What stands between command and stem beside friction, in words a fitter can use."""

from __future__ import annotations

from stemwatch.models.mismatch.findings import Mismatch
from stemwatch.models.own_clock import duration, rate
from stemwatch.models.stickslip import parameters as coordinate
from stemwatch.models.stickslip.actuator import shown_speed_limits
from stemwatch.models.stickslip.fit import StickSlipFit

# Less than this is how good valves are, and not worth a word.
WORTH_SAYING_S = 0.5
SLOW_PERCENT_PER_S = 10.0
MISREAD = 1.5  # how far S and J alone must be off
MISREAD_PERCENT = 0.5
# The gain of the actuator over friction alone on held-out data that makes it certain.
CERTAIN_MEAN, CERTAIN_T = 0.1, 2.4


def slowness(fit: StickSlipFit) -> str:
    """A sentence with a blank before it, or nothing where only friction is certain.

    Rising and falling are those of the position; which of them opens the valve is not known here.
    """
    if fit.hypothesis != "both":
        return ""
    if fit.of_actuator.mean < CERTAIN_MEAN or fit.of_actuator.t < CERTAIN_T:
        return ""
    parts = [*_late(fit), *_limited(fit)]
    if not parts:
        return ""
    return f" Beside friction, {' and '.join(parts)}{_misread(fit)}."


def beside_friction(left_out: Mismatch) -> str:
    """What the mismatch named, a sentence with a blank before it, or nothing."""
    if not left_out.effects:
        return ""
    told = f" Beside friction: {left_out.effects[0].sentence}"
    more = len(left_out.effects) - 1
    if more:
        told += f" And {more} more, see what S and J leave out."
    naive, restated = left_out.naive.S.value, left_out.restated.S.value
    if naive is None or restated is None:
        return told
    if naive > MISREAD * restated and naive - restated > MISREAD_PERCENT:
        told += f" S and J alone would have read S as {naive:.1f} %."
    return told


def _late(fit: StickSlipFit) -> list[str]:
    c, unit_s = fit.candidate, fit.evaluator.problem.unit_s
    parts = []
    if c[coordinate.DEAD_TIME_S] >= WORTH_SAYING_S:
        parts.append(
            f"the command arrives {duration(c[coordinate.DEAD_TIME_S], unit_s, '.1f')} late (or "
            "the clocks differ)"
        )
    lag = max(c[coordinate.LAG_UP_S], c[coordinate.LAG_DOWN_S])
    if lag >= 2.0 * WORTH_SAYING_S:
        parts.append(f"the actuator takes about {duration(lag, unit_s, '.1f')}")
    return parts


def _limited(fit: StickSlipFit) -> list[str]:
    return [
        f"the position moves at no more than {rate(speed, fit.evaluator.problem.unit_s)} {name}"
        for name, speed in shown_speed_limits(fit).items()
        if speed < SLOW_PERCENT_PER_S
    ]


def _misread(fit: StickSlipFit) -> str:
    naive = float(fit.naive[coordinate.S_PERCENT])
    if naive > MISREAD * fit.S and naive - fit.S > MISREAD_PERCENT:
        return f"; S and J alone would have read S as {naive:.1f} %"
    return ""
