"""A vibration of the position's reading is named, sized and taken out, and nothing else is."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from stemwatch.models.mismatch.explain import explain
from stemwatch.models.mismatch.findings import Finding
from stemwatch.models.mismatch.measurement.record_effects import measured_record
from stemwatch.models.mismatch.measurement.vibration import find_vibration, without_vibration
from stemwatch.models.mismatch.prepared_recording import problem_of
from stemwatch.models.recording import Recording, Role
from stemwatch.models.studies.simulator import PlantLoop, SimulatedValve, simulate_loop
from stemwatch.models.studies.simulator.hidden import draw_effect, draw_nulls
from stemwatch.models.studies.simulator.loop import Load, LoadKind, Transmitters

NOISE = 0.1


@cache
def plant(S=4.0, J=1.5, noise=NOISE, load=1.0, seed=5151) -> Recording:
    """An hour of a flow loop with set-point steps; without a load friction alone moves it."""
    loop = PlantLoop(
        valve=SimulatedValve(S=S, J=J),
        setpoints=tuple((float(t), 50.0 + 9.0 * (-1) ** (t // 300)) for t in range(10, 3500, 310))
        if load
        else (),
        loads=(Load(kind=LoadKind.COLOURED, size=load, time_s=20.0),) if load else (),
        transmitters=Transmitters(position_noise=noise),
    )
    return simulate_loop(loop, seed).recording


def shaken(recording: Recording, amplitude: float, frequency: float) -> Recording:
    """The recording with a sine on its position, in cycles a sample."""
    mv = recording.mv
    wave = amplitude * np.sin(2.0 * np.pi * (frequency * np.arange(len(recording)) + 0.3))
    return replace(
        recording,
        signals={**recording.signals, Role.MV: replace(mv, values=mv.values + wave)},
    )


def found(recording: Recording):
    return find_vibration(recording, measured_record(recording).real)


@pytest.mark.parametrize(
    ("amplitude", "true", "seen"),
    [(0.3, 0.21, 0.21), (2.0, 0.37, 0.37), (0.8, 24.87, 0.13), (0.8, 7.3, 0.3), (0.5, 0.45, 0.45)],
)
def test_a_line_is_found_at_its_alias_and_taken_out_of_the_noise(amplitude, true, seen):
    """Amplitude within 5 %, frequency within a thousandth of a cycle a sample; and the noise is
    that of the transmitter again."""
    recording = shaken(plant(), amplitude, true)
    vibration = found(recording)
    assert vibration is not None
    assert amplitude == pytest.approx(vibration.amplitude, rel=0.05)
    assert seen == pytest.approx(vibration.frequency, abs=1e-3)
    measured = measured_record(recording)
    still = without_vibration(recording, vibration)
    before, after, never = (problem_of(one, measured).sigma for one in (recording, still, plant()))
    assert before > 1.5 * never
    assert never == pytest.approx(after, rel=0.1)


def test_the_sentence_on_a_vibration_names_its_possible_frequencies():
    """A record effect with frequency, amplitude, the frequencies behind it, and where to look."""
    told = next(
        effect
        for effect in explain(shaken(plant(), 0.8, 0.13)).record_effects
        if effect.slug == "vibration"
    )
    assert 0.8 == pytest.approx(told.parameters["amplitude_percent"], rel=0.05)
    assert 0.13 == pytest.approx(told.parameters["frequency_hz"], abs=1e-3)
    assert "0.13 Hz" in told.sentence
    assert "0.87 Hz" in told.sentence
    assert "bracket and linkage" in told.sentence


@pytest.mark.long
def test_a_vibration_does_not_change_S_and_J():
    """S and J of a shaken reading are those of the same valve at rest, and nothing is named."""
    still, moved = explain(plant()), explain(shaken(plant(), 1.0, 0.31))
    assert still.finding is moved.finding is Finding.NONE
    assert still.restated.S.value == pytest.approx(moved.restated.S.value, abs=0.1)
    assert still.restated.J.value == pytest.approx(moved.restated.J.value, abs=0.15)


@pytest.mark.parametrize("noise", [0.0, 0.02, 0.3])
@pytest.mark.parametrize(("S", "J"), [(6.0, 2.0), (4.0, 0.0), (3.0, 3.0)])
def test_the_cycle_of_a_sticking_loop_is_no_vibration(S, J, noise):
    """A limit cycle and its multiples are the loop's own."""
    assert found(plant(S, J, noise, load=0.0)) is None


@pytest.mark.parametrize("period", [2.5, 4.0, 7.0, 11.0, 30.0])
@pytest.mark.parametrize("wave", [np.sin, lambda phase: np.sign(np.sin(phase))])
def test_an_oscillation_of_the_command_is_no_vibration(period, wave):
    """A dither of OP, and a quick oscillation of it, reach the position through a stem without
    friction or with play, and are the command's; so are their multiples."""
    recording = plant()
    op, rng = recording.op, np.random.default_rng(8383)
    swing = 2.0 * wave(2.0 * np.pi * np.arange(len(recording)) / period)
    for position in (swing, np.clip(swing, -1.2, 1.2), np.roll(np.clip(swing, -1.2, 1.2), 1)):
        read = 50.0 + position + rng.normal(0.0, 0.05, position.size)
        signals = {
            **recording.signals,
            Role.OP: replace(op, values=50.0 + swing),
            Role.MV: replace(recording.mv, values=read),
        }
        assert found(replace(recording, signals=signals)) is None


@pytest.mark.parametrize(
    ("each_kind", "ringing"),
    [(slice(0, 16, 6), 1), pytest.param(slice(16), 3, marks=pytest.mark.long)],
)
def test_valves_with_nothing_hidden_show_no_vibration(each_kind, ringing):
    """Sixteen valves with nothing hidden, two of each kind of record, and a ringing positioner."""
    cases = [
        *draw_nulls(16, 5151)[each_kind],
        *draw_effect("underdamped_positioner", 3, 5151)[:ringing],
    ]
    for case in cases:
        recording = case.simulated().recording
        assert found(recording) is None, case


def test_a_short_or_broken_record_has_no_line():
    """Too few samples, or too many holes in them, say nothing."""
    recording = shaken(plant(), 1.0, 0.21)
    real = measured_record(recording).real
    holes = real & (np.arange(real.size) % 3 > 0)
    assert find_vibration(recording, real) is not None
    assert find_vibration(recording, holes) is None
    assert find_vibration(recording, real & (np.arange(real.size) < 200)) is None
    no_position = {Role.OP: recording.op}
    assert find_vibration(replace(recording, signals=no_position), real) is None
