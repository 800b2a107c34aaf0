"""The health indicator: how much worse a valve follows the network trained on it in good days."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stemwatch.models.limits import Limits
from stemwatch.models.narx.baseline import score_baseline
from stemwatch.models.narx.example import NarxExample
from stemwatch.models.narx.network import NarxNetwork
from stemwatch.models.narx.training import train


def stem(u: np.ndarray, S: float, J: float) -> np.ndarray:
    """Stick-slip by force balance, written anew for these tests."""
    y, moving, side = [u[0]], False, 1
    for k in range(1, u.size):
        moving = moving and side * (u[k] - u[k - 1]) > 0
        if not moving and abs(u[k] - y[-1]) > (S + J) / 2:
            moving, side = True, 1 if u[k] > y[-1] else -1
        y.append(u[k] - side * (S - J) / 2 if moving else y[-1])
    return np.array(y)


def record(S: float, J: float, seed: int, n: int = 1200) -> tuple[np.ndarray, np.ndarray]:
    """OP and MV of a loop that wanders and is stepped now and then."""
    rng = np.random.default_rng(seed)
    t = np.arange(n)
    op = 50 + 5 * np.sin(t / 23 + seed) + 4 * np.sin(t / 41) + rng.normal(0, 0.05, n)
    for at in range(100, n, 150):
        op[at:] += 3 * np.sign(np.sin(at * (seed + 1)))
    return op, stem(op, S, J) + rng.normal(0, 0.1, n)


@pytest.fixture(scope="module")
def network() -> NarxNetwork:
    op, mv = record(1.5, 0.5, seed=0, n=1800)
    example = NarxExample(
        valve="FV-1",
        op=op,
        mv=mv,
        usable=np.ones(1800, dtype=bool),
        train_until=1200,
        interval_s=5.0,
    )
    fit = train([example])[0]
    assert fit.network is not None, fit.reason
    return fit.network


ALL = np.ones(1200, dtype=bool)


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_a_valve_that_has_not_changed_stays_below_the_alarm(
    network: NarxNetwork, seed: int
) -> None:
    """New records of the same valve, other operation: near the reference."""
    score = score_baseline(network, *record(1.5, 0.5, seed), ALL, interval_s=5.0)
    assert score.ratio is not None, score.reason
    assert 0.5 < score.ratio < 1.8


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_a_valve_whose_stiction_has_grown_is_above_the_alarm(
    network: NarxNetwork, seed: int
) -> None:
    """The same operation with S from 1.5 to 6 %."""
    score = score_baseline(network, *record(6.0, 2.0, seed), ALL, interval_s=5.0)
    assert score.ratio is not None, score.reason
    assert score.ratio > Limits().baseline_ratio_watch


def test_the_score_is_the_restarted_free_runs_error(network: NarxNetwork) -> None:
    """rmse of the run restarted every 100 samples, and its ratio to the reference."""
    op, mv = record(2.0, 0.5, 1)
    score = score_baseline(network, op, mv, ALL, interval_s=5.0)
    error = (network.free_run(op, mv, horizon=100) - mv)[2:]
    assert score.rmse == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-12)
    assert score.ratio == pytest.approx(score.rmse / network.reference_rmse, rel=1e-12)
    assert (score.samples, score.outside_share) == (1198, 0.0)


def test_another_horizon_gives_an_error_but_no_ratio(network: NarxNetwork) -> None:
    """Errors over different lengths are not compared with each other."""
    score = score_baseline(network, *record(1.5, 0.5, 1), ALL, interval_s=5.0, horizon=30)
    assert score.rmse is not None
    assert score.ratio is None


def test_another_interval_is_refused(network: NarxNetwork) -> None:
    """A network counts samples, so samples at another pace mean something else."""
    score = score_baseline(network, *record(1.5, 0.5, 1), ALL, interval_s=1.0)
    assert score.rmse is None
    assert score.reason is not None
    assert "trained at one sample every 5 s and this record has one every 1 s" in score.reason


def test_an_operation_never_trained_on_is_refused(network: NarxNetwork) -> None:
    """Most of the record is outside the training range, so there is no score."""
    op, mv = record(1.5, 0.5, 1)
    score = score_baseline(network, op + 45, mv + 45, ALL, interval_s=5.0)
    assert score.ratio is None
    assert score.reason is not None
    assert "outside the range the baseline network was trained on" in score.reason
    assert score.outside_share > 0.9


def test_a_short_excursion_is_left_out_of_the_score(network: NarxNetwork) -> None:
    """What happens outside the training range does not count, whatever MV does there."""
    op, mv = record(1.5, 0.5, 2)
    op[500:600] = 99.0
    first = score_baseline(network, op, mv, ALL, interval_s=5.0)
    mv[500:600] = -300.0
    second = score_baseline(network, op, mv, ALL, interval_s=5.0)
    assert first == second
    assert second.outside_share == pytest.approx(100 / 1200)
    assert second.samples == 1200 - 100 - 4


def test_too_few_samples_are_refused(network: NarxNetwork) -> None:
    """A handful of samples is no score."""
    usable = np.arange(1200) < 90
    score = score_baseline(network, *record(1.5, 0.5, 1), usable, interval_s=5.0)
    assert score.rmse is None
    assert score.reason is not None
    assert "too few usable samples to score: 88" in score.reason


def test_gaps_are_not_scored(network: NarxNetwork) -> None:
    """Unusable samples may hold anything."""
    op, mv = record(1.5, 0.5, 3)
    usable = ALL.copy()
    usable[300:340] = False
    first = score_baseline(network, op, mv, usable, interval_s=5.0)
    mv[300:340], op[300:340] = np.nan, np.inf
    assert first == score_baseline(network, op, mv, usable, interval_s=5.0)
    assert first.samples == 1200 - 40 - 4


def test_arrays_of_different_lengths_are_refused(network: NarxNetwork) -> None:
    """The caller's mistake is named."""
    with pytest.raises(ValueError, match=r"one length expected, received \(5,\), \(4,\)"):
        score_baseline(network, np.zeros(5), np.zeros(4), np.ones(5, dtype=bool), interval_s=5.0)


@settings(max_examples=40, deadline=None)
@given(
    values=st.lists(
        st.tuples(st.floats(), st.floats()) | st.just((50.0, 1e14)), min_size=1, max_size=30
    ),
    inside=st.booleans(),
)
def test_whatever_the_numbers_are_the_score_is_finite_or_has_a_reason(
    network: NarxNetwork, values: list[tuple[float, float]], inside: bool
) -> None:
    """No input raises and no ratio is infinite or not a number."""
    op, mv = np.resize(np.array(values), (600, 2)).T.copy()
    if inside:
        op = 50 + 5 * np.sin(np.arange(600) / 20)
    score = score_baseline(network, op, mv, np.ones(600, dtype=bool), interval_s=5.0)
    assert (score.ratio is None) == (score.reason is not None)
    assert score.ratio is None or np.isfinite([score.ratio, score.rmse]).all()
