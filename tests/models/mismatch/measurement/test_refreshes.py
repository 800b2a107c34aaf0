"""A recording whose values change at refreshes only is one of a sample for each refresh."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from stemwatch.models.mismatch.explain import explain
from stemwatch.models.mismatch.findings import Finding
from stemwatch.models.mismatch.measurement.refreshes import at_refreshes
from stemwatch.models.preparation.own_clock import on_own_clock
from stemwatch.models.recording import Recording, Role, Signal
from stemwatch.models.studies.simulator import PlantLoop, SimulatedValve, simulate_loop
from stemwatch.models.studies.simulator.loop import Load, LoadKind, SimulatedArchive, Transmitters


@cache
def plant(archive=None, step=0.0, S=5.0) -> Recording:
    """An hour of a flow loop under load with set-point steps, on its own clock."""
    loop = PlantLoop(
        valve=SimulatedValve(S=S, J=1.5),
        setpoints=tuple((float(t), 50.0 + 9.0 * (-1) ** (t // 300)) for t in range(10, 3500, 310)),
        loads=(Load(kind=LoadKind.COLOURED, size=1.0, time_s=20.0),),
        transmitters=Transmitters(position_noise=0.05, position_step=step),
        archive=archive or SimulatedArchive(),
    )
    return on_own_clock(simulate_loop(loop, 3).recording)


def every(recording, seconds, *roles) -> Recording:
    """The recording with the signals of some roles held for so long."""
    place = np.arange(len(recording)) // seconds * seconds
    held = {
        role: replace(recording.signals[role], values=recording.signals[role].values[place])
        for role in roles
    }
    return replace(recording, signals={**recording.signals, **held})


@pytest.mark.parametrize("step", [0.0, 0.5])
@pytest.mark.parametrize("average_s", [3.0, 10.0])
def test_averages_are_read_once(average_s, step):
    """Command and position of each block stand beside each other, on a clock of blocks, though the
    transmitter's noise and steps were added after.
    """
    recording = plant(SimulatedArchive(average_s=average_s), step)
    found = at_refreshes(recording)
    assert (average_s, 0) == (found.period, found.phase)
    assert average_s == found.recording.unit_s * found.recording.interval_s
    assert np.array_equal(found.recording.op.values, recording.op.values[:: found.period])
    assert np.array_equal(found.of(recording.mv.values), found.recording.mv.values)


def test_a_scan_of_both_is_read_once():
    """Snapshots that are held for five seconds are a recording of a sample every five seconds."""
    found = at_refreshes(every(plant(), 5, Role.OP, Role.MV, Role.PV))
    assert found is not None
    assert found.period == 5


def test_a_position_that_moves_between_refreshes_is_kept():
    """A controller that scans slowly holds OP and PV; the position then has samples of its own. A
    position that is scanned slowly leaves those of OP.
    """
    for roles in ((), (Role.OP,), (Role.OP, Role.PV), (Role.MV,)):
        assert at_refreshes(every(plant(), 5, *roles)) is None
    recording = plant()
    still = Signal.good(np.full(len(recording), 50.0), "FV-7.ZT")
    resting = replace(recording, signals={**recording.signals, Role.MV: still})
    assert at_refreshes(every(resting, 5, Role.OP)) is None


def test_runs_are_on_the_clock_that_was_read():
    """What is found in averages has runs of as many samples as were read, names no effect that
    shows within a block, and says what the archive did.
    """
    recording = plant(SimulatedArchive(average_s=10.0), S=7.0)
    mismatch = explain(recording)
    assert mismatch.finding is Finding.NONE
    assert len(recording) == mismatch.runs.naive.size == mismatch.runs.extended.size
    assert mismatch.runs.heldout_from % 10 == 0
    assert (np.diff(mismatch.runs.naive) != 0.0).nonzero()[0].size < len(recording) // 10
    assert "sampling_jitter" in [effect.slug for effect in mismatch.record_effects]
    refused = {one.slug for one in mismatch.not_testable}
    assert {"low_speed_restick", "slip_overshoot", "dwell_dependent_breakaway"} <= refused
    assert mismatch.restated.S.low <= 7.0 <= mismatch.restated.S.high
