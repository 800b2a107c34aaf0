"""``Wear``: a valve that gets worse while the plant runs."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from stemwatch.models.studies.simulator import PlantLoop, SimulatedValve

_SHORTEST_S = 10.0  # shortest stretch: a nearer change of the wear's slope is ignored


@dataclass(frozen=True, kw_only=True)
class Wear:
    """S and J, as read off the OP-MV loop in percent, grow in a straight line.

    From what the loop's valve shows at first to ``S_percent`` and ``J_percent``, beginning
    ``after_s`` and lasting ``over_s`` seconds of plant time; from then on they stay. Raises
    ``ValueError`` for times that are not positive or a J that friction cannot give (above S).
    """

    S_percent: float
    J_percent: float = 0.0
    after_s: float = 0.0
    over_s: float = 3600.0

    def __post_init__(self) -> None:
        if self.over_s <= 0.0 or self.after_s < 0.0:
            raise ValueError(
                f"wear needs after_s of 0 or more and over_s above 0, received {self.after_s} and "
                f"{self.over_s}"
            )
        if not 0.0 <= self.J_percent <= self.S_percent:
            raise ValueError(
                f"wear needs 0 <= J <= S, received S = {self.S_percent} and J = {self.J_percent}"
            )

    def share(self, worn_s: float) -> float:
        """How far the wear has come after ``worn_s`` seconds, 0 to 1."""
        return min(max((worn_s - self.after_s) / self.over_s, 0.0), 1.0)

    def even_for_s(self, worn_s: float) -> float:
        """For how many seconds from ``worn_s`` on the wear keeps its slope; inf where it never
        changes."""
        kinks = (self.after_s, self.after_s + self.over_s)
        seconds_left = [kink - worn_s for kink in kinks if kink - worn_s >= _SHORTEST_S]
        return min(seconds_left, default=math.inf)


def worn(loop: PlantLoop, wear: Wear | None, worn_s: float, length_s: float = 0.0) -> PlantLoop:
    """``loop`` with the valve it has after ``worn_s`` seconds of ``wear``.

    Over the next ``length_s`` seconds its friction grows on: both levels by one factor, so that S
    goes in a straight line to where it is then, and J keeps its share of S.
    """
    if wear is None:
        return loop
    now, then = wear.share(worn_s), wear.share(worn_s + length_s)
    if now == then == 0.0:
        return loop
    valve = _valve(loop.valve, wear, now)
    if now == then or valve.S_read <= 0.0:
        return replace(loop, valve=valve)
    growth = _valve(loop.valve, wear, then).S_read / valve.S_read - 1.0
    return replace(loop, valve=valve, upsets=replace(loop.upsets, growth=growth))


def _valve(new: SimulatedValve, wear: Wear, share: float) -> SimulatedValve:
    """The valve on the way from ``new``, with ``share`` of the wear done."""
    if share == 0.0:
        return new
    return SimulatedValve.showing(
        new.S_read + share * (wear.S_percent - new.S_read),
        new.J_read + share * (wear.J_percent - new.J_read),
        positioner_gain=new.positioner_gain,
        scatter=new.scatter,
        actuator=new.actuator,
    )
