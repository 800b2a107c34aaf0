"""Tags that are stored when they have moved by a deviation: at rest between two reports, unless the
archive stored nothing at all.
"""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from stemwatch.connectors.connector import TagMapping, ValveTags
from stemwatch.connectors.historian.times.deviation_reports import by_deviation
from stemwatch.connectors.historian.times.timeline import Timeline
from stemwatch.models.recording import Quality, Recording, Role
from stemwatch.models.studies.simulator.historian import swinging_door

VALVE = ValveTags(
    valve="A", tags={Role.OP: TagMapping(tag="A.OP"), Role.MV: TagMapping(tag="A.ZT")}
)
START = datetime(2026, 3, 2, 6, tzinfo=UTC)
SECONDS = 12_000


def signals() -> tuple[np.ndarray, np.ndarray]:
    """OP that wanders, and a stem that rests until OP is 3 % away, with some noise."""
    rng = np.random.default_rng(7)
    op = 50.0 + 8.0 * np.sin(np.arange(SECONDS) / 90.0) + 0.1 * rng.standard_normal(SECONDS)
    stem = op.copy()
    for place in range(1, SECONDS):
        far = abs(op[place] - stem[place - 1]) > 3.0
        stem[place] = op[place] if far else stem[place - 1]
    return op, stem + 0.02 * rng.standard_normal(SECONDS)


def reported(values: np.ndarray, deviation: float, heartbeat: int = 10_000) -> np.ndarray:
    """Places of the reports."""
    places = [0]
    for place, value in enumerate(values):
        moved = abs(value - values[places[-1]]) > deviation
        if moved or place - places[-1] >= heartbeat:
            places.append(place)
    return np.unique(places)


def timeline(places: np.ndarray) -> Timeline:
    return Timeline(places.astype(np.int64) * 1_000_000_000)


def read(open_text, stored: dict[str, tuple[np.ndarray, np.ndarray]]) -> Recording:
    """The recording of an export with a row for each report, in order of time."""
    rows = [
        (int(place), f"{tag},{(START + timedelta(seconds=int(place))).isoformat()},{value:.4f}\n")
        for tag, (places, values) in stored.items()
        for place, value in zip(places, values[places], strict=True)
    ]
    text = "Tag,Time,Value\n" + "".join(row for _, row in sorted(rows, key=lambda row: row[0]))
    return open_text(text).read(VALVE)


def test_a_stem_that_is_not_reported_rests_where_it_was(open_text) -> None:
    """Its value is good as long as OP is reported, and within the deviation of the true one."""
    op, stem = signals()
    places = {"A.OP": (reported(op, 0.25), op), "A.ZT": (reported(stem, 0.25), stem)}
    recording = read(open_text, places)
    assert recording.mv is not None
    assert recording.usable.mean() > 0.9
    at = np.arange(len(recording)) * round(recording.interval_s)
    usable = recording.usable
    assert np.abs(recording.mv.values[usable] - stem[at[usable]]).max() <= 0.26
    assert any("moved by a deviation" in said for said in recording.provenance.decisions)


def test_where_the_archive_was_down_nothing_is_known(open_text) -> None:
    """Ten minutes without a report of any tag are MISSING."""
    op, stem = signals()
    kept = {
        tag: (places[(places < 1000) | (places >= 1600)], values)
        for tag, places, values in (
            ("A.OP", reported(op, 0.25), op),
            ("A.ZT", reported(stem, 0.25), stem),
        )
    }
    recording = read(open_text, kept)
    assert recording.mv is not None
    at = np.arange(len(recording)) * recording.interval_s
    down = (at > 1030) & (at < 1570)
    assert set(recording.op.quality[down].tolist()) == {Quality.MISSING}
    assert set(recording.mv.quality[down].tolist()) == {Quality.MISSING}


@pytest.mark.parametrize("deviation", [0.1, 0.25, 0.5, 1.0])
@pytest.mark.parametrize("heartbeat", [300, 10_000])
def test_reports_are_told_from_lines_between_stored_points(deviation, heartbeat) -> None:
    """No change from one report to the next is small; those of a swinging door may be."""
    for values in signals():
        places = reported(values, deviation, heartbeat)
        assert by_deviation(timeline(places), values[places])
        drawn = np.flatnonzero(swinging_door(values, deviation))
        assert not by_deviation(timeline(drawn), values[drawn])


def test_even_samples_and_uneven_scans_are_no_reports() -> None:
    """Their changes are as often near zero as elsewhere, or all times are alike."""
    rng = np.random.default_rng(3)
    op, stem = signals()
    for values in (op, stem, np.round(stem, 1), np.arange(SECONDS) * 0.1):
        even = np.arange(0, SECONDS, 5)
        assert not by_deviation(timeline(even), values[even])
    scanned = np.flatnonzero(rng.random(SECONDS) < 0.2)
    for values in (op, stem, np.round(stem, 1)):
        assert not by_deviation(timeline(scanned), values[scanned])
