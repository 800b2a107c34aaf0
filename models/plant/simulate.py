"""``simulate_loop``: one closed loop with one valve, integrated at a millisecond."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stemwatch.models.plant.archive import archived
from stemwatch.models.plant.kernel import (
    AirNumbers,
    ControllerNumbers,
    ProcessNumbers,
    StemNumbers,
    Steps,
    run_loop,
)
from stemwatch.models.plant.loop import PlantLoop
from stemwatch.models.plant.signals import LOAD_STEP_S, load_at, manual_output_at, set_point_at
from stemwatch.models.plant.truth import Truth, truth_of
from stemwatch.models.plant.valve import Valve
from stemwatch.models.recording import Floats, Recording, Role

STEP_S = 0.001
# Far below the Stribeck speed and far above the rounding of speeds, percent of travel per second.
_REST_BAND_PERCENT_PER_S = 1e-5
_SCATTER_DRAWS = 8192  # breakaways before the drawn levels repeat
_SCATTER_LIMIT = 3.0  # standard deviations; a level of zero or below would be no friction at all


@dataclass(frozen=True, kw_only=True)
class SimulatedLoop:
    """A recording, and what it really holds.

    ``stem`` (n,) is the true stem position in percent at the recorded instants.
    """

    recording: Recording
    truth: Truth
    loop: PlantLoop
    stem: Floats


def simulate_loop(loop: PlantLoop, seed: int, *, step_s: float = STEP_S) -> SimulatedLoop:
    """Simulate ``loop`` with the chance of ``seed``; the same seed gives the same recording.

    All times are rounded to whole steps of ``step_s`` seconds. The noise does not depend on the
    step, so that a smaller one converges to the same run.
    """
    rng = np.random.default_rng(seed)
    steps = _steps(loop, step_s)
    scan_times = _clock(-(-steps.total // steps.scan), loop.controller.scan_s) - loop.warmup_s
    load_times = _clock(-(-steps.total // steps.load), LOAD_STEP_S)
    set_point = set_point_at(loop, scan_times)
    manual = manual_output_at(loop.manual, scan_times)
    pv_noise = rng.standard_normal(scan_times.size) * loop.transmitters.pv_noise
    scatter = np.clip(rng.standard_normal(_SCATTER_DRAWS), -_SCATTER_LIMIT, _SCATTER_LIMIT)
    records, _ = run_loop(
        step_s,
        steps,
        stem_numbers(loop.valve),
        air_numbers(loop.valve),
        process_numbers(loop),
        controller_numbers(loop),
        set_point,
        manual,
        pv_noise,
        load_at(loop.loads, load_times, rng),
        scatter * loop.valve.scatter,
    )
    seen = records[_warmup_samples(loop) :]
    times = _clock(len(seen), loop.archive.interval_s)
    columns = {
        Role.OP: seen[:, 1],
        Role.MV: seen[:, 0],
        Role.PV: seen[:, 2],
        Role.SP: set_point_at(loop, times),
        Role.MODE: np.isnan(manual_output_at(loop.manual, times)).astype(np.float64),
    }
    return SimulatedLoop(
        recording=archived(loop, columns, rng),
        truth=truth_of(loop, seed, seen[:, 3], columns[Role.SP]),
        loop=loop,
        stem=seen[:, 0].copy(),
    )


def _clock(count: int, interval_s: float) -> Floats:
    return np.arange(count, dtype=np.float64) * interval_s


def _warmup_samples(loop: PlantLoop) -> int:
    return round(loop.warmup_s / loop.archive.interval_s)


def _steps(loop: PlantLoop, step_s: float) -> Steps:
    """The loop's times as whole numbers of steps."""
    samples = _warmup_samples(loop) + int(loop.duration_s / loop.archive.interval_s + 1e-9)
    record = max(round(loop.archive.interval_s / step_s), 1)
    return Steps(
        total=samples * record,
        scan=max(round(loop.controller.scan_s / step_s), 1),
        load=max(round(LOAD_STEP_S / step_s), 1),
        record=record,
        record_phase=round(loop.archive.phase_s / step_s) % record,
        valve_delay=round(loop.valve.actuator.dead_time_s / step_s),
        process_delay=round(loop.process.dead_time_s / step_s),
    )


def stem_numbers(valve: Valve) -> StemNumbers:
    """Friction of ``valve`` in newton: ``Fs = (S + J)/2`` and ``Fc = (S - J)/2`` of spring range.

    Every number becomes a float here and below: an integer would make the kernel count in whole
    percent.
    """
    actuator = valve.actuator
    newton_per_percent = actuator.spring_range_n / 100.0
    metre_per_percent = actuator.stroke_m / 100.0
    return StemNumbers(
        mass_kg=float(actuator.mass_kg),
        spring_n_per_m=actuator.spring_n_per_m,
        stroke_m=float(actuator.stroke_m),
        kinetic_n=0.5 * (valve.S - valve.J) * newton_per_percent,
        breakaway_n=0.5 * (valve.S + valve.J) * newton_per_percent,
        viscous_n_s_per_m=actuator.viscous_s * actuator.spring_n_per_m,
        stribeck_m_per_s=actuator.stribeck_percent_per_s * metre_per_percent,
        rest_band_m_per_s=_REST_BAND_PERCENT_PER_S * metre_per_percent,
    )


def air_numbers(valve: Valve) -> AirNumbers:
    """Positioner and chamber of ``valve``."""
    actuator = valve.actuator
    return AirNumbers(
        area_m2=float(actuator.area_m2),
        low_pa=float(actuator.bench_low_pa),
        high_pa=float(actuator.bench_high_pa),
        supply_pa=float(actuator.supply_pa),
        lag_s=float(actuator.air_lag_s),
        positioner_gain=float(valve.positioner_gain),
    )


def process_numbers(loop: PlantLoop) -> ProcessNumbers:
    """The process, in balance at the controller's set point and output."""
    return ProcessNumbers(
        gain=float(loop.process.gain),
        lag_s=float(loop.process.lag_s),
        second_lag_s=float(loop.process.second_lag_s),
        integrating=loop.process.integrating,
        balance_percent=float(loop.controller.output),
        pv_percent=float(loop.controller.set_point),
    )


def controller_numbers(loop: PlantLoop) -> ControllerNumbers:
    """The controller's settings."""
    c = loop.controller
    return ControllerNumbers(
        gain=float(c.gain),
        reset_s=float(c.reset_s),
        derivative_s=float(c.derivative_s),
        scan_s=float(c.scan_s),
        low=float(c.output_low),
        high=float(c.output_high),
        output=float(c.output),
    )
