"""S and J that grow together leave the stem at rest where it was."""

from __future__ import annotations

import numpy as np
import pytest

from stemwatch.models.mismatch.fit.base_coordinate import S_and_J
from stemwatch.models.mismatch.likelihood.maximum_likelihood import RecordLikelihood
from stemwatch.models.mismatch.search.same_rests import along_the_ridge
from tests.models.mismatch.fitted_chain import (
    candidate,
    evaluator_of,
    hypothesis,
    simulated_by_chain,
)


def test_a_point_with_the_right_rests_and_the_wrong_jump_finds_the_right_one():
    """In noise a climb from it ends on the next top, which is why other J are looked at."""
    evaluator = evaluator_of(simulated_by_chain(noise=0.3, samples=3600))
    likelihood, layout = RecordLikelihood(evaluator), evaluator.layout(hypothesis())
    begun = likelihood.at(
        layout, np.append(candidate(layout, 2.9, 0.1), likelihood.first_of_record)
    )
    found = along_the_ridge(likelihood, begun)
    assert found.total > likelihood.climbed(begun).total + 10.0
    assert S_and_J(found.candidate) == pytest.approx((4.0, 1.2), abs=0.15)
