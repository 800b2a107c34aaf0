"""What is known of a valve beside its present screening: earlier screenings, work on it, its
samples."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from stemwatch.models.recording import Recording
from stemwatch.models.screening_result import PreviousFinding, Screening
from stemwatch.service.store.screenings.records import Remark

if TYPE_CHECKING:  # the front door loads no database library
    from stemwatch.service.store.screenings.pictures import AroundWork

# A year of daily runs: the search for the first screening with a finding goes back no further.
LOOK_BACK = 400


def _no_past(screening: Screening) -> Sequence[PreviousFinding]:
    return ()


def _no_work(valve: str) -> Sequence[Remark]:
    return ()


def _nothing_compared(valves: Collection[str]) -> Sequence[AroundWork]:
    return ()


def _no_samples(screening: Screening) -> Recording | None:
    return screening.recording


@dataclass(frozen=True, kw_only=True)
class ValveHistory:
    """Functions that read a valve's history. All but ``compared`` are called only for valves that
    get a page.

    ``earlier`` gives the screenings before this one, newest first, at most ``LOOK_BACK``; ``work``
    what was done at the valve, oldest first; ``samples`` what the picture is drawn from;
    ``compared`` the last work on each of several valves between two windows. ``run`` is the number
    of the run that is reported.
    """

    earlier: Callable[[Screening], Sequence[PreviousFinding]] = _no_past
    work: Callable[[str], Sequence[Remark]] = _no_work
    samples: Callable[[Screening], Recording | None] = _no_samples
    compared: Callable[[Collection[str]], Sequence[AroundWork]] = _nothing_compared
    run: int | None = None


NOTHING_KNOWN = ValveHistory()
