"""Stick-slip that is seen without a model."""

from dataclasses import replace

import numpy as np
import pytest

from stemwatch.models.preparation.own_clock import on_own_clock
from stemwatch.models.recording import Recording, Role, Signal
from stemwatch.models.stickslip.fit import fit_stickslip
from stemwatch.models.stickslip.interval import bootstrap, interval
from stemwatch.models.studies.simulator import draw_healthy, draw_sticky, simulate_loop


def recording_of(draw, place: int) -> Recording:
    return simulate_loop(draw(place + 1, 57)[place], 5700 + place).recording


@pytest.mark.parametrize("place", [1, 11, 25])
def test_a_stem_that_rests_and_jumps_is_evident(place: int) -> None:
    """Sticking valves under load jump towards their command, however their slips scatter."""
    events = fit_stickslip(recording_of(draw_sticky, place)).events
    assert events.evident
    assert events.towards > 0.95


@pytest.mark.parametrize("place", [1, 2, 3, 4, 5])
def test_a_healthy_valve_does_not_jump(place: int) -> None:
    """A valve that follows makes next to none of its way in jumps from rest."""
    events = fit_stickslip(recording_of(draw_healthy, place)).events
    assert events.share < 0.1
    assert not events.evident


def test_jumps_away_from_the_command_are_not_friction() -> None:
    """The position of another sticking valve jumps, but not towards this command."""
    own, other = (recording_of(draw_sticky, index) for index in (0, 25))
    n = min(len(own), len(other))
    mv = Signal.good(other.signals[Role.MV].values[:n].copy(), "ZT")
    mixed = own.part(0, n)
    mixed = replace(mixed, signals={**mixed.signals, Role.MV: mv})
    assert not fit_stickslip(mixed).events.evident


def test_a_stem_at_rest_has_no_slip_events() -> None:
    """A position at rest under a command that moves has no slip, no share and no direction."""
    op = 50.0 + np.sin(np.arange(600.0) / 20.0)
    signals = {Role.OP: Signal.good(op, "OP"), Role.MV: Signal.good(np.full(600, 50.0), "ZT")}
    recording = Recording(valve="V", signals=signals, interval_s=1.0)
    events = fit_stickslip(recording).events
    assert (0, 0.0, 0.0, False) == (events.count, events.share, events.towards, events.evident)


def test_a_stem_that_slips_every_few_minutes_is_read_from_its_slips() -> None:
    """Twelve slips in forty minutes, of which the cheapest run has none (S 4.0 and 5.2 %, J 0.1 and
    0.2 % with and without a lag): S and J come from the slips."""
    loop = simulate_loop(draw_sticky(14, 7171)[13], 7171037)
    fit = fit_stickslip(on_own_clock(loop.recording))
    assert fit.breakaways is not None
    assert fit.hypothesis == "sticking"
    S, J = (
        interval(draws, value)
        for draws, value in zip((bootstrap(fit).S, bootstrap(fit).J), (fit.S, fit.J), strict=True)
    )
    assert S[0] <= loop.truth.S <= S[1]
    assert J[0] <= loop.truth.J <= J[1]
