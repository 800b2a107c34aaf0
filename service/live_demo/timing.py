"""``DemoTiming``: how often the demo polls and screens, and when its valve wears."""

from __future__ import annotations

from dataclasses import dataclass

from stemwatch.service.modbus_plant import Wear

FASTEST = 4.0  # at 4 the plant is polled every 0.1 s, and no device is polled faster
_EVERY_S, _WINDOW_S, _SCHEDULE_S, _SHORTEST_S = 0.4, 150.0, 60.0, 140.0
_SHORTEST_SCHEDULE_S = 10.0


@dataclass(frozen=True, kw_only=True)
class DemoTiming:
    """The demo's times. ``speed`` is how many seconds of the plant pass in one of the clock.

    At 1 the loops are as quick as they would be; only the wear is not, which takes minutes and not
    months. In seconds of the plant everything but the schedule is the same at every speed. Raises
    ``ValueError`` for a speed that is not from 1 to 4.
    """

    speed: float = 1.0

    def __post_init__(self) -> None:
        if not 1.0 <= self.speed <= FASTEST:
            raise ValueError(
                f"the demo runs 1 to {FASTEST:g} times as fast as the clock, received {self.speed}"
            )

    @property
    def every_s(self) -> float:
        """Seconds of the clock between two polls."""
        return round(_EVERY_S / self.speed, 3)

    @property
    def window_s(self) -> float:
        """Seconds of the clock that a run looks at."""
        return _WINDOW_S / self.speed

    @property
    def schedule_s(self) -> float:
        """Seconds of the clock from one run to the next."""
        return max(_SCHEDULE_S / self.speed, _SHORTEST_SCHEDULE_S)

    @property
    def shortest_s(self) -> float:
        """Seconds of the clock that a verdict needs at least."""
        return _SHORTEST_S / self.speed

    @property
    def wear(self) -> Wear:
        """How the valve wears, in seconds of the plant: from a stem that follows to one that
        sticks."""
        return Wear(S_percent=5.0, J_percent=2.0, over_s=240.0)

    @property
    def alert_after_s(self) -> float:
        """Seconds of the plant from the beginning of the wear to the alert, as a rule."""
        return _WINDOW_S + 2.0 * _SCHEDULE_S
