"""What is kept of windows for their pictures: with its screening, and around work on a valve."""

from __future__ import annotations

from datetime import timedelta

from stemwatch.service.store.administration.prune import RetentionDays, prune
from stemwatch.service.store.store import Store
from tests.service.store.conftest import START, MakeScreening

HOUR = timedelta(hours=1)


def test_pictures_live_and_go_with_their_screening(
    store: Store, make_screening: MakeScreening
) -> None:
    """Kept with it, replaced when its window is screened again, and pruned with it."""
    run = store.begin_run(software_version="1")
    (first, second) = (make_screening(start=START + day * 24 * HOUR) for day in (0, 1))
    report = store.save_many([first, second], run, packed_pictures=[b"one"])
    assert report.saved == 2
    newest, oldest = (screening.id for screening in store.screenings(first.valve))
    assert store.packed_pictures(oldest) == b"one"
    assert store.packed_pictures(newest) == b""
    repeated = store.save(first, run, packed_pictures=b"other")
    assert (repeated, store.packed_pictures(repeated)) == (oldest, b"other")
    store.save(second, run)
    prune(store, RetentionDays(results_days=1), START + timedelta(days=400))
    assert [screening.id for screening in store.screenings(first.valve)] == [newest]
    assert store.packed_pictures(oldest) == b""


def test_work_has_the_windows_before_and_after_it(
    store: Store, make_screening: MakeScreening
) -> None:
    """The last before it and the latest after it; a window in which the work was done is neither,
    nor is one without pictures; work with no window after it says nothing yet."""
    run = store.begin_run(software_version="1")
    created = [make_screening(start=START + day * 24 * HOUR) for day in range(6)]
    valve = created[0].valve
    assert store.around_work(valve) is None
    for day, item in enumerate(created):
        store.save(item, run, packed_pictures=b"" if day == 5 else f"{day}".encode())
    assert store.around_work(valve) is None
    middle = created[2].window[0]
    assert middle is not None
    store.record_maintenance(valve, middle + timedelta(seconds=1), "packing renewed", "K. Berg")
    store.record_maintenance(valve, START + timedelta(days=90), "not screened since", "")
    around = store.around_work(valve)
    assert around is not None
    assert (around.work.note, around.work.who) == ("packing renewed", "K. Berg")
    assert (around.before.packed, around.after.packed) == (b"1", b"4")
    assert around.before.end == created[1].window[1]
    assert around.after.S == created[4].S.value
