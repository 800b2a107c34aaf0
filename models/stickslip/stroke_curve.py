"""``StrokeCurve``: the curve from OP to stroke, and a recording read through it.

::

    OP --curve f--> command, percent of travel --actuator--> --stick-slip--> MV

S and J are read from the distance between command and position, so both must be in the same
percent. On many valves they are not: a split range strokes the whole valve with half of OP, an
air-to-close valve counts the other way, a positioner's characteristic or a cam bends the way in
between.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.recording import Floats, Recording, Role, Signal

# By how much J may be wrong either way where the slope is not known.
SLOPE_UNKNOWN = 2.0
NEARLY_LINEAR_PERCENT = 1.5  # of travel, off the chord
LEAST_TRAVEL_PERCENT = 0.5  # less is no curve
# Ranges are set to round numbers; where one begins is known no better than this, percent of OP.
ROUND_PERCENT, NOT_TOLD_PERCENT = 5.0, 1.0


@dataclass(frozen=True)
class StrokeCurve:
    """``travel`` (k,) percent of travel at ``op`` (k,) percent of OP, rising in ``op``.

    Between the knots straight lines, beyond them their ends. ``used`` are the ends of the part of
    OP that a recording used, over which the slope is meant; all of the curve where it is ``None``.
    ``slope_known`` is False where the valve went to and fro between two places only: S in percent
    of OP is then known, how it is shared between the jump and the slope is not. ``remark`` is what
    else people should know of it: that it changed, or that it is an earlier one.
    """

    op: tuple[float, ...]
    travel: tuple[float, ...]
    slope_known: bool = True
    used: tuple[float, float] | None = None
    remark: str = ""

    def command(self, op: Floats) -> Floats:
        """(n,) OP as percent of travel; NaN stays NaN."""
        return np.asarray(np.interp(op, self.op, self.travel), dtype=np.float64)

    def in_op(self, estimate: Estimate, *, is_jump: bool = False) -> Estimate:
        """An estimate in percent of travel as one in percent of OP."""
        if estimate.value is None and estimate.at_least is None:
            return estimate
        scale = 1.0 / abs(self.slope)
        wider = SLOPE_UNKNOWN if is_jump and not self.slope_known else 1.0
        low, high = estimate.low, estimate.high
        return replace(
            estimate,
            value=None if estimate.value is None else scale * estimate.value,
            low=None if low is None else scale * low / wider,
            high=None if high is None else scale * high * wider,
        )

    @property
    def ends(self) -> tuple[float, float, float, float]:
        """OP and travel where the part of OP that was used begins, and where it ends, percent."""
        if self.used is not None:
            begin, end = self.command(np.array(self.used)).tolist()
            if abs(end - begin) >= LEAST_TRAVEL_PERCENT:
                return self.used[0], begin, self.used[1], end
        return self.op[0], self.travel[0], self.op[-1], self.travel[-1]

    @property
    def slope(self) -> float:
        """Percent of travel for a percent of OP, over the part of OP that was used; signed."""
        begin, low, end, high = self.ends
        return (high - low) / (end - begin)

    @property
    def zero(self) -> float:
        """Where the chord meets OP 0 %, percent of travel."""
        begin, low, _, _ = self.ends
        return low - self.slope * begin

    @property
    def bend_percent(self) -> float:
        """How far the curve lies off its chord at most, percent of travel."""
        begin, _, end, _ = self.ends
        knots = np.array(self.op)
        knots = np.concatenate(([begin, end], knots[(knots > begin) & (knots < end)]))
        return float(np.max(np.abs(self.command(knots) - self.zero - self.slope * knots)))

    def sentence(self) -> str:
        """What an engineer should know of it."""
        return f"{self._shape()} {self.remark}".rstrip()

    def _shape(self) -> str:
        begin, low, end, high = self.ends
        seen = f"OP {begin:.0f} to {end:.0f} % brings the position from {low:.0f} to {high:.0f} %"
        if self.bend_percent > NEARLY_LINEAR_PERCENT:
            return f"{seen}, bent by up to {self.bend_percent:.1f} % of travel."
        if not self.slope_known:
            return f"{seen}; it moved between so few places that the curve's slope is not known."
        first = begin - low / self.slope
        first, last = _round(first), _round(first + 100.0 / self.slope)
        return f"{seen}, nearly linear: as if OP {first:.0f} to {last:.0f} % stroked 0 to 100 %."


def _round(op: float) -> float:
    """To the round number that it cannot be told from."""
    near = ROUND_PERCENT * round(op / ROUND_PERCENT)
    return near if abs(op - near) <= NOT_TOLD_PERCENT else op


def with_command(recording: Recording, command: Floats, mv_unit: str | None = None) -> Recording:
    """``recording`` with ``command`` (n,) in place of OP's values."""
    signals = dict(recording.signals)
    op = signals[Role.OP]
    signals[Role.OP] = Signal(command, op.quality, op.tag, op.unit, op.interval_s)
    if mv_unit is not None:
        signals[Role.MV] = replace(signals[Role.MV], unit=mv_unit)
    return replace(recording, signals=signals)


def in_travel(recording: Recording, curve: StrokeCurve | None) -> Recording:
    """``recording`` with the command that its OP stands for; itself where there is no curve."""
    if curve is None:
        return recording
    return with_command(recording, curve.command(recording.op.values))
