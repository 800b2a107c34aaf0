"""An effect stands where single breakaways of a free run speak against it; a wrong one does not."""

from __future__ import annotations

import pytest

from stemwatch.models.mismatch.explain import explain
from stemwatch.models.studies.simulator.hidden import draw_hidden


def named(place):
    """What is hidden in a quiet loop of seed 4090, and what is named first, if anything."""
    case = draw_hidden(place + 1, 4090)[place]
    effects = explain(case.simulated().recording).effects
    return case.hidden, effects[0].slug if effects else ""


@pytest.mark.parametrize("place", [554, pytest.param(707, marks=pytest.mark.long)])
def test_an_effect_stands_where_a_free_run_only_misses_breakaways(place):
    """The free run is worse with the right effect; the likelihood shows it and leaves nothing."""
    (hidden,), slug = named(place)
    assert slug == hidden


@pytest.mark.long
def test_a_wrong_effect_goes_where_the_likelihood_leaves_something():
    """Friction that depends on the place is not a zero error that a free run refutes."""
    hidden, slug = named(498)
    assert hidden == ("position_dependent_friction",)
    assert slug == ""
