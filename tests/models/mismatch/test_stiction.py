"""S and J of a fit whose J is not needed, and those of the likelihood of the whole record."""

from __future__ import annotations

import numpy as np
import pytest

from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.findings import Stiction
from stemwatch.models.mismatch.fit.batched_search import conclude
from stemwatch.models.mismatch.fit.crossfit import LOOK, crossfit, scored
from stemwatch.models.mismatch.stiction import holding_no_jump, of_likelihood
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


def read_from(recording, S: float, J: float) -> Stiction | None:
    """S and J of the likelihood, begun at those where a fit has ended."""
    evaluator = evaluator_of(recording)
    layout = evaluator.layout(hypothesis())
    row = candidate(layout, S, J)
    return of_likelihood(evaluator, conclude(evaluator, scored(layout, np.vstack((row, row)))))


@pytest.mark.parametrize("noise", [0.05, 0.3])
def test_the_likelihood_reads_S_and_J_from_where_a_run_ends_too_low(noise: float) -> None:
    """A run lets go too soon, and with an S that is as much too small the stem comes to rest in the
    right places."""
    told = read_from(simulated_by_chain(noise=noise, samples=3600), 3.1, 0.3)
    assert told is not None
    assert told.by_likelihood
    assert (told.S.value, told.J.value) == pytest.approx((4.0, 1.2), abs=0.12)
    assert told.S.low < 4.0 < told.S.high
    assert told.J.low < 1.2 < told.J.high


def test_the_likelihood_is_silent_where_breakaways_hardly_reach_beyond_the_noise() -> None:
    """The fit has all there is."""
    assert read_from(simulated_by_chain(0.2, 0.05), 0.2, 0.05) is None


def test_the_likelihood_is_silent_where_a_sample_of_OP_passes_the_jump() -> None:
    """No sample shows then where the stem let go."""
    assert read_from(simulated_by_chain(4.0, 0.02), 4.0, 0.02) is None
