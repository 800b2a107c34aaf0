"""A slow actuator in a loop that hunts every few samples is no sticking stem."""

from __future__ import annotations

from dataclasses import replace

import pytest

from stemwatch.models.decision.residual import of_stiction, slow_actuator_is_enough
from stemwatch.models.mismatch.findings import Finding, HeldOutFit, Mismatch
from stemwatch.models.recording import Recording
from stemwatch.models.screening.screen import Case, Options, screen
from stemwatch.models.stickslip.fit import StickSlipFit, fit_stickslip
from stemwatch.models.studies.simulator import draw_healthy, simulate_loop
from stemwatch.models.verdict import Verdict


@pytest.fixture(scope="module")
def hunting() -> Recording:
    """A flow loop that hunts every ten seconds: its actuator takes 2.4 s, and S is 0.5 %."""
    return simulate_loop(draw_healthy(27, 6161)[26], 2).recording


@pytest.fixture(scope="module")
def fit(hunting: Recording) -> StickSlipFit:
    return fit_stickslip(hunting)


@pytest.mark.long
def test_it_is_healthy_and_its_actuator_is_told(hunting):
    """Its S is not that of sticking, nothing else is named, and the reason gives the lag."""
    (found,) = screen([Case(recording=hunting)], Options(narx=False))
    assert found.verdict is Verdict.HEALTHY
    assert found.S.value == pytest.approx(0.5, abs=0.2)
    assert found.mismatch is not None
    assert found.mismatch.effects == ()
    assert "the actuator takes about 2." in found.reason


def told(fit: StickSlipFit, ratio: float) -> Mismatch:
    """A mismatch that leaves ``ratio`` times of unseen samples what the fit leaves."""
    alone = of_stiction(fit, resynced=False)
    assert alone is not None
    heldout = HeldOutFit(rmse_naive=ratio * alone.rmse, fit_naive=50.0)
    return replace(Mismatch.unknown("-"), finding=Finding.UNKNOWN, heldout=heldout)


def test_what_follows_nearly_as_well_stands(fit):
    """A slow actuator is enough only where it leaves less than half; and nothing is taken back
    where nothing was missing."""
    assert slow_actuator_is_enough(fit, told(fit, 2.2))
    assert not slow_actuator_is_enough(fit, told(fit, 1.8))
    assert not slow_actuator_is_enough(fit, replace(told(fit, 2.2), finding=Finding.NONE))


def test_a_fit_without_an_actuator_is_not_enough(fit):
    """Friction alone is what the mismatch begins from."""
    assert not slow_actuator_is_enough(replace(fit, hypothesis="sticking"), told(fit, 9.0))
