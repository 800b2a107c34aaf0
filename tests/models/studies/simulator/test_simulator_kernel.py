"""The compiled kernel is its own source, and its step is small enough."""

import inspect
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from stemwatch.models.recording import Floats
from stemwatch.models.studies.simulator import (
    PlantLoop,
    SimulatedValve,
    driving_signals,
    kernel,
    simulate,
    simulate_loop,
)
from stemwatch.models.studies.simulator import kernel_inputs as si
from stemwatch.models.studies.simulator.defects import AirLine, BodyDefects, PackingDefects, Upsets
from stemwatch.models.studies.simulator.kernel import run_loop
from stemwatch.models.studies.simulator.loop import (
    Controller,
    Load,
    LoadKind,
    ManualSpan,
    Process,
    ProcessKind,
)

_STICKY = PlantLoop(
    valve=SimulatedValve(S=4.0, J=2.0),
    controller=Controller(gain=1.2, reset_s=3.0, derivative_s=0.3, scan_s=0.2),
    process=Process(second_lag_s=0.3),
    loads=(Load(kind=LoadKind.COLOURED, size=0.3, time_s=10.0),),
    setpoints=((2.0, 54.0),),
    duration_s=20.0,
    warmup_s=0.0,
)
_COMPILED = (
    "air_line_step",
    "air_step",
    "demanded_pressure",
    "between",
    "bristle_speed",
    "controller_at_scan",
    "controller_reading",
    "controller_scan",
    "friction_level",
    "moved_stem",
    "packing_levels",
    "plug_force",
    "process_step",
    "stem_speed",
    "valve_step",
    "within_stroke",
    "write_record",
)
_FULL = SimulatedValve(
    S=4.0,
    J=2.0,
    packing=PackingDefects(
        J_skew=0.3, bump_percent=1.0, dwell_percent=0.3, creep_percent_per_s=0.01
    ),
    body=BodyDefects(high_percent=52.0, flow_percent=2.0, hysteresis_percent=1.0),
    air_line=AirLine(
        vent_lag_s=1.0, fill_percent_per_s=2.0, ring_rad_per_s=0.8, ring_damping=0.4, sag_share=0.1
    ),
)


@pytest.mark.parametrize(
    "loop",
    [
        _STICKY,
        replace(_STICKY, valve=SimulatedValve.showing(3.0, 3.8, positioner_gain=1.5)),
        replace(_STICKY, process=Process(kind=ProcessKind.LEVEL, gain=0.05, integrating=True)),
        replace(_STICKY, valve=_FULL, upsets=Upsets(growth=1.0, vibration_percent=1.0)),
        replace(
            _STICKY,
            valve=SimulatedValve(S=4.0, J=2.0, packing=PackingDefects(presliding_percent=0.02)),
        ),
    ],
    ids=["sticky", "positioner", "integrating", "all of it", "bristles"],
)
def test_compiled_and_plain_kernel_agree(loop: PlantLoop, monkeypatch: pytest.MonkeyPatch) -> None:
    """The kernel as Python runs it gives the same stem as the compiled one."""
    compiled = simulate_loop(loop, seed=3)
    for name in _COMPILED:
        monkeypatch.setattr(kernel, name, inspect.unwrap(getattr(kernel, name)))
    monkeypatch.setattr(simulate, "run_loop", inspect.unwrap(run_loop))
    simulated = simulate_loop(loop, seed=3)
    np.testing.assert_allclose(simulated.stem, compiled.stem, rtol=0.0, atol=1e-9)
    assert np.ptp(compiled.stem) > 1.0


def _halved(loop: PlantLoop) -> tuple[Floats, Floats]:
    return simulate_loop(loop, seed=4).stem, simulate_loop(loop, seed=4, step_s=0.0005).stem


@pytest.mark.parametrize("gain", [0.0, 1.5], ids=["no positioner", "positioner"])
def test_half_the_step_gives_the_same_stroke(gain: float) -> None:
    """Driven from outside, 1 ms and 0.5 ms agree to 0.03 % of travel over all slips."""
    turns = tuple((31.3 * k, 50.0 + 6.0 * (-1) ** k * 0.97**k) for k in range(9))
    loop = replace(
        _STICKY,
        valve=SimulatedValve.showing(4.0, 4.5, positioner_gain=gain),
        manual=(ManualSpan(start_s=-1.0, stop_s=1e6, knots=turns),),
        duration_s=240.0,
    )
    complete, half = _halved(loop)
    assert np.percentile(np.abs(complete - half), 98) < 0.03
    assert np.abs(np.diff(complete)).sum() > 30.0


def test_half_the_step_gives_the_same_limit_cycle() -> None:
    """In closed loop a slip may fall into the next scan; the cycle's slips and rests are alike."""
    loop = replace(
        _STICKY,
        valve=SimulatedValve(S=3.0, J=3.0, scatter=0.0),
        process=Process(),
        controller=Controller(),
        loads=(),
        setpoints=((2.0, 51.5),),
        duration_s=600.0,
    )
    complete, half = _halved(loop)
    slips = [np.sum(np.abs(np.diff(stem)) > 1.0) for stem in (complete, half)]
    assert abs(slips[0] - slips[1]) <= 1
    assert slips[0] > 10
    assert np.median(np.abs(complete - half)) < 0.1


def test_half_the_step_gives_the_same_healthy_loop() -> None:
    """On a healthy valve, where no slip can fall one sample later, the agreement is 0.02 %."""
    complete, half = _halved(replace(_STICKY, valve=SimulatedValve(S=0.3, J=0.0), duration_s=240.0))
    assert np.max(np.abs(complete - half)) < 0.02
    assert np.ptp(complete) > 2.0


def test_a_standing_stem_holds_any_force_below_breakaway() -> None:
    """Karnopp: at rest the stem stays at rest up to the breakaway level, and leaves it above."""
    stem = si.stem_numbers(SimulatedValve(S=5.0, J=2.0))
    levels = (stem.breakaway_n, stem.kinetic_n)
    assert 0.0 == kernel.stem_speed(0.999 * stem.breakaway_n, 0.0, *levels, 1e-3, stem)
    assert 0.0 < kernel.stem_speed(1.001 * stem.breakaway_n, 0.0, *levels, 1e-3, stem)


def test_friction_takes_energy_from_a_free_stem() -> None:
    """Let go away from balance, the stem's energy never rises and it stops inside the friction."""
    stem = si.stem_numbers(SimulatedValve(S=2.0, J=0.0))
    stem = stem._replace(viscous_n_s_per_m=50.0)  # light damping, so that it swings
    x, v, energies = 0.2 * stem.stroke_m, 0.0, []
    for _ in range(20_000):
        force = -stem.spring_n_per_m * x
        v = kernel.stem_speed(force, v, stem.breakaway_n, stem.kinetic_n, 1e-4, stem)
        x += 1e-4 * v
        energies.append(0.5 * stem.mass_kg * v**2 + 0.5 * stem.spring_n_per_m * x**2)
    # A semi-implicit step exchanges a little energy with itself within a swing.
    assert np.max(np.diff(energies)) < 0.01 * energies[0]
    assert 0.0 == v
    assert abs(stem.spring_n_per_m * x) <= stem.breakaway_n


@pytest.mark.parametrize("pole", [0.0, 0.3, 0.99, 1.0])
def test_first_order_noise_is_scipys_filter(pole: float) -> None:
    """To the bit, so that a seed gives the same plant."""
    push = np.random.default_rng(1).standard_normal(500)
    expected = lfilter([0.7], [1.0, -pole], push)
    assert np.array_equal(driving_signals._first_order(push, 0.7, pole), expected)
