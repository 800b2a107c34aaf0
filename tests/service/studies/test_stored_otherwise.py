"""Valves of `stemwatch robustness` (seed 2129) that were answered wrongly, stored as they were."""

from __future__ import annotations

import pytest

from stemwatch.models.decision.residual import curve_is_enough
from stemwatch.models.recording import Recording
from stemwatch.models.screening.screen import Case, Options, screen
from stemwatch.models.screening_result import Screening
from stemwatch.models.stickslip.fit import fit_stickslip
from stemwatch.models.verdict import Verdict
from stemwatch.service.studies.robustness import WAYS, StudiedValve, draw_valves, recorded

# Drawing the valves takes half a minute.
pytestmark = pytest.mark.long

SQUARE_ROOT = "square root between OP and stroke"


@pytest.fixture(scope="module")
def valves() -> list[StudiedValve]:
    return draw_valves(40, 2129)


def stored(valve: StudiedValve, way: str) -> Recording:
    return WAYS[way].change(recorded(valve))


def screened(recording: Recording) -> Screening:
    (found,) = screen([Case(recording=recording)], Options(narx=False, mismatch=False))
    return found


def test_an_s_that_a_little_error_of_the_curve_explains_is_no_verdict(valves):
    """OP turns round seven times and the curve is 1.1 % of travel off: S of 1.9 % where it is 0.1 %
    is not certain, and the reason says what else fits."""
    found = screened(stored(valves[76], SQUARE_ROOT))
    assert found.verdict is Verdict.UNDETERMINED
    assert "a curve from OP to stroke that is a little different" in found.reason
    assert "curve" in found.advice


def test_a_curve_is_no_excuse_where_op_is_percent_of_travel(valves):
    """It is asked only of an OP that was read through a curve."""
    assert not curve_is_enough(fit_stickslip(recorded(valves[76])))


def test_a_sticking_valve_behind_a_curve_stays_sticky(valves):
    """Where the stem sticks, no curve follows it as well."""
    assert screened(stored(valves[0], SQUARE_ROOT)).verdict is Verdict.STICKY


@pytest.mark.parametrize(("place", "way"), [(1, SQUARE_ROOT), (71, "exception reporting of 0.5 %")])
def test_pv_and_set_point_are_not_taken_for_the_output(valves, place, way):
    """PV answers the position, and a set point changes less often than an output: neither is OP,
    even where the position goes with it better than with an OP that is not linear or stored by
    exception."""
    assert "seem swapped" not in screened(stored(valves[place], way)).reason
