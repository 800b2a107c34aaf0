"""``ScreeningSchedule``: what is screened when. Made from a plant file without a database."""

from __future__ import annotations

from dataclasses import dataclass

FROM_FILE = "plant.toml"


@dataclass(frozen=True, kw_only=True)
class ScreeningSchedule:
    """When which valves are screened, and over how much time.

    Either ``cron`` (five fields) or ``every_s``; ``jitter_s`` spreads the beginnings over so many
    seconds; ``window_s`` is how much time before the due instant is looked at (``None``: all).
    ``areas`` and ``valves`` both empty mean every valve.
    """

    name: str
    cron: str | None = None
    every_s: float | None = None
    jitter_s: float = 0.0
    window_s: float | None = None
    areas: tuple[str, ...] = ()
    valves: tuple[str, ...] = ()
    enabled: bool = True
    origin: str = FROM_FILE
