"""Random populations of healthy and of sticking loops, for tests and for calibration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stemwatch.models.studies.simulator.draw_parts import (
    LETTER,
    PV_RANGE,
    coloured_load,
    draw_actuator,
    draw_controller,
    draw_process,
    draw_setpoints,
    draw_transmitters,
)
from stemwatch.models.studies.simulator.loop import Load, LoadKind, PlantLoop, Process, ProcessKind
from stemwatch.models.studies.simulator.valve import SimulatedValve
from stemwatch.models.verdict import Shape

HEALTHY_STORIES = (
    "quiet",
    "set points",
    "badly tuned",
    "oscillating disturbance",
    "noisy",
    "small travel",
)
STICKY_STORIES = ("limit cycle", "set points", "load")
_KINDS = tuple(ProcessKind)
# Loops whose limit cycle is short enough to be seen several times in an hour.
_QUICK = (ProcessKind.FLOW, ProcessKind.PRESSURE, ProcessKind.LEVEL)
_RATIO = {
    Shape.DEADBAND: (0.0, 0.0),
    Shape.UNDERSHOOT: (0.15, 0.85),
    Shape.NO_OFFSET: (1.0, 1.0),
    Shape.OVERSHOOT: (1.06, 1.3),
}


def draw_healthy(n: int, seed: int) -> list[PlantLoop]:
    """``n`` loops with a healthy valve, 30 to 90 minutes at 1 s, the stories taken in turn.

    S lies between 0.1 and 0.6 % without and between 0.2 and 0.4 % with positioner; J up to 0.3 S
    without. The first k loops of a draw do not depend on ``n``.
    """
    return [_healthy(index, np.random.default_rng([seed, index, 0])) for index in range(n)]


def draw_sticky(n: int, seed: int) -> list[PlantLoop]:
    """``n`` loops with a sticking valve, 30 to 90 minutes at 1 s, the four shapes in turn.

    S 1.5 to 10 %, J up to 1.3 S, scatter 3 to 10 %, noise 0.02 to 0.3 %, air lag 0.05 to 1.5 s.
    Half of the overshoot shapes come from a positioner that overdrives the stem, half from a
    negative kinetic level (see ``SimulatedValve``).
    """
    return [_sticky(index, np.random.default_rng([seed, index, 1])) for index in range(n)]


def _healthy(index: int, rng: np.random.Generator) -> PlantLoop:
    story = HEALTHY_STORIES[index % len(HEALTHY_STORIES)]
    kind = _KINDS[int(rng.integers(len(_KINDS)))]
    process = draw_process(kind, rng)
    valve = _healthy_valve(rng)
    margin = float(rng.uniform(1.03, 1.2)) if story == "badly tuned" else None
    controller = draw_controller(process, valve, rng, margin)
    noisy = story == "noisy"
    loop = PlantLoop(
        tag=f"{LETTER[kind]}-{100 + index}",
        story=f"healthy, {story}",
        valve=valve,
        process=process,
        controller=controller,
        transmitters=draw_transmitters(
            controller.gain,
            rng,
            pv_noise=float(rng.uniform(0.2, 0.4) if noisy else rng.uniform(0.02, 0.12)),
            position_noise=float(rng.uniform(0.1, 0.3) if noisy else rng.uniform(0.02, 0.1)),
        ),
        pv_range=PV_RANGE[kind],
        loads=_healthy_loads(story, process, rng),
        duration_s=float(rng.integers(1800, 5401)),
    )
    return _moved(loop, story, rng)


def _healthy_valve(rng: np.random.Generator) -> SimulatedValve:
    if rng.random() < 0.45:
        gain = float(rng.uniform(5.0, 15.0))
        actuator = draw_actuator(rng, (1.0, 5.0), 0.5)
        S = float(rng.uniform(0.2, 0.4))
        return SimulatedValve.showing(S, 0.0, positioner_gain=gain, actuator=actuator)
    S = float(rng.uniform(0.1, 0.6))
    J = float(rng.uniform(0.0, 0.3)) * S
    actuator = draw_actuator(rng, (0.2, 2.5), 1.0)
    return SimulatedValve(S=S, J=J, scatter=float(rng.uniform(0.03, 0.05)), actuator=actuator)


def _healthy_loads(story: str, process: Process, rng: np.random.Generator) -> tuple[Load, ...]:
    if story == "quiet":
        return coloured_load(process, rng, (0.02, 0.1))
    if story == "oscillating disturbance":
        wave = Load(
            kind=LoadKind.OSCILLATING,
            size=float(rng.uniform(1.0, 6.0)),
            time_s=float(rng.uniform(30.0, 240.0)),
            drift_rad=float(rng.uniform(0.05, 0.5)),
        )
        return (wave, *coloured_load(process, rng, (0.1, 0.5)))
    if story == "small travel":
        return coloured_load(process, rng, (0.2, 0.5))
    return coloured_load(process, rng, (0.3, 1.5))


def _moved(loop: PlantLoop, story: str, rng: np.random.Generator) -> PlantLoop:
    """The loop with the set-point steps that belong to its story."""
    travel = {"set points": (2.0, 20.0), "noisy": (1.0, 10.0), "small travel": (0.5, 2.0)}
    if story not in travel:
        return loop
    steps = draw_setpoints(
        loop.process, loop.controller, rng, duration_s=loop.duration_s, travel=travel[story]
    )
    return replace(loop, setpoints=steps)


def _sticky(index: int, rng: np.random.Generator) -> PlantLoop:
    shape = tuple(Shape)[index % len(Shape)]
    valve = _sticky_valve(shape, rng)
    story = STICKY_STORIES[int(rng.integers(len(STICKY_STORIES)))]
    kind = _sticky_kind(shape, story, rng)
    process = draw_process(kind, rng)
    controller = draw_controller(process, valve, rng)
    strong = (0.5, 2.0) if story == "load" else (0.02, 0.15)
    loop = PlantLoop(
        tag=f"{LETTER[kind]}-{500 + index}",
        story=f"sticky, {shape.value}, {story}",
        valve=valve,
        process=process,
        controller=controller,
        transmitters=draw_transmitters(
            controller.gain,
            rng,
            pv_noise=float(np.exp(rng.uniform(np.log(0.02), np.log(0.3)))),
            position_noise=float(np.exp(rng.uniform(np.log(0.02), np.log(0.3)))),
        ),
        pv_range=PV_RANGE[kind],
        loads=coloured_load(process, rng, strong),
        duration_s=float(rng.integers(1800, 5401)),
    )
    if story == "set points":
        travel = (0.8 * valve.S_read, 15.0)
        steps = draw_setpoints(process, controller, rng, duration_s=loop.duration_s, travel=travel)
        return replace(loop, setpoints=steps)
    return replace(loop, setpoints=(_between_slips(loop, rng),))


def _sticky_valve(shape: Shape, rng: np.random.Generator) -> SimulatedValve:
    S = float(rng.uniform(1.5, 10.0 if shape is not Shape.OVERSHOOT else 7.5))
    J = S * float(rng.uniform(*_RATIO[shape]))
    scatter = float(rng.uniform(0.03, 0.10))
    actuator = draw_actuator(rng, (0.05, 1.5), 1.0)
    gain = 0.0
    if shape is Shape.OVERSHOOT and rng.random() < 0.5:
        gain = float(rng.uniform(1.0, 2.0))
        # The slip must be faster than the air for the positioner to overdrive the stem.
        actuator = replace(actuator, air_lag_s=max(actuator.air_lag_s, 0.5))
    return SimulatedValve.showing(S, J, positioner_gain=gain, scatter=scatter, actuator=actuator)


def _sticky_kind(shape: Shape, story: str, rng: np.random.Generator) -> ProcessKind:
    if story != "limit cycle":
        return _KINDS[int(rng.integers(len(_KINDS)))]
    if shape is Shape.DEADBAND:
        # With a dead band alone a PI loop cycles only where the process integrates too.
        return ProcessKind.LEVEL
    return _QUICK[int(rng.integers(len(_QUICK)))]


def _between_slips(loop: PlantLoop, rng: np.random.Generator) -> tuple[float, float]:
    """An early set-point step to a value that no position of the stuck stem can hold.

    On a level, which any position near balance holds for long, the step is one whose proportional
    action moves OP across the dead band.
    """
    share = float(rng.uniform(0.3, 0.7))
    jump = max(loop.valve.J_read, 1.0)
    step = share * jump * loop.process.gain
    if loop.process.integrating:
        step = (1.0 + share) * loop.valve.S_read / loop.controller.gain
    return (10.0, loop.controller.set_point + step)
