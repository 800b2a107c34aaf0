"""A stem that goes out and back by itself is no healthy valve; noise, steps and archives are no
pulses."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest

from stemwatch.models.record_checks.pulsing_stem import Pulses, find_pulses
from stemwatch.models.recording import Floats, Recording, Role, Signal
from stemwatch.models.screening.screen import Case, Options, screen
from stemwatch.models.screening_result import Screening
from stemwatch.models.signals.first_order_lag import first_order_lag
from stemwatch.models.stickslip.fit import fit_stickslip
from stemwatch.models.studies.simulator import draw_healthy, simulate_loop
from stemwatch.models.verdict import Verdict

N = 2400
QUICK = Options(narx=False, mismatch=False)


def command(seed: int = 1) -> Floats:
    """An OP that goes up and down by some percent within minutes, as under a slow load."""
    draw = np.random.default_rng(seed)
    load = first_order_lag(first_order_lag(draw.standard_normal(N), 150.0), 40.0)
    return np.asarray(50.0 + 3.0 * load / load.std())


def follows(op: Floats, noise: float = 0.05, seed: int = 2) -> Floats:
    """The reading of a stem that follows."""
    return first_order_lag(op, 1.0) + noise * np.random.default_rng(seed).standard_normal(N)


def pulses(kind: str, percent: float, every: int, seed: int = 3) -> Floats:
    """What a positioner adds by itself: ``percent`` from peak to peak."""
    draw, time = np.random.default_rng(seed), np.arange(N)
    if kind == "sine":
        return np.asarray(0.5 * percent * np.sin(2.0 * np.pi * time / every))
    if kind == "square":
        return np.asarray(0.5 * percent * np.sign(np.sin(2.0 * np.pi * time / every)))
    out = np.zeros(N)
    for begin in np.cumsum(draw.integers(every // 2, 2 * every, 2 * N // every)):
        out[begin : begin + draw.integers(4, every // 2)] += percent * draw.choice((-1.0, 1.0))
    return out


def recording(op: Floats, mv: Floats) -> Recording:
    signals = {Role.OP: Signal.good(op, "OP"), Role.MV: Signal.good(mv, "MV")}
    return Recording(valve="V", signals=signals, interval_s=1.0)


def found(op: Floats, mv: Floats) -> Pulses | None:
    return find_pulses(fit_stickslip(recording(op, mv)))


def screened(op: Floats, mv: Floats) -> Screening:
    (one,) = screen([Case(recording=recording(op, mv))], QUICK)
    return one


@pytest.mark.parametrize(
    ("kind", "percent", "every"),
    [("sine", 1.0, 60), ("square", 1.0, 90), ("irregular", 1.0, 30), ("irregular", 3.0, 80)],
)
def test_a_stem_that_pulses_is_not_called_healthy(kind, percent, every):
    """A stem that follows and pulses has no verdict; the reason says how far, and no S is shown.
    Without the pulses it is healthy."""
    op = command()
    assert screened(op, follows(op)).verdict is Verdict.HEALTHY
    pulsing = screened(op, follows(op) + pulses(kind, percent, every))
    assert pulsing.verdict is Verdict.UNDETERMINED
    assert "the position goes out and back by" in pulsing.reason
    assert pulsing.S.value is None
    assert "feedback arm" in pulsing.advice


def test_their_size_is_told():
    """Pulses of 2 % are seen with about that size, and about as often as they came."""
    op = command()
    seen = found(op, follows(op) + pulses("square", 2.0, 60))
    assert seen is not None
    assert seen.percent == pytest.approx(2.0, rel=0.2)
    assert 40 <= seen.count <= 85


@pytest.mark.parametrize("noise", [0.05, 0.3, 1.0])
def test_noise_is_no_pulse(noise):
    """White noise does not go out and back, however large it is."""
    op = command()
    assert found(op, follows(op, noise)) is None


def test_single_samples_are_no_pulses():
    """A reading that fails for one sample now and then moves no stem."""
    op = command()
    mv = follows(op)
    mv[::90] += 2.0
    assert found(op, mv) is None


@pytest.mark.parametrize("step", [0.25, 0.5])
def test_a_recorders_steps_are_no_pulses(step):
    """Nor do readings go out and back that a recorder rounds."""
    op = command()
    assert found(op, np.round(follows(op) / step) * step) is None


def test_what_the_command_does_is_no_pulse():
    """A command that pulses moves a healthy stem alike."""
    op = command() + pulses("irregular", 2.0, 60)
    assert found(op, follows(op)) is None


@pytest.mark.recordings
@pytest.mark.parametrize("name", ["kp04_m0.535_l0.10_r1", "kp16_m0.535_l0.10_r1"])
def test_a_real_drive_does_not_pulse(name, recordings: Path):
    """Nor does a real servo under load."""
    path = recordings / "servo_ladder" / f"{name}.csv.gz"
    with gzip.open(path, "rt") as text:
        op, mv = np.genfromtxt(text, delimiter=",", skip_header=1, usecols=(1, 2)).T
    signals = {Role.OP: Signal.good(op, "OP"), Role.MV: Signal.good(mv, "MV")}
    whole = Recording(valve="V", signals=signals, interval_s=0.01)
    assert find_pulses(fit_stickslip(whole)) is None


@pytest.mark.long
@pytest.mark.parametrize("seed", [6161, 7171])
def test_no_healthy_valve_pulses(seed):
    """Of 18 simulated loops with healthy valves, at the odd places of a draw, none pulses."""
    loops = list(enumerate(draw_healthy(36, seed)))[1::2]
    cases = [Case(recording=simulate_loop(loop, place).recording) for place, loop in loops]
    assert not [one.reason for one in screen(cases, QUICK) if "out and back" in one.reason]
