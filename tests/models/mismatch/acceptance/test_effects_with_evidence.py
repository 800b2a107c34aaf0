"""What stands beside an effect."""

from __future__ import annotations

from stemwatch.models.mismatch.explain import explain
from stemwatch.models.studies.simulator.hidden import draw_hidden, simulate_hidden


def test_no_effect_is_said_to_be_another_that_is_named_beside_it() -> None:
    """Both are needed, so that neither stands in for the other: a tight spot beside a rate limit
    was "a tight spot, or a rate limit"."""
    case = draw_hidden(400, 2119)[291]
    _, run = simulate_hidden(case)
    effects = explain(run.recording).effects
    assert {"rate_limit", "position_dependent_friction"} <= {effect.slug for effect in effects}
    for effect in effects:
        beside = {other.slug for other in effects if other is not effect}
        assert not beside & set(effect.members)
