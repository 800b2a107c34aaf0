"""When a finding is over, and when one that comes back is the trouble that was there before.

Closing asks for as much evidence as opening: so many windows on end without the finding as chance
would hardly leave out, given how often it was there before. Work on the valve begins anew, and so
does S that fell and stayed low: what was before is another stem.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime, time, timedelta

from stemwatch.models.history.evidence_over_windows import MEMORY, windows_to_be_gone
from stemwatch.models.history.fall_of_stiction import UnexplainedFall
from stemwatch.models.verdict import Verdict
from stemwatch.service.store.screenings.records import JudgedScreening

# A trouble that comes back within this time of its last window, without work in between, is the
# same one: a month in which nobody touched the valve. After longer than that, people have forgotten
# the first, and its evidence is of another season.
SOON = timedelta(days=30)
WINDOWS_BACK = 2 * MEMORY  # that closing looks at


def begins(worked_at: Sequence[datetime], fall: UnexplainedFall | None) -> datetime | None:
    """When the stem that is there now began: at the last recorded work, or when S fell."""
    fell = [] if fall is None else [datetime.combine(fall.on, time(), UTC)]
    return max([*worked_at, *fell], default=None)


def is_over(
    judged: Sequence[JudgedScreening],
    answers: Sequence[bool | None],
    began: datetime | None,
    least: int,
) -> bool:
    """Whether the newest of ``judged`` (newest first) are so many windows without the finding, but
    not fewer than ``least``, that it is over. ``answers`` say whether it was there in each; one
    that cannot tell counts for neither. Windows before the present stem ``began`` ask for no
    more."""
    windows_without, before = 0, list[bool]()
    for screening, answer in zip(judged, answers, strict=True):
        if answer is None:
            continue
        if not before and not answer:
            windows_without += 1
            continue
        start, _ = screening.window
        if len(before) == MEMORY or (began is not None and start is not None and start < began):
            break
        before.append(answer)
    return windows_without >= max(least, windows_to_be_gone(before))


def may_still_stick(judged: JudgedScreening, sticky_limit: float | None) -> bool:
    """Whether the window does not call the valve sticky and does not say either that it is not: the
    interval of its S reaches the limit."""
    if judged.verdict is not Verdict.WATCH or sticky_limit is None or judged.S.high is None:
        return False
    return judged.S.high >= sticky_limit


def same_since(newest: JudgedScreening, began: datetime | None) -> datetime | None:
    """An alert that was told of a window after this instant, and closed since, is the same trouble;
    ``None`` where the newest window has no time."""
    _, end = newest.window
    if end is None:
        return None
    return end - SOON if began is None else max(end - SOON, began)
