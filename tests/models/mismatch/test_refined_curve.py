"""A curve from OP to stroke, corrected by an assimilated fit."""

from dataclasses import replace
from functools import cache

import numpy as np

from stemwatch.models.mismatch.explain import BENDS, explain
from stemwatch.models.mismatch.refined_curve import refined
from stemwatch.models.preparation.own_clock import on_own_clock
from stemwatch.models.stickslip.find_stroke_curve import EARLIER_USED
from stemwatch.models.stickslip.stroke_curve import StrokeCurve
from stemwatch.service.studies.robustness import WAYS, draw_valves, recorded


@cache
def bent():
    """A sticking valve whose position is ten times the root of OP, and OP as percent of travel."""
    recording = recorded(draw_valves(1, 5151)[0])
    stored = WAYS["square root between OP and stroke"].change(recording)
    return on_own_clock(stored), recording.op.values


def curve(off_percent: float) -> StrokeCurve:
    """The root over the OP that was used, off by a wave of ``off_percent`` of travel."""
    stored, _ = bent()
    low, high = np.percentile(stored.op.values, (0.5, 99.5)).tolist()
    knots = np.linspace(stored.op.values.min(), stored.op.values.max(), 41)
    wave = off_percent * np.sin(2.0 * np.pi * (knots - low) / (high - low))
    travel = np.maximum.accumulate(10.0 * np.sqrt(np.maximum(knots, 0.0)) + wave)
    return StrokeCurve(tuple(knots.tolist()), tuple(travel.tolist()), used=(low, high))


def off(curve_used: StrokeCurve) -> float:
    """How far the commands read through a curve scatter about the true ones, percent of travel."""
    stored, travel = bent()
    return float(np.std(curve_used.command(stored.op.values) - travel))


def test_a_wrong_curve_is_corrected():
    """A wave of 1.5 % of travel becomes smaller by at least a quarter."""
    stored, _ = bent()
    wrong = curve(1.5)
    better = refined(stored, wrong)
    assert off(wrong) > 0.5
    assert off(better) < 0.75 * off(wrong)


def test_a_right_curve_is_not_made_worse():
    """It stays as near to the true one as the recording allows."""
    stored, _ = bent()
    assert off(refined(stored, curve(0.0))) < 0.25


def test_what_a_person_gave_or_an_earlier_window_found_is_kept():
    """A curve with an unknown slope is not changed either, and without a curve there is none."""
    stored, _ = bent()
    wrong = curve(1.5)
    for kept in (
        replace(wrong, given=True),
        replace(wrong, slope_known=False),
        replace(wrong, remark=EARLIER_USED),
    ):
        assert refined(stored, kept) is kept
    assert refined(stored, None) is None


def test_bends_are_part_of_a_curve_that_was_found_and_not_of_one_that_was_given():
    """Bow and flow force are one class with the bends of the former."""
    stored, _ = bent()
    for given in (False, True):
        explanation = explain(stored, curve=replace(curve(0.0), given=given))
        untestable = {item.slug for item in explanation.not_testable}
        assert untestable.isdisjoint(BENDS) == given
