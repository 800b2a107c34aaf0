"""``simulate_loop``: one closed loop with one valve, integrated at a millisecond."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stemwatch.models.recording import Floats, Recording, Role
from stemwatch.models.studies.simulator.driving_signals import (
    LOAD_STEP_S,
    load_at,
    manual_output_at,
    set_point_at,
    upsets_at,
)
from stemwatch.models.studies.simulator.historian import READS, archived, reading_of
from stemwatch.models.studies.simulator.kernel import run_loop
from stemwatch.models.studies.simulator.kernel_inputs import (
    Steps,
    controller_numbers,
    process_numbers,
    valve_numbers,
)
from stemwatch.models.studies.simulator.loop import PlantLoop
from stemwatch.models.studies.simulator.truth import Truth, truth_of

STEP_S = 0.001
_SCATTER_DRAWS = 8192  # breakaways before the drawn levels repeat
_SCATTER_LIMIT = 3.0  # standard deviations, so that no drawn level is zero or below
# Upsets have a random stream of their own: switching one on does not change noise, load and
# scatter.
_UPSETS = 1


@dataclass(frozen=True, kw_only=True)
class SimulatedLoop:
    """A simulated recording and the truth behind it.

    ``stem`` (n,) is the true stem position in percent at the recorded instants, ``output`` (n,) OP
    there before it is rounded or thinned, and ``reading`` (n,) the position that a transmitter
    without noise, walk and rounding shows.
    """

    recording: Recording
    truth: Truth
    loop: PlantLoop
    stem: Floats
    output: Floats
    reading: Floats


def simulate_loop(loop: PlantLoop, seed: int, *, step_s: float = STEP_S) -> SimulatedLoop:
    """Simulate ``loop`` with the random numbers of ``seed``; one seed gives one recording.

    All times are rounded to whole steps of ``step_s`` seconds. The noise does not depend on the
    step, so that a smaller one converges to the same run.
    """
    rng = np.random.default_rng(seed)
    reads = READS if loop.archive.uneven else 1
    samples = _run(loop, seed, rng, step_s, reads)[_warmup_samples(loop) * reads :]
    even = samples[::reads]
    times = _clock(len(even), loop.archive.interval_s)
    columns = {
        Role.OP: samples[:, 1],
        Role.MV: samples[:, 4],
        Role.PV: samples[:, 2],
        Role.SP: set_point_at(loop, times),
        Role.MODE: np.isnan(manual_output_at(loop.manual, times)).astype(np.float64),
    }
    return SimulatedLoop(
        recording=archived(loop, columns, rng),
        truth=truth_of(loop, seed, even[:, 3], columns[Role.SP]),
        loop=loop,
        stem=even[:, 0].copy(),
        output=even[:, 1].copy(),
        reading=reading_of(loop.transmitters, even[:, 4]),
    )


def _run(loop: PlantLoop, seed: int, rng: np.random.Generator, step_s: float, reads: int) -> Floats:
    """(m, 5) what ``run_loop`` records, ``reads`` times in each interval of the archive."""
    steps = _steps(loop, step_s, reads)
    scan_times = _clock(-(-steps.total // steps.scan), loop.controller.scan_s) - loop.warmup_s
    load_times = _clock(-(-steps.total // steps.load), LOAD_STEP_S)
    noise = rng.standard_normal(scan_times.size) * loop.transmitters.pv_noise
    scatter = np.clip(rng.standard_normal(_SCATTER_DRAWS), -_SCATTER_LIMIT, _SCATTER_LIMIT)
    # One value more than the load, for interpolation up to the end.
    upset_times = _clock(load_times.size + 1, LOAD_STEP_S) - loop.warmup_s
    upsets = upsets_at(
        loop.upsets, upset_times, loop.duration_s, np.random.default_rng([seed, _UPSETS])
    )
    upsets[0] *= loop.valve.actuator.spring_range_n / 100.0
    manual = manual_output_at(loop.manual, scan_times)
    records, _ = run_loop(
        step_s,
        steps,
        valve_numbers(loop),
        process_numbers(loop),
        controller_numbers(loop),
        np.stack([set_point_at(loop, scan_times), manual, noise]),
        load_at(loop.loads, load_times, rng),
        upsets,
        scatter * loop.valve.scatter,
    )
    return np.asarray(records)


def _clock(count: int, interval_s: float) -> Floats:
    return np.arange(count, dtype=np.float64) * interval_s


def _warmup_samples(loop: PlantLoop) -> int:
    return round(loop.warmup_s / loop.archive.interval_s)


def _steps(loop: PlantLoop, step_s: float, reads: int = 1) -> Steps:
    """The loop's times as whole numbers of steps."""
    samples = _warmup_samples(loop) + int(loop.duration_s / loop.archive.interval_s + 1e-9)
    record = max(round(loop.archive.interval_s / reads / step_s), 1)
    return Steps(
        total=samples * record * reads,
        scan=max(round(loop.controller.scan_s / step_s), 1),
        load=max(round(LOAD_STEP_S / step_s), 1),
        record=record,
        record_phase=round(loop.archive.phase_s / step_s) % record,
        valve_delay=round(loop.valve.actuator.dead_time_s / step_s),
        process_delay=round(loop.process.dead_time_s / step_s),
    )
