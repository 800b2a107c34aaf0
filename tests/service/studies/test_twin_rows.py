"""The study of twins: what is counted of each figure of each change."""

from __future__ import annotations

import pytest

from stemwatch.models.estimate import Estimate
from stemwatch.service.studies.twin import FALL, PredictedFigure, PredictedLoop, figure_rows


def figure(value: float | None, truth: float | None) -> PredictedFigure:
    """A fall of the variance by a repair, known to 10 percent points."""
    predicted = (
        Estimate.unknown("no swing")
        if value is None
        else Estimate(value=value, low=value - 10.0, high=value + 10.0)
    )
    return PredictedFigure(change="repaired", figure=FALL, predicted=predicted, truth=truth)


def test_figures_without_a_number_are_counted_neither_as_right_nor_as_wrong() -> None:
    """The error is a share of the truth; an interval holds or does not."""
    loops = [
        PredictedLoop(tag="A", figures=(figure(50.0, 40.0),)),
        PredictedLoop(tag="B", figures=(figure(20.0, 40.0), figure(None, 40.0))),
        PredictedLoop(tag="C", reason="no PV"),
    ]
    row = next(row for row in figure_rows(loops) if row.figure == FALL)
    assert (row.change, row.figures, row.holds, row.of) == ("repaired", 2, 1, 2)
    assert row.error == pytest.approx(0.375)
