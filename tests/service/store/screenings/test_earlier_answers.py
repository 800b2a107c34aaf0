"""What OP and PV alone said in earlier windows, as it is stored."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime, timedelta

from stemwatch.models.screening_result import Screening
from stemwatch.models.verdict import Verdict
from stemwatch.models.without_position.several_recordings import LAST_THAT_COUNT
from stemwatch.models.without_position.suspicion import WithoutPosition
from stemwatch.service.store.screenings.evidence import WEEKS
from stemwatch.service.store.store import Store
from tests.service.report.conftest import screening
from tests.service.report.test_without_position import no_sign, suspected

BEGAN = datetime(2026, 1, 5, 6, 0, tzinfo=UTC)
LENGTH, DAY = timedelta(minutes=1), timedelta(days=1)


def at(start: datetime, answer: WithoutPosition | None) -> Screening:
    """A minute of a valve without a position, from ``start`` on."""
    result = screening("FIC-1", Verdict.UNDETERMINED, samples=60)
    assert result.recording is not None
    recording = replace(result.recording, start=start)
    return replace(result, recording=recording, without_position=answer)


def save(store: Store, *windows: Screening) -> int:
    run = store.begin_run(software_version="1")
    for window in windows:
        store.save(window, run)
    return run


def starts(store: Store, run: int = 0) -> list[datetime]:
    return [before.start for before in store.earlier_answers("FIC-1", run)]


def test_the_last_windows_come_first_with_what_they_said(store: Store) -> None:
    """Each with its own answer; one that was not asked is left out, and a run does not see its own
    windows."""
    save(store, at(BEGAN, suspected(0.9)), at(BEGAN + DAY, None), at(BEGAN + 2 * DAY, no_sign()))
    run = save(store, at(BEGAN + 3 * DAY, no_sign()))
    newest, _, first = store.earlier_answers("FIC-1", run_id=0)
    assert (newest.start, newest.answer) == (BEGAN + 3 * DAY, no_sign())
    assert newest.screening == store.screenings("FIC-1", 1)[0].id
    assert (first.start, first.answer) == (BEGAN, suspected(0.9))
    assert starts(store, run) == [BEGAN + 2 * DAY, BEGAN]
    assert store.earlier_answers("FIC-2", run_id=0) == []


def test_the_same_minutes_do_not_count_twice(store: Store) -> None:
    """Of windows that share samples the last counts, and at most eight count."""
    save(store, *(at(BEGAN + n * LENGTH / 2, suspected()) for n in range(4)))
    assert starts(store) == [BEGAN + 3 * LENGTH / 2, BEGAN + LENGTH / 2]
    save(store, *(at(BEGAN + (n + 1) * DAY, suspected()) for n in range(12)))
    assert starts(store) == [BEGAN + n * DAY for n in range(12, 12 - LAST_THAT_COUNT, -1)]


def test_what_was_before_the_last_work_or_long_ago_does_not_count(store: Store) -> None:
    """Another stem, another season."""
    save(store, *(at(BEGAN + n * DAY, suspected()) for n in (0, 1, 2, 3)))
    store.record_maintenance("FIC-1", BEGAN + DAY + LENGTH / 2, "packing renewed", "Ann")
    assert starts(store) == [BEGAN + 3 * DAY, BEGAN + 2 * DAY]
    later = BEGAN + 3 * DAY + timedelta(weeks=WEEKS)
    save(store, at(later, suspected()))
    assert starts(store) == [later, BEGAN + 3 * DAY]
    save(store, at(later + DAY, suspected()))
    assert starts(store) == [later + DAY, later]
