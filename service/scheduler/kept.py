"""``Worst``: the few screenings of a run that its report shows, with their samples."""

from __future__ import annotations

from collections.abc import Iterable

from stemwatch.models.screening_result import Screening


class Worst:
    """Keeps the worst ``limit`` screenings and lets the samples of all others go."""

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._kept: list[Screening] = []

    def add(self, screenings: Iterable[Screening]) -> None:
        """Take these into account."""
        self._kept = sorted([*self._kept, *screenings], key=badness)[: self._limit]

    @property
    def screenings(self) -> list[Screening]:
        """The worst ones, the worst first."""
        return list(self._kept)


def badness(screening: Screening) -> tuple[float, str]:
    """A key that sorts the worst to the front, as ``Store.worst_of_run`` does."""
    return -screening.severity, screening.valve
