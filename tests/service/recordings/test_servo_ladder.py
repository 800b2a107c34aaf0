"""A servo drive whose friction and load follow a law: the same names at every gain, S near it."""

from __future__ import annotations

import csv
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from stemwatch.service.explain.explain_recording import explain_recording
from stemwatch.service.report.charts.effect_pictures import effect_pictures
from tests.benchmarks.bench_servo_ladder import CLEAR_LOAD, NO_LOAD, Row, read, row

pytestmark = [pytest.mark.recordings, pytest.mark.long]

EVERY = 19  # of the ladder's recordings: all gains, light and heavy loads


@pytest.fixture(scope="module")
def rows(recordings: Path) -> list[Row]:
    """Some of the ladder, explained."""
    place = recordings / "servo_ladder"
    if not (place / "conditions.csv").is_file():
        pytest.skip(f"THE SERVO LADDER IS NOT TESTED: no conditions.csv in {place}")
    return explained(place)


@cache
def explained(place: Path) -> list[Row]:
    with (place / "conditions.csv").open(encoding="utf-8", newline="") as text:
        conditions = list(csv.DictReader(text))[::EVERY]
    return [row(place / f"{condition['file']}.gz", condition) for condition in conditions]


def test_the_motor_is_named_at_every_gain(rows: list[Row]) -> None:
    """One machine, one name."""
    assert [row.file for row in rows if "motor_drive" not in row.names] == []


def test_a_load_is_named_where_it_is_clear_and_nowhere_where_it_is_slight(rows: list[Row]) -> None:
    """Two percent of a turn and more, and less than half a percent."""
    assert [row.file for row in rows if row.law_load >= CLEAR_LOAD and not row.loaded] == []
    assert [row.file for row in rows if row.law_load < NO_LOAD and row.loaded] == []


def test_s_is_near_the_law_and_the_fit_gains_on_unseen_samples(rows: list[Row]) -> None:
    """Within 0.3 % of a turn, the law inside the interval."""
    assert max(row.error for row in rows) <= 0.3
    assert all(row.holds for row in rows)
    # Where the encoder misread while the fit was judged, both errors are mostly that reading's.
    left = [(row.rmse_extended or 0.0) / (row.rmse_naive or 1.0) for row in rows]
    assert 0.0 < min(left)
    assert max(left) < 1.0
    assert float(np.median(left)) < 0.6


def test_the_page_of_a_servo_has_its_pictures(recordings: Path) -> None:
    """Three strokes, both loops, and what shows each effect, of a drive sampled every 10 ms: times
    in the pictures are those of its clock."""
    file = recordings / "servo_ladder" / "kp08_m1.168_l0.15_r1.csv.gz"
    if not file.is_file():
        pytest.skip(f"THE SERVO LADDER IS NOT TESTED: no {file.name}")
    explained = explain_recording(read(file), file.name, narx=False)
    pictures = effect_pictures(explained.recording, explained.mismatch)
    titles = [picture.title for picture in pictures]
    assert titles[:3] == ["Stroke 1", "Stroke 2", "Stroke 3"]
    assert sum(title.startswith("MV against OP") for title in titles) == 2
    shown = {title for title in titles if title.startswith("What shows it")}
    assert len(shown) == len(explained.mismatch.effects)
    for stroke in pictures[:3]:
        times = np.concatenate([line.x for line in stroke.plot.lines])
        assert float(np.ptp(times)) < 5.0  # the drive needs tenths of a second
