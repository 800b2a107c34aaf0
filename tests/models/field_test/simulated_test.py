"""A planned test on a simulated valve that shares no code with the fitted models."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime

from stemwatch.models.field_test.programme import Programme
from stemwatch.models.recording import Recording
from stemwatch.models.studies.simulator.loop import ManualSpan, PlantLoop, Transmitters
from stemwatch.models.studies.simulator.simulate import simulate_loop
from stemwatch.models.studies.simulator.valve import Actuator, SimulatedValve

BEGAN = datetime(2026, 3, 2, 9, tzinfo=UTC)


def simulated_test(
    programme: Programme,
    op: float,
    *,
    lag_s: float = 0.2,
    dead_time_s: float = 0.0,
    S: float = 2.0,
    J: float = 0.6,
    valve: str = "FIC-1",
) -> Recording:
    """The recording of ``programme`` from ``op`` on a valve with these numbers, at 1 s."""
    knots, last = [(-120.0, op)], op
    for value in programme.values()[1:]:
        knots += [(value.at_s, last), (value.at_s + 0.5, op + value.change)]
        last = op + value.change
    loop = PlantLoop(
        tag=valve,
        valve=SimulatedValve(S=S, J=J, actuator=Actuator(air_lag_s=lag_s, dead_time_s=dead_time_s)),
        transmitters=Transmitters(position_noise=0.05),
        duration_s=programme.duration_s + 20.0,
        manual=(ManualSpan(start_s=-120.0, stop_s=1e6, knots=tuple(knots)),),
    )
    return replace(simulate_loop(loop, 11).recording, start=BEGAN)
