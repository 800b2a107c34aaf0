"""``Wear``: a valve that gets worse while the plant runs."""

from __future__ import annotations

from dataclasses import dataclass, replace

from stemwatch.models.plant import PlantLoop, Valve


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


def worn(loop: PlantLoop, wear: Wear | None, worn_s: float) -> PlantLoop:
    """``loop`` with the valve it has after ``worn_s`` seconds of ``wear``."""
    share = 0.0 if wear is None else wear.share(worn_s)
    if wear is None or share == 0.0:
        return loop
    old = loop.valve
    valve = Valve.showing(
        old.S_read + share * (wear.S_percent - old.S_read),
        old.J_read + share * (wear.J_percent - old.J_read),
        positioner_gain=old.positioner_gain,
        scatter=old.scatter,
        actuator=old.actuator,
    )
    return replace(loop, valve=valve)
