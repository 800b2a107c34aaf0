"""Oscillations of several loops from run to run: recognised, replaced, over, and pruned."""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime, timedelta

from stemwatch.models.oscillation_groups.over_windows import told_once
from stemwatch.models.oscillation_groups.plant_groups import GroupMember, OscillationGroup
from stemwatch.service.store.administration.prune import RetentionDays, prune
from stemwatch.service.store.store import Store
from tests.service.store.conftest import START, MakeScreening

DAY = timedelta(days=1)
NOW = START + 5 * DAY
LOOPS = ("FIC-1", "TIC-2", "LIC-3")


def group(start: datetime | None = START, loops: tuple[str, ...] = LOOPS) -> OscillationGroup:
    """A group of a day whose first loop is the likeliest source."""
    return OscillationGroup(
        period_s=229.0,
        members=tuple(
            GroupMember(loop=loop, share=0.8 / k, probability=0.6 / k, evidence=("it leads",))
            for k, loop in enumerate(loops, 1)
        ),
        outside=0.1,
        regularity=5.0,
        start=start,
        duration_s=86400.0,
        since=None,
        strength=(0.5, 1.3),
        periods_s=(100.0, 229.0),
        spectra=((0.1, 1.0),) * len(loops),
    )


def screened(
    store: Store, make_screening: MakeScreening, start: datetime, loops: tuple[str, ...] = LOOPS
) -> int:
    """A run over ``loops``."""
    run = store.begin_run(software_version="1")
    for loop in loops:
        store.save(make_screening(valve=loop, start=start), run)
    return run


def test_a_group_comes_back_whole_and_is_recognised_the_next_day(
    store: Store, make_screening: MakeScreening
) -> None:
    """Every field survives; the second day says since when, and has both days as its history."""
    first = screened(store, make_screening, START)
    assert store.keep_oscillations(first, [group()]) == [group()]
    (kept,) = store.oscillations(NOW)
    assert (kept.group, kept.over, kept.run_id) == (group(), False, first)
    second = screened(store, make_screening, START + DAY)
    (linked,) = store.keep_oscillations(second, [group(START + DAY)])
    assert (linked.windows, linked.first_found) == (2, START)
    (kept,) = store.oscillations(NOW)
    assert kept.group == linked
    assert [item.at for item in kept.history] == [START + DAY, START + 2 * DAY]
    assert kept.history[0].source == "FIC-1"
    (of_loop,) = store.oscillations_of("TIC-2", NOW)
    assert (of_loop.source, of_loop.windows) == ("FIC-1", 2)
    assert store.oscillations_of("PIC-9", NOW) == []


def test_windows_of_one_run_are_one_oscillation_whatever_their_order(
    store: Store, make_screening: MakeScreening
) -> None:
    """The larger group of the later window comes first: it still continues the one before."""
    run = screened(store, make_screening, START, (*LOOPS, "PIC-4"))
    screened(store, make_screening, START + DAY, (*LOOPS, "PIC-4"))
    later = group(START + DAY, (*LOOPS, "PIC-4"))
    linked, first = store.keep_oscillations(run, [later, group()])
    assert (linked.windows, linked.first_found, first.windows) == (2, START, 1)
    (kept,) = store.oscillations(NOW)
    assert kept.group == linked
    assert told_once([linked, first]) == [linked]
    other = group(START, ("FIC-8", "FIC-9"))
    assert told_once([linked, other]) == [linked, other]


def test_a_group_that_the_window_before_did_not_show_began_with_its_own(
    store: Store, make_screening: MakeScreening
) -> None:
    """It has a begin then, which the windows after it keep; where nobody looked it has none."""
    screened(store, make_screening, START)
    for day in (1, 2):
        run = screened(store, make_screening, START + day * DAY)
        (kept,) = store.keep_oscillations(run, [group(START + day * DAY)])
        assert (kept.since, kept.windows) == (START + DAY, day)
    later = screened(store, make_screening, START + 30 * DAY)
    (unknown,) = store.keep_oscillations(later, [group(START + 30 * DAY)])
    assert unknown.since is None


def test_a_later_run_that_does_not_find_it_ends_it(
    store: Store, make_screening: MakeScreening
) -> None:
    """A run over one of its loops alone does not; after one over most of them it is over."""
    store.keep_oscillations(screened(store, make_screening, START), [group()])
    screened(store, make_screening, START + DAY, LOOPS[:1])
    assert [oscillation.over for oscillation in store.oscillations(NOW)] == [False]
    screened(store, make_screening, START + 2 * DAY, LOOPS[1:])
    assert [oscillation.over for oscillation in store.oscillations(NOW)] == [True]
    assert store.oscillations_of("FIC-1", NOW) == []


def test_runs_over_parts_of_a_plant_leave_a_group_as_it_is(
    store: Store, make_screening: MakeScreening
) -> None:
    """A run over half of its loops, or over each of them alone, would not find it. Of the same
    window the whole group is shown."""
    loops = (*LOOPS, "PIC-4")
    whole = group(loops=loops)
    first = screened(store, make_screening, START, loops)
    store.keep_oscillations(first, [whole])
    part = screened(store, make_screening, START, loops[:2])
    store.keep_oscillations(part, [group(loops=loops[:2])])
    for loop in loops:
        screened(store, make_screening, START + DAY, (loop,))
    (kept,) = store.oscillations(NOW)
    assert (kept.group, kept.over) == (whole, False)
    store.keep_oscillations(
        screened(store, make_screening, START + DAY, loops), [group(START + DAY, loops)]
    )
    (kept,) = store.oscillations(NOW)
    assert (kept.group.windows, len(kept.group.members)) == (2, 4)


def test_the_same_window_again_replaces_its_groups(
    store: Store, make_screening: MakeScreening
) -> None:
    """By another run as by the same one; another group of that window stays."""
    other = group(loops=("A", "B"))
    first = screened(store, make_screening, START)
    store.keep_oscillations(first, [group(), other])
    store.keep_oscillations(first, [group(), other])
    repeated = screened(store, make_screening, START)
    store.keep_oscillations(repeated, [replace(group(), outside=0.7)])
    kept = store.oscillations(NOW)
    assert sorted((item.run_id, item.group.outside) for item in kept) == [
        (first, 0.1),
        (repeated, 0.7),
    ]


def test_undated_groups_are_kept_by_run(store: Store, make_screening: MakeScreening) -> None:
    """They are never linked; the next run over their loops ends them."""
    run = store.begin_run(software_version="1")
    (kept,) = store.keep_oscillations(run, [group(None)])
    assert (kept.windows, kept.first_found) == (1, None)
    assert len(store.oscillations(NOW)) == 1


def test_they_go_with_their_run(store: Store) -> None:
    """Pruning a run takes its groups along; what followed them stays and has a shorter history."""
    old = store.begin_run(software_version="1")
    store.keep_oscillations(old, [group()])
    store.finish_run(old)
    prune(store, RetentionDays(results_days=1), NOW + 3000 * DAY)
    assert store.oscillations(NOW) == []
