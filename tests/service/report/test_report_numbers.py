"""Thinning, gauges, trends and the wording of numbers."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from zoneinfo import ZoneInfo

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stemwatch.models.estimate import Estimate
from stemwatch.models.screening_result import PreviousFinding
from stemwatch.models.verdict import Verdict
from stemwatch.service.presenter import wording as words
from stemwatch.service.report.bars import gauge, gauge_top
from stemwatch.service.report.change_since_last_run import change_since_last_run
from stemwatch.service.report.charts.thinning import (
    ThinningGrid,
    extreme_samples,
    lowest_and_highest,
)


def test_remarks_become_sentences():
    """Each ends, and none runs into the next; a tag keeps its letters."""
    assert words.as_sentences(["OP never turned round", "the loop was in manual.", " "]) == (
        "OP never turned round. The loop was in manual."
    )
    assert words.as_sentences(["fic-1.mv is in an unknown unit"]) == (
        "fic-1.mv is in an unknown unit."
    )
    assert words.as_sentences([]) == ""


values_or_gaps = st.one_of(st.floats(-1e6, 1e6), st.just(float("nan")))
traces = st.lists(values_or_gaps, min_size=1, max_size=400).map(np.array)


@settings(max_examples=60, deadline=None)
@given(trace=traces, points=st.integers(4, 60))
def test_decimation_keeps_the_extremes_and_bounds_the_points(trace, points):
    """Lowest and highest value survive, no value is made up, and the bound holds."""
    thin = lowest_and_highest(trace, ThinningGrid.of(trace.size, points))
    assert thin.size <= points
    known = trace[np.isfinite(trace)]
    if known.size:
        assert (np.nanmin(thin), np.nanmax(thin)) == (known.min(), known.max())
        assert set(thin[np.isfinite(thin)]) <= set(known)


@settings(max_examples=60, deadline=None)
@given(trace=traces, points=st.integers(8, 60))
def test_telling_samples_hold_the_extremes_of_each_trace(trace, points):
    """The samples picked for a loop hold each trace's ends, in time order, within the bound."""
    other = np.cos(np.arange(trace.size))
    picked = extreme_samples([trace, other], points)
    assert picked.size <= points
    assert np.all(np.diff(picked) > 0)
    assert other[picked].max() == other.max()
    if np.isfinite(trace).any():
        assert np.nanmin(trace[picked]) == np.nanmin(trace)


def test_a_jump_of_one_sample_survives_a_hundredfold_decimation():
    """The edge of a slip stays within half a bucket of its place, and a spike keeps its height."""
    trace = np.zeros(100_000)
    trace[70_000:] = 2.0
    trace[12_345] = 9.0
    grid = ThinningGrid.of(trace.size)
    thin = lowest_and_highest(trace, grid)
    assert thin.max() == 9.0
    edge = grid.first + grid.step * int(np.flatnonzero(thin == 2.0)[0])
    assert abs(edge - 70_000) <= grid.bucket / 2


def test_gaps_stay_gaps():
    """A bucket without a number is null, not a line through it."""
    trace = np.ones(1000)
    trace[400:600] = np.nan
    thin = lowest_and_highest(trace, ThinningGrid.of(1000, 100))
    assert np.isnan(thin[40:60]).all()
    assert np.isfinite(thin[:40]).all()


def test_a_trace_of_another_length_is_refused():
    """The grid belongs to one recording."""
    with pytest.raises(ValueError, match=r"expected a trace of 10 samples, received \(9,\)"):
        lowest_and_highest(np.zeros(9), ThinningGrid.of(10))


EARLIER = datetime(2026, 3, 1, 6, 0, tzinfo=UTC)


def before(verdict: Verdict, S: float | None = None, severity: float = 0.0) -> PreviousFinding:
    return PreviousFinding(at=EARLIER, run=1, verdict=verdict, S=S, severity=severity)


@pytest.mark.parametrize(
    ("previous", "direction", "words_said"),
    [
        (None, "new", "first look"),
        (before(Verdict.HEALTHY, 0.2), "worse", "worse, was healthy"),
        (before(Verdict.UNDETERMINED), "unknown", "was undetermined"),
        (before(Verdict.STICKY, 5.1), "same", "no change"),
        (before(Verdict.STICKY, 3.2), "worse", "worse, S +2.00"),
        (before(Verdict.STICKY, 8.0), "better", "better, S −2.80"),
        (before(Verdict.STICKY, None, 20.0), "worse", "worse, severity +42"),
        (before(Verdict.STICKY, None, 60.0), "same", "no change"),
    ],
)
def test_the_trend_is_an_arrow_and_words(previous, direction, words_said, make_screening):
    """A change counts by verdict first, then by S beyond its interval, then by severity."""
    now = make_screening("FV-1", S=5.2, samples=20)
    result = change_since_last_run(now, now.verdict, previous)
    assert (result.direction, result.words) == (direction, words_said)
    assert result.arrow


def test_a_valve_that_recovered_is_better(make_screening):
    """Watch after sticky is an improvement even if S were larger."""
    now = make_screening("FV-1", Verdict.WATCH, S=6.0, samples=20)
    assert (
        change_since_last_run(now, now.verdict, before(Verdict.STICKY, 4.0)).direction == "better"
    )


def test_without_an_interval_a_tenth_of_s_is_a_change(make_screening):
    """The step has to be a tenth of the earlier S, and 0.2 % at least."""
    now = make_screening("FV-1", samples=20)
    now = replace(now, S=Estimate(value=5.2, unit="%"))
    assert change_since_last_run(now, now.verdict, before(Verdict.STICKY, 4.9)).direction == "same"
    assert change_since_last_run(now, now.verdict, before(Verdict.STICKY, 4.4)).direction == "worse"


def test_gauges_share_a_round_scale_that_holds_every_value(make_screening):
    """The bars' end is a round number above the largest S or J, 2 % at least."""
    assert gauge_top([]) == 2.0
    assert gauge_top([make_screening("FV-1", S=5.2, samples=20)]) == 10.0
    place = gauge(Estimate(value=5.0, low=4.0, high=12.0), 10.0)
    assert place is not None
    assert (place.at, place.low, place.high, place.beyond) == (50.0, 40.0, 100.0, True)
    assert gauge(Estimate.unknown("no MV"), 10.0) is None


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        (float("nan"), "–"),
        (0.0, "0"),
        (1234.0, "1234"),
        (100.0, "100"),
        (0.01234, "0.0123"),
        (-3.14159, "−3.14"),
        (1.5e-9, "1.50e−09"),
    ],
)
def test_numbers_read_as_people_write_them(value, text):
    """Three significant digits, a real minus sign, a dash for nothing."""
    assert words.figure(value) == text


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (60, "60 s"),
        (90.25, "90.2 s"),
        (150, "2.5 min"),
        (1800, "30 min"),
        (3600, "1 h"),
        (5400, "1 h 30 min"),
        (90000, "1 d 1 h"),
    ],
)
def test_durations_read_as_people_say_them(seconds, text):
    """One or two units, none of them zero."""
    assert words.duration(seconds) == text


def test_a_window_names_its_zone_and_its_date_once():
    """The second date is said only where it differs; an unknown time of day is said too."""
    zone = ZoneInfo("Europe/Berlin")
    start = datetime(2026, 3, 2, 6, tzinfo=UTC)
    same = words.window(start, start.replace(hour=7), zone, "Europe/Berlin")
    assert same == "2026-03-02 07:00 to 08:00 (Europe/Berlin)"
    other = words.window(start, start.replace(day=3), zone, "Europe/Berlin")
    assert other == "2026-03-02 07:00 to 2026-03-03 07:00 (Europe/Berlin)"
    assert words.window(None, None, zone, "Europe/Berlin") == "time of day not known"
