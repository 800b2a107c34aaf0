"""Which strokes are drawn of a recording, and the fitted limit in them."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from stemwatch.models.mismatch.findings import FreeRuns, Mismatch, RecordEffect
from stemwatch.models.mismatch.measurement.record_effects import late_effect, small_delay_effect
from stemwatch.models.recording import Floats, Recording, Role, Signal
from stemwatch.service.report.charts.effect_pictures import effect_pictures
from stemwatch.service.report.charts.small_plot import Picture
from tests.service.example_mismatches import named

FALLS_AT = 2.9  # %/s, as ``named`` has it


def limited(op: Floats) -> Floats:
    """A stem that follows at once but falls at ``FALLS_AT`` and no faster."""
    mv = op.copy()
    for k in range(1, op.size):
        mv[k] = max(op[k], mv[k - 1] - FALLS_AT)
    return mv


def pictures(op: Floats, mv: Floats) -> list[Picture]:
    """The strokes of a recording with a limit when falling."""
    return [item for item in all_pictures(op, mv) if item.title.startswith("Stroke")]


def all_pictures(op: Floats, mv: Floats, *of_record: RecordEffect) -> tuple[Picture, ...]:
    """Every picture of a recording with a limit when falling, and what the record did to it."""
    created = {Role.OP: Signal.good(op, "OP"), Role.MV: Signal.good(mv, "ZT")}
    recording = Recording(valve="FV-1", signals=created, interval_s=1.0)
    mismatch: Mismatch = named()
    runs = FreeRuns(naive=op, extended=mv, heldout_from=op.size // 2)
    effects = mismatch.effects[:1]
    mismatch = replace(mismatch, runs=runs, effects=effects, record_effects=of_record)
    return effect_pictures(recording, mismatch)


def test_strokes_are_those_on_which_the_stem_stays_behind() -> None:
    """Of a staircase of an hour downwards the steps are drawn, where the limit lies along the stem,
    and not the hour from turn to turn. Only falls: rises are quick."""
    op = np.full(4000, 80.0)
    for at, to in ((2300, 60.0), (2900, 45.0), (3500, 20.0), (3700, 70.0)):
        op[at:] = to
    op[100:160] = 60.0
    mv = limited(op)
    drawings = pictures(op, mv)
    assert [item.title for item in drawings] == ["Stroke 1", "Stroke 2", "Stroke 3"]
    for picture, size in zip(drawings, (20.0, 15.0, 25.0), strict=True):
        (law,) = [line for line in picture.plot.lines if line.kind == "law"]
        (stem,) = [line for line in picture.plot.lines if line.label.startswith("MV")]
        took = law.x[1] - law.x[0]
        assert abs(took - size / FALLS_AT) < 1.5
        assert np.abs(np.interp(law.x, stem.x, stem.y) - law.y).max() < 1.5 * FALLS_AT
        assert stem.x.size < 60
        assert "2.9" in picture.plot.notes[0].text
        assert "a falling command, in the part that neither" in picture.caption


def test_a_stem_that_is_nowhere_behind_shows_the_largest_moves() -> None:
    """Strokes are shown all the same, and said to be the largest."""
    op = 50.0 + 8.0 * np.sin(np.arange(900) / 40.0)
    drawings = pictures(op, op.copy())
    assert len(drawings) == 3
    assert all("largest moves" in item.caption for item in drawings)


def test_a_gap_is_in_no_stroke() -> None:
    """A move with samples missing is left out; fewer strokes are better than half ones."""
    op = np.full(1200, 80.0)
    for at, to in ((700, 60.0), (900, 40.0)):
        op[at:] = to
    mv = limited(op)
    mv[702] = np.nan
    drawings = pictures(op, mv)
    assert len(drawings) == 1
    lines = drawings[0].plot.lines[0]
    assert re.match("The only stroke on which ", drawings[0].caption)
    assert lines.y.max() <= 60.0


def test_strokes_come_from_the_stretch_that_was_fitted() -> None:
    """Of a day only the most telling hour is fitted; larger moves of another hour have no model to
    be drawn beside.
    """
    op = np.full(4000, 80.0)
    for at, to in ((1400, 65.0), (1600, 50.0), (1800, 35.0), (3000, 90.0), (3400, 10.0)):
        op[at:] = to
    mv = limited(op)
    created = {Role.OP: Signal.good(op, "OP"), Role.MV: Signal.good(mv, "ZT")}
    recording = Recording(valve="FV-1", signals=created, interval_s=1.0)
    fitted = FreeRuns(naive=op[1000:2000], extended=mv[1000:2000], heldout_from=300)
    mismatch: Mismatch = replace(
        named(), runs=fitted.within(1000, op.size), effects=named().effects[:1]
    )
    strokes = [
        picture
        for picture in effect_pictures(recording, mismatch)
        if picture.title.startswith("Stroke")
    ]
    assert len(strokes) == 3
    for line in (line for stroke in strokes for line in stroke.plot.lines):
        assert np.isfinite(line.y).all()
        assert line.y.min() > 34.0
        assert line.y.max() < 81.0


@pytest.mark.parametrize(
    ("shift", "of_record", "name"),
    [
        (1, small_delay_effect(1.0, 1.0), "OP, 1.0 s later"),
        (-2, late_effect(2.0, 1.0), "OP, 2.0 s earlier"),
    ],
)
def test_a_limit_is_shown_against_op_as_the_stem_had_it(
    shift: int, of_record: RecordEffect, name: str
) -> None:
    """Also where the delay is one of clocks and no physics: it is drawn over MV, and without it
    speed and error would not belong together."""
    rng = np.random.default_rng(5151)
    command = 60.0 + np.repeat(rng.normal(0.0, 8.0, 500), 3)
    mv = limited(command)
    every = {
        item.title: item.plot for item in all_pictures(np.roll(command, -shift), mv, of_record)
    }
    assert f"{name}, over MV" in every
    loops = [plot for title, plot in every.items() if title.startswith("MV against OP")]
    assert [plot.x_label for plot in loops] == [f"{name}, %"] * 2
    assert all(plot.equal for plot in loops)
    for plot in loops:
        (band,) = [line for line in plot.lines if line.kind == "band"]
        left, right, low, high = plot.limits
        assert left <= band.x.min() < band.x.max() <= right
        assert low <= band.y.min() < band.y.max() <= high
    signature = every["What shows it: asymmetric rate limit"]
    (limit,) = [line.label for line in signature.lines if line.kind == "law"]
    assert re.fullmatch(r"limits: \S+( %/s)? rising, 2\.9\d* %/s falling", limit)
    (far,) = [line for line in signature.lines if line.label == "recorded, falling"]
    speeds = far.y[far.x < -2.0 * FALLS_AT]
    assert speeds.size > 20
    assert np.mean(np.abs(speeds + FALLS_AT) < 0.1) > 0.95
