"""Who knows the plant's equations finds its play, unless it is as wide as a slip is high."""

from __future__ import annotations

import numpy as np
import pytest

from stemwatch.models.studies.simulator.hidden import draw_hidden
from tests.benchmarks.true_stem import FD, FS, NOISE, PLAY, SCATTER, SeenValve, true_numbers


def drawn(number: int) -> tuple[SeenValve, np.ndarray]:
    """A valve with play of the proof's draw, and its numbers."""
    case = draw_hidden(number + 1, 4090)[number]
    return SeenValve.of(case), true_numbers(case.loop)


@pytest.mark.long
def test_the_courses_follow_the_stem() -> None:
    """Readings lie about them as their noise does, but for what each breakaway's chance costs."""
    valve, truth = drawn(378)
    at_truth = valve.log_likelihood(truth)
    per_reading = np.log(truth[NOISE] * np.sqrt(2.0 * np.pi)) + 0.5
    assert -0.15 < at_truth / valve.reading.size + per_reading < 0.05
    for place in (FS, FD, SCATTER):
        other = truth.copy()
        other[place] *= 1.6
        assert valve.log_likelihood(other) < at_truth


@pytest.mark.long
def test_play_as_wide_as_a_slip_is_a_larger_s() -> None:
    """The first slip after a turn closes it, and the next one is whole."""
    valve, truth = drawn(378)
    assert truth[PLAY] == pytest.approx(truth[FS] - truth[FD], rel=0.05)
    larger = truth.copy()
    larger[PLAY] = 0.0
    larger[[FS, FD]] += 0.5 * truth[PLAY]
    assert valve.log_likelihood(larger) == pytest.approx(valve.log_likelihood(truth), abs=8.0)


@pytest.mark.long
def test_other_play_is_no_larger_s() -> None:
    """Of two thirds of a slip."""
    valve, truth = drawn(161)
    larger = truth.copy()
    larger[PLAY] = 0.0
    larger[[FS, FD]] += 0.5 * truth[PLAY]
    assert valve.log_likelihood(larger) < valve.log_likelihood(truth) - 100.0
