"""The signature plot shows its effect: a limit is flat, a delay is a peak."""

from __future__ import annotations

import numpy as np
import pytest

from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.evidence.effect_signature import Moves, effect_signature, later
from stemwatch.models.mismatch.terms import catalogue
from stemwatch.models.mismatch.terms.rate_limit import limited

N = 2000


def command(seed: int = 3) -> np.ndarray:
    """Steps of up to 20 % every 20 samples."""
    return np.repeat(np.random.default_rng(seed).uniform(30.0, 70.0, N // 20), 20)


def moves(op: np.ndarray, mv: np.ndarray, late_s: float = 0.0, **parameters: float) -> Moves:
    named = {name: Estimate(value=value, unit="") for name, value in parameters.items()}
    return Moves(op, mv, 1.0, late_s, named)


def test_a_limited_stem_does_not_move_faster_however_far_it_is():
    """Every point of a valve limited to 4 %/s lies on the fitted law, flat from 4 % on."""
    op, mv = command(), np.empty(N)
    limited(op, np.zeros(N, dtype=np.int8), 1.0, 0.25, mv)
    result = effect_signature("rate_limit", moves(op, mv, rate=4.0))
    assert result is not None
    (law,) = result.laws
    assert np.abs(result.y - np.interp(result.x, law.x, law.y)).max() < 1e-9
    assert law.y.max() == pytest.approx(4.0)
    assert np.abs(result.x).max() > 10.0


def test_a_lag_is_a_slope_of_its_time_constant():
    """Speed is proportional to the error: no part of the plot is flat."""
    op, mv = command(), np.empty(N)
    mv[0] = op[0]
    for k in range(1, N):
        mv[k] = mv[k - 1] + (1.0 - np.exp(-1.0 / 4.0)) * (op[k] - mv[k - 1])
    result = effect_signature("actuator_lag", moves(op, mv, tau=4.0))
    assert result is not None
    (law,) = result.laws
    inside = (result.x > law.x[0]) & (result.x < law.x[-1])
    assert np.abs(result.y - np.interp(result.x, law.x, law.y))[inside].max() < 1e-9
    assert np.all(np.diff(law.y) > 0.0)


def test_a_spring_with_hysteresis_is_behind_by_more_the_farther_it_has_gone_since_the_turn():
    """Rising and falling alike, from the first turn on."""
    place = np.concatenate([np.linspace(40, 60, 81), np.linspace(59.75, 40, 80)] * 2)
    since = np.concatenate([place[:81] - 40, 60 - place[81:161]] * 2)
    way = np.concatenate([np.ones(81), -np.ones(80)] * 2)
    behind = 1.5 * np.minimum(since / 6.0, 1.0)
    moves = Moves(place + way * behind, place, 1.0, 0.0, {})
    shown = effect_signature("spring_hysteresis", moves)
    assert shown is not None
    after_turn = shown.x > 0.25
    assert np.count_nonzero(after_turn) > 200
    np.testing.assert_allclose(
        shown.y[after_turn], 1.5 * np.minimum(shown.x[after_turn] / 6.0, 1.0)
    )
    assert set(shown.rising[after_turn].tolist()) == {True, False}


def test_the_moves_are_most_alike_at_the_dead_time():
    """The correlation peaks at the delay."""
    op = np.cumsum(np.random.default_rng(5).normal(0.0, 1.0, N)) + 50.0
    result = effect_signature("dead_time", moves(op, later(op, 3.0, 1.0), theta=3.0))
    assert result is not None
    assert result.joined
    assert result.x[np.argmax(result.y)] == pytest.approx(3.0, abs=0.2)


def test_taking_later_holds_gaps_and_begins_unknown():
    """Between samples by a straight line; before the first sample, and next to a gap, nothing."""
    values = np.array([0.0, 1.0, 2.0, np.nan, 4.0, 5.0])
    np.testing.assert_array_equal(later(values, 1.0, 1.0), [np.nan, 0.0, 1.0, 2.0, np.nan, 4.0])
    np.testing.assert_array_equal(later(values, 0.5, 1.0), [np.nan, 0.5, 1.5, np.nan, np.nan, 4.5])


@pytest.mark.parametrize("slug", sorted(catalogue()))
def test_every_effect_of_the_catalogue_has_a_signature_plot(slug):
    """No effect is without its plot, and none breaks on a stem that slips now and then."""
    op = command()
    mv = np.repeat(op[::40], 40)[:N] + np.random.default_rng(1).normal(0.0, 0.05, N)
    result = effect_signature(slug, moves(op, mv))
    if result is None:  # an effect that shows in slips only, of which there are too few
        assert slug in {"asymmetric_slip", "lost_motion", "dwell_dependent_breakaway"}
        return
    assert result.x.shape == result.y.shape == result.rising.shape
    assert np.isfinite(result.x).all()
    assert result.x_label
    assert result.caption.endswith(".")


def test_an_effect_of_another_version_shows_nothing():
    """An unknown effect is left out without an error."""
    assert effect_signature("of_tomorrow", moves(command(), command())) is None
