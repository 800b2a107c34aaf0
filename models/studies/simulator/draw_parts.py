"""Random parts of plausible loops: process, actuator, controller, transmitters, set points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stemwatch.models.studies.simulator.loop import (
    Controller,
    Load,
    LoadKind,
    Process,
    ProcessKind,
    PvRange,
    Transmitters,
)
from stemwatch.models.studies.simulator.tuning import delay_s, sound_settings, ultimate_gain
from stemwatch.models.studies.simulator.valve import Actuator, SimulatedValve

LETTER = {
    ProcessKind.FLOW: "FIC",
    ProcessKind.PRESSURE: "PIC",
    ProcessKind.TEMPERATURE: "TIC",
    ProcessKind.CONCENTRATION: "AIC",
    ProcessKind.LEVEL: "LIC",
}
PV_RANGE = {
    ProcessKind.FLOW: PvRange(unit="t/h", low=0.0, high=40.0),
    ProcessKind.PRESSURE: PvRange(unit="bar", low=0.0, high=16.0),
    ProcessKind.TEMPERATURE: PvRange(unit="°C", low=50.0, high=250.0),
    ProcessKind.CONCENTRATION: PvRange(unit="mol/l", low=0.0, high=2.0),
    ProcessKind.LEVEL: PvRange(unit="%", low=0.0, high=100.0),
}
# Gain, lag, second lag and dead time, each from low to high. Flow, pressure and level follow
# common simulation studies of stiction; the other two are working ranges of slow loops.
_PROCESS = {
    ProcessKind.FLOW: ((0.8, 1.5), (1.0, 5.0), (0.0, 0.0), (0.5, 2.0)),
    ProcessKind.PRESSURE: ((0.5, 2.0), (10.0, 60.0), (0.0, 2.0), (1.0, 5.0)),
    ProcessKind.TEMPERATURE: ((0.8, 2.0), (40.0, 120.0), (5.0, 20.0), (4.0, 15.0)),
    ProcessKind.CONCENTRATION: ((0.8, 2.5), (15.0, 50.0), (0.0, 5.0), (5.0, 12.0)),
    ProcessKind.LEVEL: ((0.005, 0.02), (1.0, 1.0), (0.5, 3.0), (2.0, 10.0)),
}
_SCANS = {ProcessKind.FLOW: (0.1, 0.2, 0.25, 0.5)}
_SLOW_SCANS = (0.25, 0.5, 1.0)


def draw_process(kind: ProcessKind, rng: np.random.Generator) -> Process:
    """A process of ``kind`` with drawn gain and times."""
    gain, lag, second, dead = (float(rng.uniform(*ends)) for ends in _PROCESS[kind])
    return Process(
        kind=kind,
        gain=gain,
        lag_s=lag,
        second_lag_s=second,
        dead_time_s=dead,
        integrating=kind is ProcessKind.LEVEL,
    )


def draw_actuator(
    rng: np.random.Generator, air_lag_s: tuple[float, float], dead_time_s: float
) -> Actuator:
    """An actuator with a drawn nameplate, air lag and, in one of two, a dead time up to the limit.

    Bench sets are 0.2 to 1.0 bar and 0.4 to 1.8 bar, with the usual supply pressures.
    """
    low, high, supply = [(20_700.0, 103_400.0, 140_000.0), (41_000.0, 180_000.0, 240_000.0)][
        int(rng.integers(2))
    ]
    return Actuator(
        mass_kg=float(rng.uniform(1.0, 2.5)),
        area_m2=float(rng.uniform(0.03, 0.07)),
        stroke_m=float(rng.choice([0.015, 0.02, 0.03, 0.04, 0.06])),
        bench_low_pa=low,
        bench_high_pa=high,
        supply_pa=supply,
        viscous_s=float(rng.uniform(0.015, 0.05)),
        stribeck_percent_per_s=float(rng.uniform(0.01, 0.05)),
        air_lag_s=float(rng.uniform(*air_lag_s)),
        dead_time_s=float(rng.uniform(0.0, dead_time_s)) if rng.random() < 0.5 else 0.0,
    )


def effective_actuator(valve: SimulatedValve) -> Actuator:
    """The actuator as the controller sees it: a positioner shortens the air lag by 1 + gain."""
    actuator = valve.actuator
    return replace(actuator, air_lag_s=actuator.air_lag_s / (1.0 + valve.positioner_gain))


def draw_controller(
    process: Process, valve: SimulatedValve, rng: np.random.Generator, margin: float | None = None
) -> Controller:
    """A soundly tuned PI controller or, with ``margin``, one at that gain margin.

    A margin a little above 1 makes a badly tuned loop that rings at every disturbance.
    """
    scan = float(rng.choice(_SCANS.get(process.kind, _SLOW_SCANS)))
    effective = effective_actuator(valve)
    settings = sound_settings(
        process, delay_s(process, effective, scan), float(rng.uniform(1.2, 3.0))
    )
    gain = settings.gain
    if margin is not None:
        gain = ultimate_gain(process, effective, scan, settings.reset_s) / margin
    return Controller(
        gain=gain,
        reset_s=settings.reset_s,
        derivative_s=0.0,
        scan_s=scan,
        set_point=float(rng.uniform(38.0, 62.0)),
        output=float(rng.uniform(35.0, 65.0)),
    )


def draw_transmitters(
    gain: float, rng: np.random.Generator, *, pv_noise: float, position_noise: float
) -> Transmitters:
    """Transmitters with this noise; PV noise is at most 0.4 % divided by the controller's ``gain``.

    A third of the positions is rounded to 0.1 %, half have a zero error of up to 1 %, a fifth a
    span error of up to 1 %.
    """
    return Transmitters(
        pv_noise=min(pv_noise, 0.4 / gain),
        position_noise=position_noise,
        position_zero=float(rng.uniform(-1.0, 1.0)) if rng.random() < 0.5 else 0.0,
        position_span=float(rng.uniform(0.99, 1.01)) if rng.random() < 0.2 else 1.0,
        position_step=0.1 if rng.random() < 0.33 else 0.0,
    )


def coloured_load(
    process: Process, rng: np.random.Generator, size: tuple[float, float]
) -> tuple[Load, ...]:
    """A coloured load whose correlation time suits the speed of the process."""
    slow = 1.0 if process.kind is ProcessKind.FLOW else 4.0
    return (
        Load(
            kind=LoadKind.COLOURED,
            size=float(rng.uniform(*size)),
            time_s=float(rng.uniform(5.0, 30.0)) * slow,
        ),
    )


def draw_setpoints(
    process: Process,
    controller: Controller,
    rng: np.random.Generator,
    *,
    duration_s: float,
    travel: tuple[float, float],
) -> tuple[tuple[float, float], ...]:
    """Set-point steps that move the valve by ``travel`` percent up or down.

    A self-regulating process is stepped every 150 to 500 s between random openings, the height
    being the travel times the gain; a level is stepped so that the proportional action alone moves
    the valve that far. Openings stay between 12 and 88 %, set points between 8 and 92 %.
    """
    moves = []
    level, time = 0.0, float(rng.uniform(20.0, 120.0))
    per_travel = 1.0 / controller.gain if process.integrating else process.gain
    while time < duration_s:
        step = float(rng.uniform(*travel)) * float(rng.choice([-1.0, 1.0]))
        if not _within(controller, level + step, per_travel, process.integrating):
            step = -step
        if _within(controller, level + step, per_travel, process.integrating):
            level += step
        moves.append((round(time, 1), controller.set_point + level * per_travel))
        time += float(rng.uniform(150.0, 500.0))
    return tuple(moves)


def _within(controller: Controller, level: float, per_travel: float, integrating: bool) -> bool:
    opening = controller.output + (0.0 if integrating else level)
    return 12.0 < opening < 88.0 and 8.0 < controller.set_point + level * per_travel < 92.0
