"""S and J as travel: through the stroke, and through the curve from OP to stroke."""

from __future__ import annotations

from dataclasses import replace

import pytest

from stemwatch.models.stickslip.stroke_curve import StrokeCurve
from stemwatch.service.maintenance.work_sheet import sizes_of
from tests.service.report.conftest import screening

FOUND = screening("FV-1", S=5.0, J=2.0, samples=60)
SPLIT = StrokeCurve(op=(0.0, 50.0), travel=(0.0, 100.0))  # half of OP strokes the whole valve


def test_without_a_curve_all_of_op_is_the_stroke() -> None:
    """5 % of 40 mm."""
    (S, J), note = sizes_of(FOUND, "40 mm")
    assert (S.travel, J.travel) == ("2.0 mm", "0.80 mm")
    assert "100 % of OP taken as the whole of it" in note


@pytest.mark.parametrize("way", [1.0, -1.0], ids=["air to open", "air to close"])
def test_behind_a_split_range_the_stem_moves_twice_as_far(way: float) -> None:
    """The same 5 % of OP are 10 % of the stroke."""
    curve = SPLIT if way > 0 else replace(SPLIT, travel=(100.0, 0.0))
    (S, J), note = sizes_of(replace(FOUND, stroke_curve=curve), "40 mm")
    assert (S.percent, S.travel, J.travel) == ("5.00 %", "4.0 mm", "1.6 mm")
    assert "1 % of OP moves the stem 2.0 % of it" in note


def test_no_travel_is_made_up_where_the_slope_is_not_known() -> None:
    """S in percent of OP stays."""
    unknown = replace(SPLIT, slope_known=False)
    (S, J), note = sizes_of(replace(FOUND, stroke_curve=unknown), "40 mm")
    assert (S.percent, S.travel, J.travel) == ("5.00 %", "", "")
    assert "not known" in note
