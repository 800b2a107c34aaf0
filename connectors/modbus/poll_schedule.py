"""``PollSchedule``: the instants at which a device is polled, and what happens where one passes."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from dataclasses import dataclass

# A poll that begins later than this after its instant would carry a wrong time.
LATEST_S = 0.25
_MICRO = 1_000_000


@dataclass(frozen=True)
class Slot:
    """One instant of the schedule, and what happened before it.

    ``missed_us`` are the instants that passed unused since the last slot; ``clock_went_back`` that
    the computer's clock was set back, so that instants come a second time.
    """

    at_us: int
    missed_us: range = range(0)
    clock_went_back: bool = False


class PollSchedule:
    """Instants at whole multiples of ``every_s`` since 1970 UTC.

    They do not depend on when the program started, so samples before and after a restart, and those
    of several devices, lie on one even clock. ``wall_ns`` is the clock, in nanoseconds since 1970.
    """

    def __init__(self, every_s: float, wall_ns: Callable[[], int] = time.time_ns) -> None:
        self.every_us = round(every_s * _MICRO)
        self._latest_us = min(self.every_us // 2, round(LATEST_S * _MICRO))
        self._wall_ns = wall_ns
        self._last: int | None = None  # the number of the last slot

    def now_us(self) -> int:
        """Microseconds since 1970."""
        return self._wall_ns() // 1000

    async def next(self) -> Slot:
        """Wait for the next slot that can be kept, and return at its beginning."""
        slot = self.plan(self.now_us())
        while (left_us := slot.at_us - self.now_us()) > 0 or -left_us > self._latest_us:
            if left_us > 2 * self.every_us + _MICRO:  # the clock was set back during the wait
                slot = self.plan(self.now_us())
            elif left_us > 0:
                await asyncio.sleep(left_us / _MICRO)
            else:  # the program or its machine was suspended: it is too late for this instant
                slot = self._instead_of(slot)
        return slot

    def _instead_of(self, missed: Slot) -> Slot:
        """The next slot after ``missed``, whose own instants and those before it passed unused."""
        later = self.plan(self.now_us())
        first_us = missed.missed_us.start if missed.missed_us else missed.at_us
        return Slot(
            later.at_us,
            range(first_us, later.at_us, self.every_us),
            clock_went_back=missed.clock_went_back or later.clock_went_back,
        )

    def plan(self, now_us: int) -> Slot:
        """The next slot as seen at ``now_us``: the one after the last if it can still be kept, else
        the first that can."""
        upcoming = -(-now_us // self.every_us)
        if now_us - (upcoming - 1) * self.every_us <= self._latest_us:
            upcoming -= 1
        last = self._last
        if last is None:
            self._last = upcoming
            return Slot(upcoming * self.every_us)
        if upcoming < last - 1 and (last + 1) * self.every_us - now_us > 2 * self.every_us:
            self._last = upcoming
            return Slot(upcoming * self.every_us, clock_went_back=True)
        self._last = max(upcoming, last + 1)
        missed = range((last + 1) * self.every_us, self._last * self.every_us, self.every_us)
        return Slot(self._last * self.every_us, missed)
