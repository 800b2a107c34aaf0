"""The loop on which fits and verdicts are tried: half an hour of flow under load."""

from __future__ import annotations

from functools import cache

from stemwatch.models.studies.simulator import (
    Actuator,
    PlantLoop,
    SimulatedLoop,
    SimulatedValve,
    simulate_loop,
)
from stemwatch.models.studies.simulator.loop import Load, LoadKind


@cache
def half_an_hour(
    S: float, J: float, lag_s: float = 0.1, dead_time_s: float = 0.0, seed: int = 1
) -> SimulatedLoop:
    """Half an hour of a flow loop under load, with three set-point steps."""
    actuator = Actuator(air_lag_s=lag_s, dead_time_s=dead_time_s)
    return simulate_loop(
        PlantLoop(
            valve=SimulatedValve(S=S, J=J, actuator=actuator),
            setpoints=((10.0, 51.3), (400.0, 55.0), (800.0, 47.0), (1200.0, 52.0)),
            loads=(Load(kind=LoadKind.COLOURED, size=1.0, time_s=20.0),),
            duration_s=1800.0,
        ),
        seed,
    )
