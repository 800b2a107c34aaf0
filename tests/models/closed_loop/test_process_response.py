"""How PV responds to the valve: gain, lag, integrating processes, and when the gain is unknown."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from stemwatch.models.closed_loop import process_model
from stemwatch.models.closed_loop.process_response import ProcessResponse, process_response
from stemwatch.models.recording import Recording, Role, Signal


def _moves(n: int = 1800) -> np.ndarray:
    rng = np.random.default_rng(5)
    return 50.0 + np.repeat(rng.uniform(-15.0, 15.0, n // 90), 90)


def _recording(mv: np.ndarray, pv: np.ndarray | None) -> Recording:
    signals = {Role.OP: Signal.good(mv, "OP"), Role.MV: Signal.good(mv, "MV")}
    if pv is not None:
        signals[Role.PV] = Signal.good(pv, "PV", "t/h")
    return Recording(valve="V", signals=signals, interval_s=1.0)


def _lagged(mv: np.ndarray, gain: float, lag_s: float, late: int) -> np.ndarray:
    out, here = np.empty(mv.size), mv[0]
    delayed = np.concatenate((np.full(late, mv[0]), mv[: mv.size - late]))
    for k, value in enumerate(delayed):
        here += (value - here) * (1.0 - np.exp(-1.0 / lag_s))
        out[k] = here
    return 120.0 + gain * out


def test_gain_and_sign_are_found_behind_lag_and_delay_in_noise():
    """A gain of -2.5 behind 12 s of lag and 5 s of delay is found to a twentieth."""
    mv = _moves()
    noise = np.random.default_rng(1).normal(0.0, 1.0, mv.size)
    seen = process_response(_recording(mv, _lagged(mv, -2.5, 12.0, 5) + noise))
    assert seen.gain.value == pytest.approx(-2.5, rel=0.05)
    assert seen.gain.low <= seen.gain.value <= seen.gain.high
    assert not seen.integrating
    assert seen.unit == "t/h"


def test_level_integrates():
    """A level integrates the valve's travel: the gain is per second, and a pulse leaves its
    area.
    """
    mv = _moves()
    pv = 40.0 + np.cumsum(0.01 * (mv - mv.mean()))
    seen = process_response(_recording(mv, pv))
    assert seen.integrating
    assert seen.gain.value == pytest.approx(0.01, rel=0.05)
    bump = np.full(100, 50.0)
    bump[10:40] = 52.0
    assert seen.upset(bump, 1.0) == pytest.approx(0.6, rel=0.1)


def test_upset_takes_the_end_of_the_interval_that_is_farther_from_zero():
    """A gain of 1 to 3 gives an upset of 3 for each percent."""
    from stemwatch.models.estimate import Estimate

    seen = ProcessResponse(gain=Estimate(value=-2.0, low=-3.0, high=-1.0))
    assert seen.upset(np.array([50.0, 51.0, 50.0, 47.0]), 1.0) == pytest.approx(9.0)


@pytest.mark.parametrize(
    ("pv", "why"),
    [
        (None, "no PV was recorded"),
        (np.full(1800, 7.0), "did not move"),
        (np.random.default_rng(2).normal(50.0, 3.0, 1800), "cannot be told from what else"),
    ],
)
def test_a_gain_that_cannot_be_found_is_unknown_with_a_reason(pv, why):
    """Without PV, or with one that is constant or unrelated, there is a reason and no gain."""
    seen = process_response(_recording(_moves(), pv))
    assert seen.gain.value is None
    assert why in seen.gain.reason
    assert seen.upset(np.array([50.0, 60.0]), 1.0) is None


def test_record_with_few_common_samples_has_no_gain():
    """Sixty common samples are too few."""
    mv = _moves()
    pv = np.where(np.arange(mv.size) < 60, mv, np.nan)
    assert "too short" in process_response(_recording(mv, pv)).gain.reason


@pytest.mark.parametrize("integrates", [False, True])
def test_a_delay_of_whole_samples_only_moves_the_answer(integrates):
    """The process that the grid takes is the cheapest of all its processes, each computed anew."""
    x, rng = _moves(), np.random.default_rng(7)
    pv = _lagged(x, 1.5, 12.0, 5) + np.cumsum(rng.normal(0.0, 0.2, x.size))
    problem = process_model._Whitened(x, pv, np.array([0.6, 0.2]), integrates)
    lags = (0.0,) if integrates else process_model.LAGS
    each = [
        process_model._coordinates(lag, second, delay)
        for lag, second, delay in product(lags, process_model.SECOND_LAGS, process_model.DELAYS)
        if integrates or second <= lag
    ]
    cheapest = min(each, key=problem.cost)
    assert cheapest == pytest.approx(problem.best_of_grid(lags), abs=0.0)
