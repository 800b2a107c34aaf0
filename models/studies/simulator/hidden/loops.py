"""The loops in which effects are hidden: their movement, and the concealments that make effects
hard to see.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stemwatch.models.studies.simulator.defects import PackingDefects
from stemwatch.models.studies.simulator.draw_parts import (
    LETTER,
    PV_RANGE,
    coloured_load,
    draw_actuator,
    draw_process,
)
from stemwatch.models.studies.simulator.hidden.hidden_effect import (
    log_uniform,
    with_transmitters,
)
from stemwatch.models.studies.simulator.hidden.manual_moves import draw_manual
from stemwatch.models.studies.simulator.hidden.record_effects import (
    draw_deviation,
    draw_steps,
    with_steps,
    with_swinging_door,
)
from stemwatch.models.studies.simulator.loop import (
    Controller,
    Load,
    LoadKind,
    PlantLoop,
    Process,
    ProcessKind,
    Transmitters,
)
from stemwatch.models.studies.simulator.tuning import delay_s, sound_settings
from stemwatch.models.studies.simulator.valve import SimulatedValve

# Taken in turn. "positioner" is drawn on request only.
CONCEALMENTS = (
    "routine",
    "rich",
    "noisy",
    "quantised",
    "compressed",
    "quiet",
    "short",
    "scatter",
)
POSITIONER = "positioner"
DURATION_S = 3600.0
SHORT_S = 900.0
HIGH_SCATTER = 0.12
_KINDS = (ProcessKind.FLOW, ProcessKind.FLOW, ProcessKind.PRESSURE, ProcessKind.LEVEL)
_SCANS = (0.1, 0.2, 0.25, 0.5)
# The stem would stop between the scans of a controller that is slower than this many air lags.
_LAGS_PER_SCAN = 1.0
# Low, so that re-sticking on slow ramps is there only where it is hidden on purpose.
_STRIBECK_PERCENT_PER_S = (0.002, 0.01)
# Noise of PV that passes the controller's filter into OP, percent of OP. With more noise the stem
# would stop and start within each second, which looks like low-speed re-sticking.
_TREMBLE_PERCENT = (0.002, 0.012)
_OPENINGS = (25.0, 75.0)
# The immediate move of the valve at a set-point step, as a share of its final move.
_MOST_KICK = 0.8


def draw_loop(
    rng: np.random.Generator, tag: str, concealment: str, *, scatter: float | None = None
) -> PlantLoop:
    """A loop with S and J and no hidden effect, with ``concealment``; ``tuned`` tunes it
    afterwards.

    S 2 to 8 %, J 0.15 to 0.7 S, breakaway scatter 5 % (5 to 12 % in three of ten), air lag 0.05 to
    0.4 s, dead time at most 0.3 s, drag 0.05 s; no zero and no span error. One packing in five
    is LuGre's.
    """
    kind = _KINDS[int(rng.integers(len(_KINDS)))]
    process = draw_process(kind, rng)
    if not process.integrating:
        # PV must not leave its range while the valve goes from 25 to 75 %.
        process = replace(process, gain=min(process.gain, 1.4))
    loop = PlantLoop(
        tag=f"{LETTER[kind]}-{tag}",
        story=f"hidden, {concealment}",
        valve=_some_valve(rng, concealment, scatter),
        process=process,
        transmitters=Transmitters(
            pv_noise=log_uniform(rng, *_TREMBLE_PERCENT),
            position_noise=_some_noise(rng, concealment),
        ),
        pv_range=PV_RANGE[kind],
        loads=_some_loads(process, rng, concealment),
        duration_s=SHORT_S if concealment == "short" else DURATION_S,
    )
    return _concealed(loop, concealment, rng)


def _some_valve(
    rng: np.random.Generator, concealment: str, scatter: float | None
) -> SimulatedValve:
    S = float(rng.uniform(2.0, 8.0))
    J = S * float(rng.uniform(0.15, 0.7))
    scatter_share = 0.05 if rng.random() < 0.7 else float(rng.uniform(0.05, 0.12))
    if concealment == "scatter":
        scatter_share = HIGH_SCATTER
    actuator = replace(
        draw_actuator(rng, (0.05, 0.4), 0.3),
        stribeck_percent_per_s=float(rng.uniform(*_STRIBECK_PERCENT_PER_S)),
    )
    gain = float(rng.uniform(0.5, 2.5))
    # Every fifth packing deflects a little before it breaks away (LuGre); the others are Karnopp's.
    gives = float(rng.uniform(0.001, 0.003)) if rng.random() < 0.2 else 0.0
    return SimulatedValve(
        S=S,
        J=J,
        scatter=scatter_share if scatter is None else scatter,
        positioner_gain=gain if concealment == POSITIONER else 0.0,
        actuator=actuator,
        packing=PackingDefects(presliding_percent=gives),
    )


def _some_noise(rng: np.random.Generator, concealment: str) -> float:
    if concealment == "noisy":
        return float(rng.uniform(0.3, 0.5))
    return log_uniform(rng, 0.02, 0.2)


def _some_loads(process: Process, rng: np.random.Generator, concealment: str) -> tuple[Load, ...]:
    """A coloured load; on a level also load steps, because there the valve only travels with the
    load.
    """
    size = (0.8, 2.0) if concealment == "quiet" else (0.2, 1.2)
    loads = coloured_load(process, rng, size)
    if not process.integrating or concealment == "quiet":
        return loads
    height, period_s = float(rng.uniform(6.0, 10.0)), float(rng.uniform(180.0, 400.0))
    return (*loads, Load(kind=LoadKind.STEPS, size=height, time_s=period_s))


def _concealed(loop: PlantLoop, concealment: str, rng: np.random.Generator) -> PlantLoop:
    if concealment == "quantised":
        return with_steps(loop, draw_steps(rng, loop))
    if concealment == "compressed":
        return with_swinging_door(loop, draw_deviation(rng, loop))
    if concealment == "rich":
        return replace(loop, manual=(draw_manual(loop.duration_s, loop.warmup_s, rng),))
    return loop


def tuned(loop: PlantLoop, extra_s: float, rng: np.random.Generator) -> PlantLoop:
    """``loop`` with a sound controller and set-point moves; ``extra_s`` is the dead time that the
    hidden effects add, for which the controller is tuned."""
    actuator = loop.valve.actuator
    slowest = _LAGS_PER_SCAN * actuator.air_lag_s
    scans = [scan for scan in _SCANS if scan <= slowest] or [_SCANS[0]]
    scan = float(rng.choice(scans))
    delay = delay_s(loop.process, actuator, scan) + extra_s
    slowness = float(rng.uniform(1.2, 3.0))
    if not loop.process.integrating:
        lag = loop.process.lag_s + 0.5 * loop.process.second_lag_s
        slowness = max(slowness, lag / (_MOST_KICK * delay) - 1.0)
    settings = sound_settings(loop.process, delay, slowness)
    controller = Controller(
        gain=settings.gain,
        reset_s=settings.reset_s,
        scan_s=scan,
        set_point=50.0,
        output=float(rng.uniform(45.0, 55.0)),
    )
    noise = min(loop.transmitters.pv_noise / settings.gain, 0.1)
    steady = with_transmitters(replace(loop, controller=controller), pv_noise=noise)
    if "quiet" in loop.story or loop.manual:
        return steady
    return replace(steady, setpoints=_some_moves(steady, rng))


def moved_anew(loop: PlantLoop, rng: np.random.Generator) -> PlantLoop:
    """``loop`` in another window: the same valve and controller with other set points, or with
    other manual moves where it is in manual.
    """
    if loop.manual:
        return replace(loop, manual=(draw_manual(loop.duration_s, loop.warmup_s, rng),))
    return replace(loop, setpoints=_some_moves(loop, rng)) if loop.setpoints else loop


def _some_moves(loop: PlantLoop, rng: np.random.Generator) -> tuple[tuple[float, float], ...]:
    """Set points every 150 to 500 s that bring the valve to openings between 25 and 75 %; on a
    level, small ones that its controller answers with a kick."""
    moves, time = [], float(rng.uniform(20.0, 120.0))
    while time < loop.duration_s:
        if loop.process.integrating:
            height = float(rng.uniform(-8.0, 8.0)) / loop.controller.gain
        else:
            height = (float(rng.uniform(*_OPENINGS)) - loop.controller.output) * loop.process.gain
        moves.append((round(time, 1), loop.controller.set_point + height))
        time += float(rng.uniform(150.0, 500.0))
    return tuple(moves)
