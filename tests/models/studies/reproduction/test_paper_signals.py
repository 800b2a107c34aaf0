"""The inputs for training and for testing."""

from __future__ import annotations

import numpy as np
import pytest

from stemwatch.models.studies.reproduction.signals import (
    FAMILIES,
    LENGTH,
    paper_sine,
    training_input,
    unseen,
)


def test_the_training_record_begins_with_the_papers_sine() -> None:
    """Ours sees the paper's sine too, and more."""
    sine, record = paper_sine(), training_input()
    assert np.array_equal(record[: sine.size], sine)
    assert record.size > 20 * sine.size


def test_the_training_record_has_no_jump_between_its_parts() -> None:
    """The largest step is one of a random walk, not of a joint."""
    assert np.abs(np.diff(training_input())).max() < 0.4


@pytest.mark.parametrize("family", FAMILIES)
def test_an_unseen_input_does_not_depend_on_how_many_are_asked_for(family: str) -> None:
    """The second of two is the second of three."""
    assert np.array_equal(unseen(family, 2)[1], unseen(family, 3)[1])


@pytest.mark.parametrize("family", FAMILIES)
def test_unseen_inputs_have_one_length_and_a_size_that_moves_the_stem(family: str) -> None:
    """All have 1500 finite samples; their swing exceeds every S here, 0.6."""
    for u in unseen(family, 4):
        assert u.size == LENGTH
        assert np.isfinite(u).all()
        assert np.ptp(u) > 0.6


@pytest.mark.parametrize("family", FAMILIES)
def test_no_unseen_input_is_a_part_of_the_training_record(family: str) -> None:
    """No run of 20 samples of an unseen input occurs in the record."""
    record = np.lib.stride_tricks.sliding_window_view(training_input(), 20)
    for u in unseen(family, 3):
        gaps = np.abs(record - u[700:720]).max(axis=1)
        assert gaps.min() > 1e-9
