"""``DeviceState``: connection, counts and punctuality of a device, for pages, metrics and logs."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np

_PERCENT = 99.0
_KEPT = 3600  # polls for the percentiles: an hour at 1 s


@dataclass
class DeviceState:
    """Counts since the program started, and the last hour's punctuality.

    ``last_good_us`` is the instant (microseconds since 1970) of the last poll with a good sample;
    ``fault`` why a request of the last poll failed, or empty. ``refused`` are the tags that the
    device refuses to read; once known, that is no fault of a poll.
    """

    name: str
    link: str
    connected: bool = False
    fault: str = ""
    last_good_us: int | None = None
    polls: int = 0
    good: int = 0
    bad: int = 0
    missed: int = 0
    reconnects: int = 0
    refused: tuple[str, ...] = ()
    late_s: deque[float] = field(default_factory=lambda: deque(maxlen=_KEPT), repr=False)
    took_s: deque[float] = field(default_factory=lambda: deque(maxlen=_KEPT), repr=False)

    def lateness_s(self) -> float | None:
        """Seconds from a poll's instant to its last answer, of 99 in 100 at most; ``None``
        before the first poll."""
        return _percentile(self.late_s)

    def duration_s(self) -> float | None:
        """Seconds that a poll took, of 99 in 100 at most; ``None`` before the first one."""
        return _percentile(self.took_s)


def _percentile(values: deque[float]) -> float | None:
    snapshot = list(values)  # at once: another thread may be adding to it
    return float(np.percentile(snapshot, _PERCENT)) if snapshot else None
