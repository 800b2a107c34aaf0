"""What is drawn behind MV against OP: the curve from OP to stroke, and the stick band about it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stemwatch.models.estimate import Estimate
from stemwatch.models.recording import Role, Signal
from stemwatch.models.stickslip.stroke_curve import StrokeCurve
from stemwatch.service.report.charts.loop_shapes import loop_shapes
from stemwatch.service.report.charts.valve_charts import chart_of
from tests.service.report.conftest import screening, stick_slip, unknown

KNOTS = np.linspace(0.0, 100.0, 33)
BENT = StrokeCurve(op=tuple(KNOTS), travel=tuple(KNOTS**2 / 100.0))
SLIDE = 0.5 * (5.2 - 2.1)


def bent(curve: StrokeCurve = BENT):
    """A sticking valve behind ``curve``, with S and J restated in percent of OP."""
    result = screening("FV-1")
    op = result.recording.op.values
    mv = stick_slip(curve.command(op), 5.2, 2.1)
    signals = {**result.recording.signals, Role.MV: Signal.good(mv, "FV-1.MV")}
    return replace(
        result,
        recording=replace(result.recording, signals=signals),
        S=curve.in_op(Estimate(value=5.2, unit="%")),
        J=curve.in_op(Estimate(value=2.1, unit="%")),
        stroke_curve=curve,
    )


def shapes_of(result):
    return loop_shapes(result, result.recording.op.values, result.recording.mv.values)


def test_the_curve_runs_through_the_middle_of_the_loop():
    """Over the part of OP that the recording used, at the travel that the curve asks for."""
    result = bent()
    op, travel = shapes_of(result).curve.T
    low, high = np.percentile(result.recording.op.values, [1.0, 99.0])
    assert (op[0], op[-1]) == (pytest.approx(low), pytest.approx(high))
    np.testing.assert_allclose(travel, BENT.command(op), atol=0.3)


@pytest.mark.parametrize("way", [1.0, -1.0], ids=["rising", "reversed"])
def test_the_band_lies_about_the_curve(way):
    """Each slide is (S - J)/2 of travel off the curve everywhere, however steep the curve is."""
    curve = BENT if way > 0 else StrokeCurve(op=BENT.op, travel=tuple(100.0 - KNOTS**2 / 100.0))
    shapes = shapes_of(bent(curve))
    op, stem = shapes.band.T
    off = np.abs(stem - curve.command(op))
    slides = (off > SLIDE - 0.3) & (off < SLIDE + 0.3)
    assert slides.mean() > 0.9
    assert off.max() == pytest.approx(SLIDE + 2.1, abs=0.4)  # where a rest ends


def test_a_plain_valve_has_a_band_of_six_corners_and_no_curve():
    """S wide and J high, as without a curve."""
    shapes = shapes_of(screening("FV-1", S=6.0, J=3.0))
    assert shapes.curve is None
    assert shapes.caption == ""
    (x0, y0), (x1, y1), (x2, y2), *_ = shapes.band
    assert (x0 - x1, y0 - y1) == (pytest.approx(6.0), pytest.approx(0.0))
    assert (x1 - x2, y1 - y2) == (pytest.approx(0.0), pytest.approx(3.0))


def test_without_numbers_the_curve_is_drawn_alone():
    """How OP strokes the valve is known although S is not."""
    shapes = shapes_of(replace(bent(), S=unknown("why"), J=unknown("why")))
    assert shapes.band is None
    assert shapes.curve is not None


def test_the_chart_of_the_report_has_both_and_the_sentence():
    """Band first, so that the curve lies over it."""
    loop = chart_of(bent())["loop"]
    assert [shape["role"] for shape in loop["shapes"]] == ["band", "curve"]
    assert loop["says"].startswith(BENT.sentence())
    assert BENT.proposal() in loop["says"]
    assert all(len(shape["op"]) == len(shape["values"]) for shape in loop["shapes"])


def test_nothing_is_drawn_behind_pv():
    """PV is not travel, so neither curve nor band belongs there."""
    result = bent()
    signals = dict(result.recording.signals)
    del signals[Role.MV]
    assert (
        chart_of(replace(result, recording=replace(result.recording, signals=signals)))["loop"][
            "shapes"
        ]
        == []
    )


def test_the_band_lies_where_the_loops_turn_and_not_at_a_rare_large_move():
    """Two large moves in an hour; the loops between them turn much earlier."""
    result = screening("FV-1", S=3.0, J=1.0)
    seconds = result.recording.time_s
    amplitude = np.where(seconds < seconds[-1] / 12.0, 20.0, 4.0)
    op = 50.0 + amplitude * np.sin(2.0 * np.pi * seconds / 240.0)
    corners = loop_shapes(result, op, stick_slip(op, 3.0, 1.0)).band
    assert corners is not None
    assert corners[:, 0].max() == pytest.approx(54.0, abs=0.3)
    assert corners[:, 0].min() == pytest.approx(46.0, abs=0.3)
