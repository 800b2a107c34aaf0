"""The data of plots: thinning loses no movement of the valve, and no gap is bridged."""

from __future__ import annotations

import itertools
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from stemwatch.connectors.connector import ConnectorError
from stemwatch.connectors.modbus.sample_batch import SampleBatch
from stemwatch.models.estimate import Estimate
from stemwatch.models.recording import Role, Signal
from stemwatch.models.screening.screen import Case, screen
from stemwatch.models.stickslip.stroke_curve import StrokeCurve
from stemwatch.service.store.samples.plot_points import with_holes
from stemwatch.service.store.samples.tables import microseconds
from stemwatch.service.store.screenings.records import TrendPoint
from stemwatch.service.store.screenings.restored import screening_of
from stemwatch.service.store.store import open_store
from stemwatch.service.web.api.loop import fitted_run, loop_of
from stemwatch.service.web.api.signals import SignalWindow, signals_of
from stemwatch.service.web.site import Site
from tests.service.web.example_plant import J_MADE, NOW, S_MADE, SOURCE, STICKY, reader_of

START = datetime(2026, 3, 1, tzinfo=UTC)
NUMBERS = itertools.count()


def keep(store, at_s, values, quality=None, reasons=None, tag="T") -> str:
    """Store samples of one tag at seconds since ``START``; the tag's name."""
    count = len(values)
    store.samples.write(
        SampleBatch(
            source=SOURCE,
            tags=(tag,) * count,
            at_us=microseconds(START) + np.round(np.asarray(at_s) * 1e6).astype(np.int64),
            values=np.asarray(values, dtype=np.float64),
            quality=np.zeros(count, dtype=np.uint8) if quality is None else np.asarray(quality),
            reasons=("",) * count if reasons is None else tuple(reasons),
        )
    )
    return tag


def drawn(store, tag, length_s, points):
    """A tag from ``START`` on."""
    stop = START + timedelta(seconds=length_s)
    return store.samples.plot_points(SOURCE, tag, START, stop, points)


def test_few_samples_are_drawn_as_they_are(store):
    """Below the number of points every sample is a point at its own instant."""
    tag = keep(store, range(100), np.arange(100.0))
    result = drawn(store, tag, 100, 200)
    assert result.bucket_s == 0.0
    np.testing.assert_array_equal(result.values, np.arange(100.0))
    np.testing.assert_allclose(result.at_s - START.timestamp(), np.arange(100))


def spike_is_kept(store) -> None:
    """A sample that lasted a second stands out of a day of thinned ones, in its place."""
    values = np.zeros(20_000)
    values[12_345] = 7.0
    tag = keep(store, range(20_000), values)
    result = drawn(store, tag, 20_000, 400)
    assert result.at_s.size <= 402
    assert np.nanmax(result.values) == 7.0
    at = result.at_s[np.nanargmax(result.values)] - START.timestamp()
    assert abs(at - 12_345) <= result.bucket_s


def test_thinning_keeps_a_single_spike(store):
    """The database gives the lowest and the highest of each bucket."""
    spike_is_kept(store)


@pytest.mark.postgres
def test_thinning_keeps_a_single_spike_on_postgresql(postgres_url):
    """The same statement works on the other engine."""
    with open_store(postgres_url) as store:
        spike_is_kept(store)


@settings(
    max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    values=st.lists(st.floats(-100, 100), min_size=60, max_size=200),
    points=st.integers(8, 40),
)
def test_thinned_extremes_are_those_of_the_samples(store, values, points):
    """Whatever the samples of a tag, lowest and highest survive any thinning."""
    tag = keep(store, range(len(values)), values, tag=f"T{next(NUMBERS)}")
    result = drawn(store, tag, len(values), points)
    assert np.nanmin(result.values) == min(values)
    assert np.nanmax(result.values) == max(values)


@pytest.mark.parametrize("points", [5000, 100])
def test_no_line_is_drawn_over_a_hole(store, points):
    """Ten minutes without samples break the line, thinned or not."""
    at = [*range(1000), *range(1600, 2600)]
    tag = keep(store, at, np.ones(len(at)))
    result = drawn(store, tag, 2600, points)
    since = result.at_s - START.timestamp()
    inside = (since > 1000) & (since < 1600)
    assert np.isnan(result.values[inside]).any()
    assert not np.isfinite(result.values[inside & (since > 1060) & (since < 1540)]).any()


def test_bad_samples_are_no_points_and_are_counted_with_their_reasons(store):
    """A bad sample breaks the line; the page says how many there are and why."""
    quality = np.zeros(100, dtype=np.uint8)
    quality[40:50] = 2
    reasons = ["no answer within 1 s" if bad else "" for bad in quality]
    values = np.where(quality > 0, np.nan, 1.0)
    tag = keep(store, range(100), values, quality, reasons)
    result = drawn(store, tag, 100, 1000)
    assert np.isnan(result.values[40:50]).all()
    bad = store.samples.bad(SOURCE, tag, START, START + timedelta(seconds=100))
    assert (bad.samples, bad.bad, bad.reasons) == (100, 10, (("no answer within 1 s", 10),))


def test_jitter_is_no_hole():
    """Steps up to twice the usual one keep the line whole."""
    at = np.cumsum(np.array([1.0, 1.2, 0.8, 1.9, 1.0, 1.1]))
    assert with_holes(at, np.ones(6)).at_s.size == 6


def signals(site, hours=1.0):
    """The sticky valve's signals up to ``NOW``."""
    signal_window = SignalWindow(valve=STICKY, start=NOW - timedelta(hours=hours), stop=NOW)
    return signals_of(site, signal_window)


def test_the_position_is_shown_in_percent(live):
    """4 to 20 mA become percent by the range in the plant file, and the bounds are known."""
    result = signals(live)
    assert [(trace.role, trace.unit) for trace in result.traces] == [("op", "%"), ("mv", "%")]
    mv = [value for value in result.traces[1].values if value is not None]
    assert 40 < min(mv) < max(mv) < 60
    assert result.last_s == NOW.timestamp() - 1
    assert result.says == ""


def test_an_empty_window_says_so(live):
    """A year ago there was nothing, and a sentence says it."""
    signal_window = SignalWindow(
        valve=STICKY, start=START - timedelta(days=400), stop=START - timedelta(days=399)
    )
    assert "no samples" in signals_of(live, signal_window).says


def test_without_a_plant_file_the_page_says_why_there_are_no_signals(filled):
    """Nobody can know which tags belong to the valve."""
    assert "plant file" in signals(Site(store=filled)).says


def test_a_source_that_cannot_be_read_says_why(live):
    """The connector's own sentence reaches the reader."""

    def read(valve, window):
        raise ConnectorError("exports/a.csv: not there; export the tags again")

    site = Site(store=live.store, plant=live.plant, read=read)
    signal_window = SignalWindow(valve=STICKY, start=NOW - timedelta(hours=1), stop=NOW)
    assert (
        loop_of(site, signal_window, {}).says == "exports/a.csv: not there; export the tags again"
    )


def missed(loop) -> float:
    """Rms of what the fitted loop misses the recorded one by, percent."""
    recorded, fitted = (np.array(trace.values, dtype=float) for trace in loop.traces)
    return float(np.sqrt(np.nanmean((recorded - fitted) ** 2)))


def test_the_fitted_loop_lies_on_the_recorded_one(live):
    """With the S and J that made the samples, the model's run is the recording, jumps and all."""
    numbers = {"S_percent": S_MADE, "J_percent": J_MADE}
    signal_window = SignalWindow(valve=STICKY, start=NOW - timedelta(hours=1), stop=NOW)
    assert missed(loop_of(live, signal_window, numbers)) < 0.1
    assert missed(loop_of(live, signal_window, numbers | {"S_percent": 8.0})) > 0.5


def test_without_S_there_is_no_fitted_loop(live):
    """A model that was not fitted is not drawn."""
    signal_window = SignalWindow(valve=STICKY, start=NOW - timedelta(hours=1), stop=NOW)
    assert [trace.role for trace in loop_of(live, signal_window, {}).traces] == ["recorded"]


def test_the_stored_numbers_are_enough_to_run_the_model_again(live):
    """A real fit, reduced to what the store keeps, follows MV as well as the fit itself did."""
    read = reader_of(live.store)
    window = SignalWindow(valve=STICKY, start=NOW - timedelta(hours=1), stop=NOW).window
    recording = read(STICKY, window)
    (result,) = screen([Case(recording=recording)])
    numbers = {name: item.value for name, item in result.indicators.items()}
    repeated = fitted_run(recording, numbers)
    rmse = np.sqrt(np.nanmean((repeated - recording.mv.values) ** 2))
    assert rmse < 0.1 + 1.5 * result.residuals["stiction"].rmse  # MV swings over 12 %


@pytest.mark.long
def test_the_fitted_loop_goes_through_the_curve_from_op_to_stroke(live):
    """On the upper half of a split range S in percent of OP is half of that of travel."""
    read = reader_of(live.store)
    curve = StrokeCurve(op=(50.0, 100.0), travel=(0.0, 100.0))

    def split(valve, window):
        recording = read(valve, window)
        op = recording.op
        half = Signal(50.0 + op.values / 2.0, op.quality, op.tag, op.unit, op.interval_s)
        return replace(recording, signals={**recording.signals, Role.OP: half})

    site = Site(store=live.store, plant=live.plant, read=split)
    signal_window = SignalWindow(valve=STICKY, start=NOW - timedelta(hours=1), stop=NOW)
    S, J = (Estimate(value=item / 2.0, unit="%") for item in (S_MADE, J_MADE))
    changed = replace(
        screening_of(live.store.screenings(STICKY, 1)[0]), S=S, J=J, stroke_curve=curve
    )
    numbers = {"S_percent": S_MADE / 2.0, "J_percent": J_MADE / 2.0}
    loop = loop_of(site, signal_window, numbers, changed)
    assert missed(loop) < 0.1
    assert [shape.role for shape in loop.shapes] == ["band", "curve"]
    assert loop.curve_says.startswith(curve.sentence())
    assert curve.proposal() in loop.curve_says


def test_every_indicator_of_a_screening_has_its_words(live):
    """A number that comes back from the store means what it meant when it was found."""
    read = reader_of(live.store)
    window = SignalWindow(valve=STICKY, start=NOW - timedelta(hours=1), stop=NOW).window
    (screened,) = screen([Case(recording=read(STICKY, window))])
    indicators = screened.indicators
    assert len(indicators) > 12
    restored = {
        name: TrendPoint(
            at=NOW, value=item.value, low=item.low, high=item.high, unit=item.unit
        ).indicator(name)
        for name, item in indicators.items()
    }
    assert {name: (item.meaning, item.worse) for name, item in indicators.items()} == {
        name: (repeated.meaning, repeated.worse) for name, repeated in restored.items()
    }
