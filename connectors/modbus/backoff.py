"""``Backoff``: how long to wait before trying again after a failure."""

from __future__ import annotations

import random


class Backoff:
    """Waits that double from ``first_s`` to ``longest_s``, each shortened at random by up to half.

    The random part keeps many clients of one restarted gateway from connecting all at once. A
    device that is back is noticed after the longest wait at the latest.
    """

    def __init__(
        self, first_s: float = 0.2, longest_s: float = 15.0, rng: random.Random | None = None
    ) -> None:
        self.first_s, self.longest_s = first_s, longest_s
        self._rng = rng or random.Random()
        self._failures = 0

    @property
    def failures(self) -> int:
        """How often it has failed since it last succeeded."""
        return self._failures

    def succeeded(self) -> None:
        """Begin with the shortest wait again."""
        self._failures = 0

    def failed(self) -> float:
        """Seconds to wait after one more failure."""
        # Beyond 2**30 the limit holds anyway, and a float would overflow after months.
        doubled = self.first_s * 2.0 ** min(self._failures, 30)
        self._failures += 1
        return min(self.longest_s, doubled) * self._rng.uniform(0.5, 1.0)
