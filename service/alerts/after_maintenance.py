"""After work on a valve: S before the work and now, and whether the two differ; and the question
whether there was work, where S fell and none is recorded."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime, time, timedelta, tzinfo

from stemwatch.models.estimate import Estimate
from stemwatch.models.history.fall_of_stiction import UnexplainedFall
from stemwatch.models.verdict import Verdict
from stemwatch.service.store.screenings.records import Remark, StoredScreening
from stemwatch.service.store.store import Store

WRITER = "stemwatch"
_SAME_FALL = timedelta(days=5)  # by which its day may be moved by what is seen later
_LOOK_BACK = 50  # screenings in which the last one before the work is looked for


def note_result_of_work(store: Store, valve: str, zone: tzinfo) -> str | None:
    """Keep a note on ``valve`` that compares before and after its last maintenance, once, with
    its day in the plant's ``zone``, as its page says it.

    Returns the note, or ``None`` where there is nothing to compare yet or it was said already.
    """
    work = store.maintenance(valve)
    if not work:
        return None
    last = work[-1]
    if any(note.who == WRITER and note.at == last.at for note in store.notes(valve)):
        return None
    sentence = compare(store.screenings(valve, _LOOK_BACK), last, zone)
    if sentence is not None:
        store.add_note(valve, last.at, sentence, WRITER)
    return sentence


def note_fall(store: Store, valve: str, fall: UnexplainedFall) -> None:
    """Keep a note on ``valve`` that asks for the work that is not recorded, once for a fall."""
    at = datetime.combine(fall.on, time(), UTC)
    own = [note for note in store.notes(valve) if note.who == WRITER]
    if not any(abs(note.at - at) <= _SAME_FALL for note in own):
        store.add_note(valve, at, fall.sentence, WRITER)


def compare(screenings: Sequence[StoredScreening], work: Remark, zone: tzinfo) -> str | None:
    """One sentence from the last judged screening before ``work`` and the first after it.

    ``screenings`` newest first. A window that the work lies in counts for neither side.
    """
    judged = [
        screening for screening in screenings if screening.verdict is not Verdict.UNDETERMINED
    ]
    after = [
        screening
        for screening in judged
        if screening.window[0] is not None and screening.window[0] >= work.at
    ]
    before = [
        screening
        for screening in judged
        if screening.window[1] is not None and screening.window[1] <= work.at
    ]
    if not after or not before:
        return None
    before_work, now = before[0], after[-1]
    day = work.at.astimezone(zone).date()
    return (
        f"After the work of {day:%Y-%m-%d} ({work.note}): {_verdict(before_work.S, now.S)} "
        f"S was {before_work.S} of OP span before and is {now.S} now; the valve was "
        f"{before_work.verdict.value} and is "
        f"{now.verdict.value}."
    )


def _verdict(before_work: Estimate, now: Estimate) -> str:
    """Whether the work helped, judged by both intervals."""
    ends = (before_work.low, before_work.high, now.low, now.high)
    if any(end is None for end in ends):
        return "Whether it helped cannot be told in numbers."
    low, high, now_low, now_high = (float(end) for end in ends if end is not None)
    if now_high < low:
        return "It helped: the valve sticks less than before, beyond what chance explains."
    if now_low > high:
        return "It got worse: the valve sticks more than before, beyond what chance explains."
    return "No difference can be told: the intervals before and after overlap."
