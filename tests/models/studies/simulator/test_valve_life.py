"""A simulated valve over months: its S, the causes for alerts, and the loop of each day."""

from __future__ import annotations

import numpy as np
import pytest

from stemwatch.models.recording import Role
from stemwatch.models.studies.simulator import simulate_loop
from stemwatch.models.studies.simulator.valve_life import (
    CROSSES_PERCENT,
    HEALTHY,
    IN_TURN,
    Life,
    draw_lives,
)

LIVES = {life.life: life for life in draw_lives(len(IN_TURN), 90, 5151)}


def test_every_life_is_drawn_and_half_are_healthy():
    """All kinds are there; a plant has more healthy valves than worn ones."""
    assert set(LIVES) == set(Life)
    assert sum(life in HEALTHY for life in IN_TURN) * 2 > len(IN_TURN)


def test_a_draw_does_not_depend_on_how_many_are_drawn():
    """The first valves of a larger plant are those of a smaller one."""
    assert draw_lives(3, 90, 5151) == draw_lives(8, 90, 5151)[:3]


@pytest.mark.parametrize("life", HEALTHY)
def test_a_healthy_valve_never_has_a_cause(life):
    """Campaigns, seasons and shutdowns do not give it one."""
    valve = LIVES[life]
    assert valve.crosses is None
    assert not any(valve.has_cause(day) for day in range(valve.days))


@pytest.mark.parametrize(
    "life", [Life.WEARS, Life.STEPS, Life.NOT_HELPED, Life.REPAIRED, Life.UNRECORDED]
)
def test_wear_crosses_the_limit(life):
    """S grows from that of a healthy valve beyond the limit of a sticky one."""
    valve = LIVES[life]
    assert valve.S(0) < 0.5
    assert valve.S(valve.crosses) >= CROSSES_PERCENT > valve.S(valve.crosses - 1)


def test_a_repair_makes_it_well_and_work_that_does_not_help_leaves_it():
    """Recorded or not; the day of the work is known of recorded work alone."""
    repaired, unrecorded = LIVES[Life.REPAIRED], LIVES[Life.UNRECORDED]
    for valve in (repaired, unrecorded):
        assert valve.S(valve.repaired - 1) > CROSSES_PERCENT
        assert valve.S(valve.repaired) < 0.5
    assert repaired.worked == (repaired.repaired,)
    assert unrecorded.worked == ()
    helpless = LIVES[Life.NOT_HELPED]
    (day,) = helpless.worked
    assert helpless.S(day + 5) >= helpless.S(day - 1) > CROSSES_PERCENT


def test_steps_stand_still_between():
    """Wear in steps has as many sizes as steps."""
    valve = LIVES[Life.STEPS]
    assert len({round(valve.S(day), 9) for day in range(valve.days)}) == 5


def test_each_day_is_recorded_anew():
    """Set points and loads are of the day; the same day is the same again."""
    valve = LIVES[Life.STEADY]
    assert valve.on(3, 600.0) == valve.on(3, 600.0)
    assert valve.on(3, 600.0).setpoints != valve.on(4, 600.0).setpoints


def test_a_shutdown_moves_nothing_and_bad_data_is_marked():
    """In a shutdown OP stands still; bad samples are not usable."""
    shut = simulate_loop(LIVES[Life.SHUTDOWNS].on(11, 600.0), 1).recording
    assert np.ptp(shut.op.values) < 0.1
    bad = simulate_loop(LIVES[Life.BAD_DATA].on(1, 600.0), 1).recording
    assert not bad.signals[Role.MV].usable.all()
