"""The picture: true to the numbers, and readable without colour."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stemwatch.models.estimate import Estimate
from stemwatch.models.recording import Role, Signal
from stemwatch.models.stickslip.stroke_curve import StrokeCurve
from stemwatch.service.maintenance.drawing import (
    DrawnArea,
    DrawnLine,
    DrawnText,
    Panel,
    hatching,
    span,
    svg_of,
)
from stemwatch.service.maintenance.evidence_picture import NO_SAMPLES, NOTHING_TO_DRAW, picture_of
from tests.service.report.conftest import recording, screening, unknown, without_mv


def picture_for(result):
    """The picture of a screening with its own samples."""
    return picture_of(result, result.recording, UTC)


def words(picture) -> list[str]:
    """Everything that is written in it."""
    return [mark.text for mark in picture.marks if isinstance(mark, DrawnText)]


def test_both_views_are_there_and_told_apart_by_their_lines():
    """OP dashed, MV solid and thick, the model dotted; the stick band hatched."""
    picture, note = picture_for(screening("FV-1"))
    named = {"OP", "MV", "model", "recorded", "stick band of S and J", "OP, %", "MV, %"}
    assert named <= set(words(picture))
    styles = {(mark.width, mark.dash) for mark in picture.marks if isinstance(mark, DrawnLine)}
    assert len({style for style in styles if style[0] >= 0.7}) >= 4
    assert any(isinstance(mark, DrawnArea) and mark.hatch for mark in picture.marks)
    assert note.startswith("A typical stretch of the record, from 2026-03-02 ")


def test_the_curve_from_op_to_stroke_is_drawn_where_there_is_one():
    """As a line of its own, named in the legend, and said to who cannot see it."""
    plain = screening("FV-1")
    half = StrokeCurve(op=(0.0, 50.0), travel=(0.0, 50.0))
    picture, _ = picture_for(replace(plain, stroke_curve=half))
    assert "curve from OP to stroke" in words(picture)
    assert "curve from OP to stroke" in picture.caption
    before, _ = picture_for(plain)
    assert "curve from OP to stroke" not in words(before)


def test_nothing_is_coloured():
    """Every stroke and fill of the SVG is a grey."""
    picture, _ = picture_for(screening("FV-1"))
    text = str(svg_of(picture))
    colours = {part[:7] for part in text.split("#")[1:]}
    assert colours
    assert all(colour[:2] == colour[2:4] == colour[4:6] for colour in colours)


def test_every_mark_lies_inside_the_picture():
    """Nothing is cut off at the edge of the paper."""
    picture, _ = picture_for(screening("FV-1", S=9.0, J=4.0))
    for mark in picture.marks:
        points = (mark.at,) if isinstance(mark, DrawnText) else mark.points
        for x, y in points:
            assert -0.1 <= x <= picture.width + 0.1
            assert -0.1 <= y <= picture.height + 0.1


def corners_of(result) -> tuple[tuple[float, float], ...]:
    """The corners of the stick band, in points."""
    picture, _ = picture_for(result)
    bands = [
        mark for mark in picture.marks if isinstance(mark, DrawnArea) and len(mark.points) == 6
    ]
    return bands[0].points if bands else ()


def test_the_stick_band_has_the_width_of_s_and_the_step_of_j():
    """Twice the S is twice as wide on the same scale; J is the height of its steps."""
    result = screening("FV-1", S=6.0, J=3.0)
    (x0, y0), (x1, y1), (x2, y2), *_ = corners_of(result)
    assert y0 == pytest.approx(y1)
    assert x1 == pytest.approx(x2)
    # The slides rise one for one, so that the two ratios below are on the axes' own scales.
    other = replace(result, J=Estimate(value=1.5, unit="%"))
    (a0, _), (a1, b1), (_, b2), *_ = corners_of(other)
    assert (a0 - a1) == pytest.approx(x0 - x1, rel=0.02)
    assert (b2 - b1) == pytest.approx(0.5 * (y2 - y1), rel=0.1)


@pytest.mark.parametrize("S", [None, 0.0, 400.0])
def test_no_band_is_drawn_where_s_does_not_describe_one(S):
    """Unknown, nothing, or more than OP ever moved."""
    estimate = unknown("why") if S is None else Estimate(value=S, unit="%")
    assert corners_of(replace(screening("FV-1"), S=estimate)) == ()


def test_without_a_position_op_and_pv_are_drawn():
    """A valve that nobody measures still shows its loop."""
    picture, _ = picture_for(without_mv("PV-1"))
    assert {"OP", "PV", "m³/h"} <= set(words(picture))
    assert "MV" not in words(picture)


def test_why_there_is_no_picture_is_said():
    """No samples at all, or none of OP."""
    result = screening("FV-1", samples=60)
    assert picture_of(result, None, UTC) == (None, NO_SAMPLES)
    dead = Signal.good(np.full(60, np.nan), "OP")
    blank = replace(recording("FV-1", 3, 1, samples=60), signals={Role.OP: dead})
    assert picture_of(result, blank, UTC) == (None, NOTHING_TO_DRAW)


def test_a_hole_is_a_hole():
    """No line is drawn across samples that are missing."""
    panel = Panel(left=0, top=0, width=100, height=50, x0=0, x1=9, y0=0, y1=1)
    y = np.arange(10) % 2.0
    y[4:6] = np.nan
    lines = panel.lines(np.arange(10.0), y, 1.0)
    assert [len(line.points) for line in lines] == [4, 4]


def test_a_rest_is_drawn_by_its_ends():
    """Of a level or upright stretch the two ends are kept, and every point where it turns back."""
    panel = Panel(left=0, top=0, width=100, height=100, x0=0, x1=10, y0=0, y1=10)
    x = np.array([0.0, 1.0, 2.0, 3.0, 3.0, 3.0, 4.0, 6.0, 5.0, 7.0])
    y = np.array([1.0, 1.0, 1.0, 1.0, 2.0, 4.0, 4.0, 4.0, 4.0, 9.0])
    (line,) = panel.lines(x, y, 1.0)
    kept = [(0.0, 90.0), (30.0, 90.0), (30.0, 60.0), (60.0, 60.0), (50.0, 60.0), (70.0, 10.0)]
    assert line.points == tuple(kept)


def test_a_flat_line_has_room_around_it():
    """A constant is drawn in the middle, and nothing at all on an axis of some kind."""
    low, high = span(np.full(5, 3.0))
    assert low < 3.0 < high
    assert span(np.full(3, np.nan)) == (0.0, 1.0)


@given(
    st.lists(st.tuples(st.floats(0, 100), st.floats(0, 100)), min_size=3, max_size=7),
    st.floats(2, 20),
)
def test_a_hatch_stays_inside_its_area(points, step):
    """The middle of every line lies inside the polygon, by the crossing rule."""
    area = DrawnArea(tuple(points), hatch=step)
    for line in hatching(area):
        (x0, y0), (x1, y1) = line.points
        if abs(x1 - x0) > 1e-3:
            assert inside(points, 0.5 * (x0 + x1), 0.5 * (y0 + y1))


def inside(points, x: float, y: float) -> bool:
    """Whether a ray along the hatch crosses the edges an odd number of times."""
    level, crossed = x + y, 0
    for (x0, y0), (x1, y1) in zip(points, [*points[1:], points[0]], strict=True):
        here, there = x0 + y0 - level, x1 + y1 - level
        if (here < 0) != (there < 0):
            crossed += x0 + (x1 - x0) * here / (here - there) > x
    return crossed % 2 == 1


def test_hostile_words_are_text():
    """A unit may be called anything."""
    result = screening("FV-1")
    signals = dict(result.recording.signals)
    signals[Role.PV] = replace(signals[Role.PV], unit="</text><script>")
    signals.pop(Role.MV)
    picture, _ = picture_of(result, replace(result.recording, signals=signals), UTC)
    assert "<script>" not in str(svg_of(picture))
    assert "&lt;script&gt;" in str(svg_of(picture))
