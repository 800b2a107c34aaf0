"""RMSE and CDC against numbers worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from stemwatch.models.studies.reproduction.cases import CASES, SAMPLES_PER_PERIOD, PaperCase
from stemwatch.models.studies.reproduction.signals import paper_sine
from stemwatch.models.studies.reproduction.study import cdc_percent, rmse


def test_rmse_is_the_root_of_the_mean_square() -> None:
    """Errors 3, 4, 0, 0 have a mean square of 25/4."""
    simulated, truth = np.array([3.0, -3.0, 5.0, 1.0]), np.array([0.0, 1.0, 5.0, 1.0])
    assert rmse(simulated, truth) == 2.5


def test_rmse_is_taken_over_the_last_axis() -> None:
    """Two runs against one truth have two errors."""
    runs = np.array([[1.0, 1.0], [2.0, -2.0]])
    assert rmse(runs, np.zeros(2)).tolist() == [1.0, 2.0]


def test_cdc_counts_the_samples_at_which_both_go_the_same_way() -> None:
    """Of five steps: both up, up against down, truth at rest, model at rest, both down."""
    truth = np.array([0.0, 1.0, 2.0, 2.0, 3.0, 2.0])
    simulated = np.array([0.0, 0.5, 0.2, 0.9, 0.9, 0.1])
    assert cdc_percent(simulated, truth) == pytest.approx(100.0 * 2 / 5)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.shape.value)
def test_a_perfect_model_scores_the_share_of_moving_samples(case: PaperCase) -> None:
    """On the sine the stem rests while the input travels S: arccos(1 - S)/pi of the time."""
    y = case.respond(paper_sine())[SAMPLES_PER_PERIOD:]
    moving = 100.0 * (1.0 - np.arccos(1.0 - case.S) / np.pi)
    # Slips and turns fall on whole samples, hence the slack.
    assert cdc_percent(y, y) == pytest.approx(moving, abs=2.0)
