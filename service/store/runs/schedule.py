"""``ScreeningSchedule``: when which valves are screened, as the plant file says."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class ScreeningSchedule:
    """When which valves are screened, and over which window.

    Either ``cron`` (five fields) or ``every_s``; starts are spread over ``jitter_s`` seconds;
    ``window_s`` is the length of the window before the due instant (``None``: everything).
    Empty ``areas`` and ``valves`` mean every valve.
    """

    name: str
    cron: str | None = None
    every_s: float | None = None
    jitter_s: float = 0.0
    window_s: float | None = None
    areas: tuple[str, ...] = ()
    valves: tuple[str, ...] = ()
    enabled: bool = True
