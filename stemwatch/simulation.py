"""The loop behind ``stemwatch.simulate``: flow control, a wandering load, known S and J."""

from __future__ import annotations

import numpy as np

from stemwatch.models.recording import Recording
from stemwatch.models.studies.simulator import PlantLoop, SimulatedValve, simulate_loop
from stemwatch.models.studies.simulator.draw_parts import (
    coloured_load,
    draw_actuator,
    draw_controller,
)
from stemwatch.models.studies.simulator.loop import (
    Process,
    ProcessKind,
    SimulatedArchive,
    Transmitters,
)

_LOAD = (0.8, 1.6)  # standard deviation, percent of travel: enough to move any valve
_AIR_LAG_S, _VISCOUS = (0.3, 0.8), 0.3


def sticking_flow_loop(
    *,
    S: float,
    J: float,
    duration_s: float,
    interval_s: float,
    seed: int,
    tag: str,
    noise: float,
) -> Recording:
    """The recording of the loop. Raises ``ValueError`` where S, J or noise is negative or there
    are fewer than two samples."""
    for name, value in (("S", S), ("J", J), ("noise", noise)):
        if not value >= 0.0:
            raise ValueError(f"{name} must not be negative, received {value}")
    rng = np.random.default_rng([seed, 0])
    process = Process(kind=ProcessKind.FLOW)
    valve = SimulatedValve.showing(S, J, actuator=draw_actuator(rng, _AIR_LAG_S, _VISCOUS))
    loop = PlantLoop(
        tag=tag,
        valve=valve,
        process=process,
        controller=draw_controller(process, valve, rng),
        transmitters=Transmitters(position_noise=noise),
        archive=SimulatedArchive(interval_s=interval_s),
        loads=coloured_load(process, rng, _LOAD),
        duration_s=duration_s,
    )
    return simulate_loop(loop, seed).recording
