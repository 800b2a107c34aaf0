"""``ClockWatch``: notices that the computer's clock was set, and since when it has gone evenly.

Silence and age are differences of times. After a step of hours a device that answers would look
silent, and after one of months every sample too old to keep.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from datetime import UTC, datetime, timedelta

log = logging.getLogger(__name__)

STEP = timedelta(seconds=60)  # less is the drift of a clock, or a machine that was held up
TRUSTED_AFTER = timedelta(days=1)
_LONG_OFF = timedelta(days=7)  # since the store was last written to


class ClockWatch:
    """The clock of this computer beside one that nobody sets.

    ``last_noted`` is what the store knew of as the newest when this process began. A clock that is
    behind that, or a week ahead, is doubted: the computer may have started without the right time.
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
        """Since when the clock has gone evenly while this process looked."""
        step = self._ahead() - self._offset
        if abs(step) > STEP:
            direction = "back" if step < timedelta(0) else "ahead"
            log.warning("the computer's clock was set %s by %s", direction, abs(step))
            self._even_since, self._offset = self._wall(), self._ahead()
            self._doubted = True
        return self._even_since

    def trusted(self) -> bool:
        """Whether what cannot be undone may be done by this clock: it was neither set nor in doubt
        for a day."""
        even = self._wall() - self.even_since()
        self._doubted = self._doubted and even < TRUSTED_AFTER
        return not self._doubted

    def _ahead(self) -> timedelta:
        return self._wall() - datetime.fromtimestamp(0, UTC) - timedelta(seconds=self._steady_s())
