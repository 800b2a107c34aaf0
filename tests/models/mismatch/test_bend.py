"""A reading that is bent over the stroke is separated from one with a span error."""

from __future__ import annotations

import numpy as np
import pytest

from stemwatch.models.mismatch import evaluator as base_coordinate
from stemwatch.models.mismatch.acceptance_limits import convincing
from stemwatch.models.mismatch.batched_search import conclude
from stemwatch.models.mismatch.crossfit import curvature, scored
from tests.models.mismatch.fitted_chain import (
    candidate,
    evaluator_of,
    hypothesis,
    rescaled,
    simulated_by_chain,
)


def fitted(recording, **base):
    """The evaluator of a recording and the true S and J on both folds, ``base`` coordinates set."""
    evaluator = evaluator_of(recording)
    layout = evaluator.layout(hypothesis())
    row = candidate(
        layout, base={getattr(base_coordinate, name): value for name, value in base.items()}
    )
    return evaluator, conclude(evaluator, scored(layout, np.vstack((row, row))))


@pytest.mark.parametrize("bow", [1.0, -1.5])
def test_a_bowed_reading_is_found_by_a_cubic(bow):
    """S, J, zero and span leave an S-shaped residual over the stroke, which a cubic fits."""
    plain = simulated_by_chain()
    mv = plain.mv.values
    evaluator, result = fitted(rescaled(plain, mv + bow * np.sin(2.0 * np.pi * mv / 100.0)))
    assert convincing(curvature(evaluator, result), evaluator.measured_counts, "bend")


@pytest.mark.parametrize(("gain", "zero"), [(0.0, 0.0), (0.06, -1.0), (-0.08, 0.5)])
def test_zero_and_span_errors_are_not_a_bow(gain, zero):
    """With zero and span in the model, the residual does not depend on the travel."""
    recording = simulated_by_chain(base={base_coordinate.GAIN: gain, base_coordinate.ZERO: zero})
    evaluator, result = fitted(recording, GAIN=gain, ZERO=zero)
    assert not convincing(curvature(evaluator, result), evaluator.measured_counts, "bend")


def test_a_stem_that_never_moves_shows_no_bend():
    """Too few samples on a fold: no bend, and no crash."""
    evaluator, result = fitted(simulated_by_chain(samples=120))
    assert curvature(evaluator, result).mean < 0.04
