"""The controller's law from a recording: OP from set point and PV, by least squares.

``OP = c + Kc (b SP - PV) + Kc/Ti integral(SP - PV) + Kc Td change of PV``, the parallel form that
every PI and PID controller has on the clock of a historian (Astrom and Hagglund 1995, *PID
Controllers*). The residual of OP is kept and replayed, so that feedforward, rounding and an
operator's steps stay.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stemwatch.models.recording import Floats

LEAST_EXPLAINED = 0.9  # of OP's variance: below it the loop is in manual, or another law moves OP


@dataclass(frozen=True, kw_only=True)
class ControllerLaw:
    """``gain`` Kc in percent of OP for a unit of PV, ``gain_sp`` the same for the set point,
    ``per_sample`` OP for a unit of error and sample, ``gain_change`` for a unit of PV's change from
    one sample to the next; ``rest`` (n,) the residual of OP, percent; ``explained`` the share of
    OP's variance, 0 to 1.
    """

    gain: float
    gain_sp: float
    per_sample: float
    gain_change: float
    rest: Floats
    explained: float

    def reset_s(self, interval_s: float) -> float | None:
        """The reset time Ti in seconds; ``None`` without integral action."""
        if self.per_sample * self.gain <= 0.0:
            return None
        return self.gain / self.per_sample * interval_s


def controller_law(op: Floats, pv: Floats, sp: Floats) -> ControllerLaw | str:
    """The law of ``op``, ``pv`` and ``sp`` (n,), without holes; or a sentence on why
    there is none.
    """
    if float(np.ptp(op)) == 0.0:
        return "OP did not move"
    moves = float(np.ptp(sp)) > 0.0
    change = np.diff(pv, prepend=pv[0])
    integral = np.cumsum(sp - pv)
    columns = [np.ones_like(op), -pv, integral, change, *([sp] if moves else [])]
    design = np.stack(columns, axis=1)
    scale = np.maximum(np.abs(design).max(axis=0), 1e-12)
    weights = np.linalg.lstsq(design / scale, op, rcond=None)[0] / scale
    explained = 1.0 - float(np.var(op - design @ weights) / np.var(op))
    if explained < LEAST_EXPLAINED:
        return (
            f"OP follows set point and PV by a PI or PID law for only "
            f"{100.0 * max(explained, 0.0):.0f} % of what it does (the loop may be in manual)"
        )
    _, gain, per_sample, gain_change = (float(weight) for weight in weights[:4])
    gain_sp = float(weights[4]) if moves else gain
    predicted = gain_sp * sp - gain * pv + per_sample * integral + gain_change * change
    return ControllerLaw(
        gain=gain,
        gain_sp=gain_sp,
        per_sample=per_sample,
        gain_change=gain_change,
        rest=op - predicted,
        explained=explained,
    )
