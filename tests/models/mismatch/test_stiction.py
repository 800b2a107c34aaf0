"""The interval of J where the recording does not need a jump."""

from __future__ import annotations

import numpy as np
import pytest

from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.findings import Stiction
from stemwatch.models.mismatch.fit.batched_search import conclude
from stemwatch.models.mismatch.fit.crossfit import LOOK, crossfit
from stemwatch.models.mismatch.stiction import holding_no_jump
from tests.models.mismatch.fitted_chain import (
    candidate,
    evaluator_of,
    hypothesis,
    simulated_by_chain,
)

SURE = Stiction(
    S=Estimate(value=4.1, low=4.0, high=4.3, unit="%"),
    J=Estimate(value=0.6, low=0.4, high=0.8, unit="%"),
)


@pytest.mark.parametrize("J", [0.0, 1.2])
def test_the_interval_of_J_includes_zero_where_no_block_needs_a_jump(J: float) -> None:
    """Beside a drag: a stem that does not jump gets the end that was too sure; one that does keeps
    its interval, and so does one whose interval holds 0 already."""
    drag = {"viscous_drag": [4.0]}
    evaluator = evaluator_of(simulated_by_chain(4.0, J, **drag))
    layout = evaluator.layout(hypothesis(*drag))
    start = candidate(layout, 4.0, max(J, 0.2), **drag)
    fitted = conclude(evaluator, crossfit(evaluator, layout, start[None], LOOK))
    told = holding_no_jump(evaluator, fitted, SURE)
    if J > 0.0:
        assert told == SURE
        return
    assert (told.J.value, told.J.low, told.J.high) == (0.6, 0.0, 0.8)
    assert told.S.low <= 4.0 <= told.S.high
    assert np.isclose(told.S.value, 4.1)
    assert holding_no_jump(evaluator, fitted, told) == told
