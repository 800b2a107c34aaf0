"""``ClockWatch``: notices that the computer's clock was set, and since when it has run steadily.

Silence and age are differences of times. After a step of hours a device that answers would look
silent, and after one of months every sample too old to keep.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from datetime import UTC, datetime, timedelta

log = logging.getLogger(__name__)

STEP = timedelta(seconds=60)  # a smaller step is clock drift, or a machine that was suspended
TRUSTED_AFTER = timedelta(days=1)
_LONG_OFF = timedelta(days=7)  # since the store was last written to


class ClockWatch:
    """Compares the computer's clock with a monotonic clock, which nobody sets.

    ``last_noted`` is the newest time in the store when this process began. A clock that is behind
    it, or a week ahead, is not trusted: the computer may have started with a wrong time.
    """

    def __init__(
        self,
        last_noted: datetime | None = None,
        *,
        wall: Callable[[], datetime] = lambda: datetime.now(UTC),
        steady_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._wall, self._steady_s = wall, steady_s
        self._even_since, self._offset = wall(), self._ahead()
        self._doubted = last_noted is not None and not (
            -STEP <= self._even_since - last_noted <= _LONG_OFF
        )

    def even_since(self) -> datetime:
        """Since when the clock has run steadily, as far as this process observed it."""
        step = self._ahead() - self._offset
        if abs(step) > STEP:
            direction = "back" if step < timedelta(0) else "ahead"
            log.warning("the computer's clock was set %s by %s", direction, abs(step))
            self._even_since, self._offset = self._wall(), self._ahead()
            self._doubted = True
        return self._even_since

    def trusted(self) -> bool:
        """Whether irreversible work may rely on this clock: for a day it was neither set nor in
        doubt."""
        even = self._wall() - self.even_since()
        self._doubted = self._doubted and even < TRUSTED_AFTER
        return not self._doubted

    def _ahead(self) -> timedelta:
        return self._wall() - datetime.fromtimestamp(0, UTC) - timedelta(seconds=self._steady_s())
