"""Recordings without a sample in the window that was asked for, of a run of the command line.

A folder of daily files and a window of one day: what engineers expect is that day's file, and one
sentence on the others.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from stemwatch.models.screening_result import Screening
from stemwatch.service.run.task import Task


class OutsideWindow:
    """Decides which recordings of ``tasks`` are left out, as their results arrive in any order.

    Only those without a sample in the window are. A valve of the plant file (``must_appear``) of
    which nothing lies in the window keeps one result, which says so; a file that is read by itself
    has no such valve.
    """

    def __init__(self, tasks: Sequence[Task], *, must_appear: bool) -> None:
        self._to_come = Counter(task.tags.valve for task in tasks)
        self._of = len(tasks)
        self._must_appear = must_appear
        self._shown: set[str] = set()
        self.screenings: list[Screening] = []  # what was left out

    def leaves_out(self, valve: str, screening: Screening | None) -> bool:
        """Whether the next result of ``valve`` is left out; ``None`` for one that was given up."""
        self._to_come[valve] -= 1
        is_last_chance = self._must_appear and not self._to_come[valve]
        if (
            screening is not None
            and screening.outside_window
            and (valve in self._shown or not is_last_chance)
        ):
            self.screenings.append(screening)
            return True
        self._shown.add(valve)
        return False

    @property
    def sentence(self) -> str:
        """How many were left out; empty where none was."""
        left_out = len(self.screenings)
        if not left_out:
            return ""
        verb = "has" if left_out == 1 else "have"
        was = "was" if left_out == 1 else "were"
        return (
            f"{left_out} of {self._of} recordings {verb} no samples in the window that was asked "
            f"for and {was} left out."
        )
