"""The evidence of weeks as it is stored: what each window named and scored, since the last work."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime, timedelta

import pytest
from sqlalchemy import text

from stemwatch.models.history.evidence_over_windows import FindingState
from stemwatch.models.mismatch.findings import EffectScore, Finding, Mismatch
from stemwatch.models.screening_result import Screening
from stemwatch.models.verdict import Verdict
from stemwatch.service.store.store import Store
from tests.service.example_mismatches import named, of_every_kind
from tests.service.report.conftest import screening

BEGAN = datetime(2026, 1, 5, 6, 0, tzinfo=UTC)
DAY = timedelta(days=1)
SLUG = "asymmetric_rate_limit"
SCORES = (EffectScore(slug=SLUG, mean=0.71, t=9.3, strength=4.2),)


def nothing_left() -> Mismatch:
    """A mismatch in which nothing was named."""
    return next(item for item in of_every_kind() if item.finding is Finding.NONE)


def on_day(day: float, mismatch: Mismatch, valve: str = "FIC-1", changed: str = "") -> Screening:
    """Ten minutes of a valve, ``day`` days after the first."""
    result = screening(valve, Verdict.HEALTHY, samples=60)
    assert result.recording is not None
    recording = replace(result.recording, start=BEGAN + day * DAY)
    answer = replace(mismatch, scores=SCORES)
    return replace(result, mismatch=answer, recording=recording, changed=changed)


def save(store: Store, *screenings: Screening) -> None:
    run = store.begin_run(software_version="1")
    for window in screenings:
        store.save(window, run)


def test_each_window_comes_back_with_what_it_named_and_scored(store: Store) -> None:
    """Both, in order of time, with S and J restated; the mismatch itself is stored without the
    scores."""
    result, nothing = named(), nothing_left()
    save(store, on_day(1, nothing), on_day(0, result))
    first, second = store.evidence(["FIC-1"])["FIC-1"].windows
    assert first.names(SLUG)
    assert second.named == ()
    assert first.scores == second.scores == SCORES
    assert first.S is not None
    assert first.S.value == pytest.approx(result.restated.S.value)
    assert first.start == BEGAN
    assert {place: size.value for place, size in first.sizes.items()} == {
        (effect.slug, name): size.value
        for effect in result.defects
        for name, size in effect.parameters.items()
        if size.value is not None
    }
    mismatch = store.screenings("FIC-1", 1)[0].mismatch
    assert mismatch is not None
    assert mismatch.scores == ()


def test_valves_on_which_nothing_was_named_have_no_evidence_to_read(store: Store) -> None:
    """Of a plant's valves most have nothing to weigh; those of others are not read either."""
    save(store, on_day(0, nothing_left()), on_day(0, named(), "FIC-2"))
    assert list(store.evidence(["FIC-1", "FIC-2", "FIC-3"])) == ["FIC-2"]


def test_work_on_the_valve_begins_anew(store: Store) -> None:
    """What two windows agreed on before describes the valve before the work."""
    selection = named()
    save(store, *[on_day(day, selection) for day in range(3)])
    finding = store.evidence(["FIC-1"])["FIC-1"].findings[0]
    assert finding.state is FindingState.STANDING
    store.record_maintenance("FIC-1", BEGAN + 2.5 * DAY, "exhaust cleared", "")
    assert store.evidence(["FIC-1"]) == {}
    save(store, on_day(3, selection))
    after = store.evidence(["FIC-1"])["FIC-1"].findings[0]
    assert after.state is FindingState.FIRST_SEEN
    assert after.first_seen.date() == (BEGAN + 3 * DAY).date()


def test_a_change_that_the_screening_names_is_kept(store: Store) -> None:
    """A curve from OP to stroke that changed: the windows before are of another valve."""
    save(store, on_day(0, named()), on_day(1, named(), changed="The curve is another one."))
    result = store.evidence(["FIC-1"])["FIC-1"]
    assert [window.begins_anew for window in result.windows] == ["The curve is another one."]
    assert result.findings[0].first_seen > BEGAN + DAY


def test_months_ago_is_not_read(store: Store) -> None:
    """The last weeks only, from the valve's latest screening."""
    save(store, on_day(0, named()), on_day(100, named()))
    (window,) = store.evidence(["FIC-1"])["FIC-1"].windows
    assert window.at > BEGAN + 99 * DAY


def test_a_row_of_an_older_version_says_what_it_named(store: Store) -> None:
    """It has no scores; that two such windows agree counts all the same."""
    save(store, on_day(0, named()), on_day(1, named()))
    with store.transactions.writing("the test") as session:
        session.execute(text("UPDATE screenings SET evidence = NULL"))
    result = store.evidence(["FIC-1"])["FIC-1"]
    assert [window.scores for window in result.windows] == [(), ()]
    assert SLUG in {finding.slug for finding in result.confirmed}


def test_a_window_that_could_not_be_tested_is_no_evidence(store: Store) -> None:
    """It neither names nor denies."""
    blind = replace(nothing_left(), finding=Finding.NOT_TESTABLE, scores=())
    save(store, on_day(0, named()), replace(on_day(1, blind), mismatch=blind))
    (finding, *_) = store.evidence(["FIC-1"])["FIC-1"].findings
    assert finding.of == 1
