"""``DemoTiming``: intervals of polls and runs, windows, and wear of the demo."""

from __future__ import annotations

from dataclasses import dataclass

from stemwatch.service.modbus_plant import Wear

FASTEST = 4.0  # at 4 the plant is polled every 0.1 s, the shortest interval allowed
_EVERY_S, _WINDOW_S, _SCHEDULE_S = 0.4, 150.0, 60.0
# Of fewer polls a new valve gets no verdict yet, or no baseline (a test holds this).
_SHORTEST_S = 140.0
_SHORTEST_SCHEDULE_S = 10.0


@dataclass(frozen=True, kw_only=True)
class DemoTiming:
    """The demo's times. ``speed`` is the simulated time per real time.

    At 1 the loops run in real time; only wear takes minutes instead of months. In simulated seconds
    everything but the schedule is the same at every speed. Raises ``ValueError`` for a speed
    outside 1 to 4.
    """

    speed: float = 1.0

    def __post_init__(self) -> None:
        if not 1.0 <= self.speed <= FASTEST:
            raise ValueError(
                f"the demo runs 1 to {FASTEST:g} times as fast as the clock, received {self.speed}"
            )

    @property
    def every_s(self) -> float:
        """Real seconds between two polls."""
        return round(_EVERY_S / self.speed, 3)

    @property
    def window_s(self) -> float:
        """Length of a run's window in real seconds."""
        return _WINDOW_S / self.speed

    @property
    def schedule_s(self) -> float:
        """Real seconds from one run to the next."""
        return max(_SCHEDULE_S / self.speed, _SHORTEST_SCHEDULE_S)

    @property
    def shortest_s(self) -> float:
        """Shortest recording for a verdict, in real seconds."""
        return _SHORTEST_S / self.speed

    @property
    def wear(self) -> Wear:
        """The wear of the valve, in simulated seconds: from healthy to sticking."""
        return Wear(S_percent=5.0, J_percent=2.0, over_s=240.0)

    @property
    def alert_after_s(self) -> float:
        """Usual time from the start of wear to the alert, in simulated seconds."""
        return _WINDOW_S + 2.0 * _SCHEDULE_S
