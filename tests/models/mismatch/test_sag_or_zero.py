"""A supply that sags is not told as a zero error, and a zero error stays one."""

from __future__ import annotations

import pytest

from stemwatch.models.mismatch.explain import explain
from stemwatch.models.studies.simulator.hidden import draw_effect, draw_hidden


def members(case):
    """The class of each effect that is named, its slug first."""
    return [effect.members for effect in explain(case.simulated().recording).effects]


@pytest.mark.long
def test_a_sag_in_a_short_record_is_given_beside_the_zero_error():
    """In a quarter of an hour the zero is the easier one to find, and the sag does as well."""
    case = draw_hidden(11, 2114)[10]
    assert case.hidden == ("supply_sag",)
    assert members(case) == [("zero_shift", "supply_sag")]


@pytest.mark.long
def test_the_record_as_a_whole_tells_a_sag_from_a_zero_error():
    """Trajectories give both; beside the sag, the likelihood needs no zero error."""
    case = draw_hidden(362, 2114)[361]
    assert case.hidden == ("supply_sag",)
    assert members(case) == [("supply_sag",)]


@pytest.mark.parametrize("index", [3, pytest.param(9, marks=pytest.mark.long)])
def test_a_zero_error_is_told_from_a_sag(index):
    """In noise and in a routine hour: the sag that comes nearest predicts unseen blocks worse."""
    case = draw_effect("zero_shift", index + 1, 4076, None)[index]
    assert members(case) == [("zero_shift",)]
