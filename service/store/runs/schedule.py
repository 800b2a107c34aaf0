"""``ScreeningSchedule``: when which valves are screened, as the plant file says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol


class ScheduledValve(Protocol):
    """A valve as a schedule chooses it."""

    @property
    def id(self) -> str: ...
    @property
    def area(self) -> str: ...
    @property
    def unit(self) -> str: ...


@dataclass(frozen=True, kw_only=True)
class ScreeningSchedule:
    """When which valves are screened, and over which window.

    Either ``cron`` (five fields) or ``every_s``; starts are spread over ``jitter_s`` seconds;
    ``window_s`` is the length of the window before the due instant (``None``: everything).
    Without ``areas``, ``units`` and ``valves`` it is every valve, else those of any of them.
    """

    name: str
    cron: str | None = None
    every_s: float | None = None
    jitter_s: float = 0.0
    window_s: float | None = None
    areas: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    valves: tuple[str, ...] = ()
    enabled: bool = True

    @property
    def named(self) -> tuple[str, ...]:
        """What it is limited to, in words; empty where it screens every valve."""
        return (*self.areas, *(f"unit {unit}" for unit in self.units), *self.valves)

    def takes(self, valve: ScheduledValve) -> bool:
        """Whether it screens ``valve``."""
        return not self.named or (
            valve.area in self.areas or valve.unit in self.units or valve.id in self.valves
        )
