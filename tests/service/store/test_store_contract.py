"""What every store does, whichever database is under it."""

from __future__ import annotations

import math
import subprocess
import sys
import uuid
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from datetime import UTC, datetime, timedelta, timezone

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from stemwatch.models.estimate import Estimate
from stemwatch.models.record_checks.data_quality import DataQuality
from stemwatch.models.recording import Provenance
from stemwatch.models.screening.screen import failed
from stemwatch.models.screening_result import Indicator, Residual, Screening
from stemwatch.models.verdict import Shape, Verdict
from stemwatch.models.without_position.suspicion import Suspicion, WithoutPosition
from stemwatch.service.store.errors import StoreError
from stemwatch.service.store.screenings.ranking import RankingFilter
from stemwatch.service.store.screenings.records import StoredValve
from stemwatch.service.store.store import Store, open_store

MakeScreening = Callable[..., Screening]
OTHER_PROCESS = """
import sys
from stemwatch.service.store.store import open_store
with open_store(sys.argv[1]) as store:
    for n in range(25):
        store.set_baseline("FIC-101", sys.argv[2].encode(), reason=f"round {n}")
        store.set_baseline(f"V-{n}", b"n", reason="first healthy window")
"""

DAY = timedelta(days=1)
START = datetime(2026, 3, 1, 6, 0, tzinfo=UTC)
LATER = datetime(2099, 1, 1, tzinfo=UTC)


def begin(store: Store) -> int:
    return store.begin_run(command=["screen"], software_version="1.2", settings_digest="d1")


def test_a_screening_comes_back_as_it_was_saved(
    store: Store, make_screening: MakeScreening
) -> None:
    """Everything but samples, traces and network survives the database."""
    screening = make_screening(without_position=SUSPECTED)
    run = begin(store)
    store.save(screening, run)
    (result,) = store.screenings("FIC-101")
    names = (
        "valve verdict reason advice shape severity confidence S residuals quality still_seen "
        "baseline_note provenance seconds window without_position"
    )
    for name in names.split():
        assert getattr(result, name) == getattr(screening, name), name
    assert result.J.reason == "too few slips"
    assert (result.run_id, result.software_version, result.settings_digest) == (run, "1.2", "d1")
    assert result.at == START + timedelta(minutes=10)


def test_the_same_window_again_replaces_the_screening(
    store: Store, make_screening: MakeScreening
) -> None:
    """A repeated run leaves one row with the latest values and the latest indicators."""
    store.save(make_screening(), begin(store))
    later = begin(store)
    changed = Indicator(name="period_s", value=80.0, unit="s", meaning="Period")
    store.save(make_screening(verdict=Verdict.WATCH, indicators={"period_s": changed}), later)
    (kept,) = store.screenings("FIC-101")
    assert (kept.verdict, kept.run_id) == (Verdict.WATCH, later)
    assert {"period_s": 80.0} == {
        name: point.value for name, point in store.indicators(kept.id).items()
    }


def test_the_same_instant_in_two_zones_is_one_window(
    store: Store, make_screening: MakeScreening
) -> None:
    """A window is its instants, not the way they are written."""
    run = begin(store)
    in_berlin = START.astimezone(timezone(timedelta(hours=1)))
    assert store.save(make_screening(), run) == store.save(make_screening(start=in_berlin), run)


def test_without_dates_the_source_makes_the_window(
    store: Store, make_screening: MakeScreening
) -> None:
    """Undated recordings are told apart by their source's digest, or else its name."""
    run = begin(store)
    sources = [
        Provenance(source="a.csv", digest="aa"),
        Provenance(source="b.csv", digest="bb"),
        Provenance(source="a.csv"),
        Provenance(source="b.csv"),
    ]
    undated = [make_screening(start=None, provenance=source) for source in sources]
    assert 4 == len({store.save(screening, run) for screening in undated})
    assert store.save(undated[0], run) == store.save(undated[0], run)


SUSPECTED = WithoutPosition(
    verdict=Suspicion.SUSPECTED,
    reason="Sticking is suspected.",
    advice="Do a bump test.",
    score=0.9,
    apparent_S=Estimate(value=2.0, low=1.5, high=2.6, unit="%"),
    rivals=("a sensor that sticks",),
)
TEXTS = st.text(max_size=20)
NUMBERS = st.floats(width=64)
ESTIMATES = st.one_of(
    st.builds(Estimate, value=NUMBERS, low=st.none(), high=st.none()),
    st.builds(Estimate.unknown, reason=st.text(min_size=1, max_size=20)),
)
CHANGES = st.fixed_dictionaries(
    {
        "verdict": st.sampled_from(Verdict),
        "reason": TEXTS,
        "shape": st.sampled_from([None, *Shape]),
        "severity": NUMBERS,
        "confidence": st.none() | NUMBERS,
        "S": ESTIMATES,
        "residuals": st.dictionaries(
            TEXTS, st.none() | st.builds(Residual, rmse=NUMBERS, normalised=NUMBERS), max_size=3
        ),
        "quality": st.builds(DataQuality, grade=st.sampled_from("ABCD"), reasons=st.tuples(TEXTS)),
        "still_seen": st.lists(TEXTS, max_size=3).map(tuple),
        "provenance": st.builds(Provenance, source=TEXTS),
        "start": st.none() | st.datetimes(timezones=st.just(UTC), max_value=datetime(2090, 1, 1)),
    }
)


@pytest.mark.long
@settings(
    max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(before=CHANGES, after=CHANGES)
def test_any_screening_saved_twice_is_one_row_with_the_latest_values(
    store: Store, make_screening: MakeScreening, before: dict[str, object], after: dict[str, object]
) -> None:
    """Whatever texts and numbers a screening holds, the second save replaces the first."""
    valve = uuid.uuid4().hex  # the store is the same for all examples
    before |= {"valve": valve}
    after |= {"valve": valve, "start": before["start"], "provenance": before["provenance"]}
    run = begin(store)
    first = store.save(make_screening(**before), run)
    screening = make_screening(**after)
    assert first == store.save(screening, run)
    (result,) = store.screenings(valve)
    assert store.previous_finding(screening) is None
    assert (result.verdict, result.shape) == (screening.verdict, screening.shape)
    assert result.reason == storable(screening.reason)
    assert result.still_seen == tuple(map(storable, screening.still_seen))
    assert result.severity == (screening.severity if math.isfinite(screening.severity) else 0.0)
    assert set(result.residuals) == set(map(storable, screening.residuals))
    if screening.S.value is not None and math.isfinite(screening.S.value):
        assert result.S.value == screening.S.value
    else:
        assert result.S.reason


def storable(text: str) -> str:
    return "".join("\ufffd" if c == "\0" or "\ud800" <= c <= "\udfff" else c for c in text)


def test_what_could_not_be_read_is_the_latest_until_something_was(
    store: Store, make_screening: MakeScreening
) -> None:
    """An export that arrives after a run in vain ends before that run. A source that fails today
    stays the latest, also where an old window is screened again."""

    def saved(screening: Screening) -> str:
        store.save(screening, begin(store))
        (line,) = store.ranking(RankingFilter()).lines
        assert store.screenings("FIC-101", 1)[0].verdict is line.stem_verdict
        return str(line.stem_verdict)

    def of_window(days: int) -> Screening:
        return make_screening(start=START + days * DAY)

    unread = failed("FIC-101", "no sample", "Look at the source.", Provenance(source="plc"))
    saved(of_window(0))
    assert [saved(one) for one in (unread, of_window(-3))] == ["undetermined"] * 2
    assert [saved(one) for one in (of_window(1), of_window(-2))] == ["sticky"] * 2
    assert [saved(one) for one in (unread, of_window(-4))] == ["undetermined"] * 2


def test_a_screening_that_cannot_be_saved_does_not_cost_the_others(
    store: Store, make_screening: MakeScreening
) -> None:
    """One broken screening is reported with its reason; the rest is in the store."""
    broken = make_screening(valve="FIC-102", verdict="rusty")
    several = [make_screening(valve="FIC-101"), broken, make_screening(valve="FIC-103")]
    report = store.save_many(several, begin(store))
    assert 2 == report.saved
    assert ["FIC-102"] == [failure.valve for failure in report.failures]
    assert "'rusty' is not a valid Verdict" in report.failures[0].reason
    assert ["FIC-101", "FIC-103"] == [
        latest_screening.valve for latest_screening in store.latest_screenings()
    ]


def test_a_run_counts_its_verdicts(store: Store, make_screening: MakeScreening) -> None:
    """A finished run knows when it ended and how many valves had each verdict."""
    run = begin(store)
    for valve, verdict in (("A", "sticky"), ("B", "sticky"), ("C", "healthy")):
        store.save(make_screening(valve=valve, verdict=Verdict(verdict)), run)
    finished = store.finish_run(run)
    assert {Verdict.STICKY: 2, Verdict.HEALTHY: 1} == finished.counts
    assert finished.finished is not None
    assert finished.started <= finished.finished
    assert finished == store.run(run)


def test_an_unknown_run_is_named(store: Store, make_screening: MakeScreening) -> None:
    """Saving for a run that never began says so."""
    with pytest.raises(StoreError, match=r"run 99 is not in the store; begin_run gives"):
        store.save(make_screening(), 99)
    with pytest.raises(StoreError, match=r"there is no run 99"):
        store.finish_run(99)


def test_the_ranking_has_each_valve_once_and_the_worst_first(
    store: Store, make_screening: MakeScreening
) -> None:
    """The latest screening counts, however bad or good an older one was."""
    valves = [
        StoredValve(id="A", area="east", criticality=1),
        StoredValve(id="B", area="west", criticality=3),
        StoredValve(id="C", area="west", criticality=1),
        StoredValve(id="D", area="west"),
    ]
    store.save_valves(valves)
    run = begin(store)
    for valve, day, severity in (
        ("A", 1, 20.0), ("A", 0, 99.0), ("B", 0, 50.0), ("C", 0, 50.0), ("C", -3, 1.0),
    ):  # fmt: skip
        store.save(make_screening(valve=valve, start=START + day * DAY, severity=severity), run)
    ranked = store.ranking(RankingFilter(verdicts=("sticky",)))
    assert [("B", 50.0), ("C", 50.0), ("A", 20.0)] == [
        (line.valve, line.severity) for line in ranked.lines
    ]
    west = RankingFilter(areas=("west",), verdicts=("sticky",))
    assert ["B", "C"] == [line.valve for line in store.ranking(west).lines]
    assert ["B"] == [line.valve for line in store.ranking(replace(west, size=1)).lines]
    assert valves == store.valves()


def test_saving_the_valves_again_updates_them(store: Store, make_screening: MakeScreening) -> None:
    """The plant file's facts win; a screening alone never overwrites them; more than one
    statement's worth of valves is no trouble."""
    several = [StoredValve(id=f"V{n:04}") for n in range(1200)]
    store.save_valves(several)
    store.save_valves([StoredValve(id="V0007", description="Feed", area="east", criticality=3)])
    store.save(make_screening(valve="V0007"), begin(store))
    assert 1200 == len(store.valves())
    assert StoredValve(id="V0007", description="Feed", area="east", criticality=3) in store.valves()


def test_previous_is_the_last_one_before(store: Store, make_screening: MakeScreening) -> None:
    """Each window is compared with the one before it, not with itself and not with a later one."""
    run = begin(store)
    days = [make_screening(start=START + day * DAY, severity=float(day)) for day in range(3)]
    for screening in days:
        store.save(screening, run)
    before = store.previous_finding(days[2])
    assert before is not None
    assert (1.0, run, days[1].window[1]) == (before.severity, before.run, before.at)
    assert (days[1].verdict, days[1].S.value) == (before.verdict, before.S)
    assert [1.0, 0.0] == [
        previous_finding.severity for previous_finding in store.previous_findings(days[2], limit=9)
    ]
    assert store.previous_finding(days[0]) is None
    assert store.previous_finding(make_screening(valve="unknown", start=LATER)) is None


def test_the_same_source_without_dates_is_not_earlier_than_itself(
    store: Store, make_screening: MakeScreening
) -> None:
    """An undated file that is screened again is compared with the file before it, whether or not
    it was saved already."""
    run = begin(store)
    first, second = (
        make_screening(start=None, provenance=Provenance(source=name, digest=name))
        for name in ("a.csv", "b.csv")
    )
    first = replace(first, severity=7.0)
    assert store.previous_finding(first, now=LATER) is None
    for screening in (first, second):
        store.save(screening, run)
    for now in (None, LATER):
        before = store.previous_finding(second, now=now)
        assert before is not None
        assert 7.0 == before.severity
    assert store.previous_finding(first) is None


def test_history_is_in_the_order_of_time(store: Store, make_screening: MakeScreening) -> None:
    """A trend runs from old to new, in UTC, with intervals and units; NaN is no value."""
    run = begin(store)
    for day, value in ((2, 12.0), (0, 10.0), (1, math.nan)):
        point = Indicator(name="gain", value=value, unit="%", meaning="", low=9.0, high=13.0)
        store.save(make_screening(start=START + day * DAY, indicators={"gain": point}), run)
    points = store.s_and_j("FIC-101")
    gains = [store.indicators(point.id)["gain"] for point in points]
    assert [10.0, None, 12.0] == [gain.value for gain in gains]
    assert (9.0, 13.0, "%") == (gains[0].low, gains[0].high, gains[0].unit)
    assert (points[0].at, UTC) == (gains[0].at, gains[0].at.tzinfo)
    assert points[2:] == store.s_and_j("FIC-101", START + 2 * DAY)


@pytest.mark.parametrize("call", ["record_maintenance", "add_note"])
def test_a_naive_time_is_refused(store: Store, call: str) -> None:
    """A time without zone is no instant, and the message says so."""
    with pytest.raises(StoreError, match="timezone aware datetime is expected, received 2026-03-0"):
        getattr(store, call)("FIC-101", datetime(2026, 3, 1), "note")
    assert [] == store.notes("FIC-101")


def test_secrets_are_not_in_the_stored_command(store: Store) -> None:
    """A run's command line is kept without passwords."""
    words = ["screen", "--store", "postgresql://u:geheim@h/d", "--token", "geheim"]
    run = store.begin_run(command=words, software_version="1")
    assert "screen --store postgresql://u:***@h/d --token ***" == store.run(run).command


def test_writers_at_the_same_time_lose_nothing(
    store: Store, store_url: str, make_screening: MakeScreening
) -> None:
    """Two stores in several threads writing the same windows end with one row for each."""
    run = begin(store)
    valves = [f"V{n}" for n in range(12)]
    with open_store(store_url) as other, ThreadPoolExecutor(4) as pool:
        reports = pool.map(
            lambda place: place.save_many([make_screening(valve=v) for v in valves], run),
            [store, other, store, other],
        )
        assert [(12, ())] * 4 == [(report.saved, report.failures) for report in reports]
        list(pool.map(lambda n: other.set_baseline("V1", bytes([n]), reason="race"), range(8)))
    assert {Verdict.STICKY: 12} == store.finish_run(run).counts
    assert store.baseline("V1") is not None


@pytest.mark.long
@pytest.mark.parametrize("count", [2, pytest.param(4, marks=pytest.mark.long)])
def test_processes_that_create_and_write_at_once_all_succeed(store_url: str, count: int) -> None:
    """Several processes may find no store, create it, and write the same valves."""
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", OTHER_PROCESS, store_url, f"process {n}"],
            stderr=subprocess.PIPE,
            text=True,
        )
        for n in range(count)
    ]
    errors = [process.communicate(timeout=120)[1] for process in processes]
    assert [(0, "")] * count == [
        (process.returncode, error) for process, error in zip(processes, errors, strict=True)
    ]
    with open_store(store_url) as store:
        assert 26 == len(store.valves())
        baseline = store.baseline("FIC-101")
    assert baseline is not None
    assert "round 24" == baseline.reason
