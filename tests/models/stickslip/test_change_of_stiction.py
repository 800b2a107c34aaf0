"""A stem that was repaired, or whose packing was tightened, within one recording."""

from __future__ import annotations

import numpy as np
import pytest

from stemwatch.models.recording import Recording, Role, Signal
from stemwatch.models.screening.screen import Case, Options, screen
from stemwatch.models.stickslip.change_of_stiction import change_of_stiction
from stemwatch.models.stickslip.fit import fit_stickslip
from stemwatch.models.studies.simulator import draw_healthy, draw_sticky, simulate_loop
from stemwatch.models.verdict import Verdict
from tests.models.stick_slip_element import stick_slip


def half_and_half(first: tuple[float, float], second: tuple[float, float]) -> Recording:
    """An hour of a wandering command, with one S and J until half past and others after that."""
    draw = np.random.default_rng(3)
    wander = np.convolve(draw.standard_normal(3900), np.hanning(120), mode="valid")[:3600]
    op = 50.0 + 6.0 * wander / wander.std()
    stem = np.r_[stick_slip(op, *first)[:1800], stick_slip(op, *second)[1800:]]
    noise = 0.05 * draw.standard_normal(3600)
    signals = {Role.OP: Signal.good(op, "OP"), Role.MV: Signal.good(stem + noise, "MV")}
    return Recording(valve="V", signals=signals, interval_s=1.0)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ((4.0, 1.0), (0.3, 0.0)),
        pytest.param((0.3, 0.0), (4.0, 1.0), marks=pytest.mark.long),
    ],
)
def test_s_before_and_after_a_repair_is_said(first, second):
    """No verdict on both halves together; the reason gives both S and the time."""
    (screened,) = screen([Case(recording=half_and_half(first, second))], Options(narx=False))
    assert screened.verdict is Verdict.UNDETERMINED
    assert "S changed" in screened.reason
    assert "30 min" in screened.reason
    changed = change_of_stiction(fit_stickslip(half_and_half(first, second)))
    assert changed is not None
    assert (changed.before, changed.after) == pytest.approx((first[0], second[0]), abs=0.5)


@pytest.mark.parametrize("places", [slice(2), pytest.param(slice(2, 6), marks=pytest.mark.long)])
def test_one_s_is_not_split(places):
    """Valves whose breakaways scatter about one level, and healthy ones, have no change."""
    for loop in (*draw_sticky(4, 6161)[places], *draw_healthy(6, 6161)[places]):
        assert change_of_stiction(fit_stickslip(simulate_loop(loop, 3).recording)) is None
