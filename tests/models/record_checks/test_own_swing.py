"""A position that swings by itself is no healthy valve, and noise or a loop that oscillates no
swing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stemwatch.models.record_checks.own_swing import OwnSwing, own_swing
from stemwatch.models.recording import Floats, Recording, Role, Signal
from stemwatch.models.screening.screen import Case, Options, screen
from stemwatch.models.stickslip.problem import make_problem
from stemwatch.models.studies.simulator import draw_healthy, simulate_loop
from stemwatch.models.verdict import Verdict

N = 1800
TIME = np.arange(N)


def steps(seed: int = 1) -> Floats:
    """A command of steps up and down, one a minute."""
    draw = np.random.default_rng(seed)
    return np.repeat(50.0 + draw.uniform(-6.0, 6.0, N // 60), 60)


def hunting(period: float, percent: float, seed: int = 2) -> Floats:
    """A swing of so many percent from peak to peak whose cycles are not all equal."""
    draw = np.random.default_rng(seed)
    phase = np.cumsum(2.0 * np.pi / period * (1.0 + 0.15 * draw.standard_normal(N)))
    return np.asarray(0.5 * percent * np.sin(phase))


def found(op: Floats, mv: Floats, run: Floats) -> OwnSwing | None:
    """The swing of a recording at 1 s, against a model's run."""
    signals = {Role.OP: Signal.good(op, "OP"), Role.MV: Signal.good(mv, "MV")}
    recording = Recording(valve="V", signals=signals, interval_s=1.0)
    return own_swing(make_problem(recording), run)


def noise(percent: float, seed: int = 3) -> Floats:
    return percent * np.random.default_rng(seed).standard_normal(N)


@pytest.mark.parametrize("period", [3.0, 7.0, 20.0])
@pytest.mark.parametrize("percent", [1.0, 6.0])
def test_a_swing_of_the_position_alone_is_found_with_its_size(period, percent):
    """Period and size of a swing from 3 to 20 samples are found beside noise."""
    op = steps()
    swing = found(op, op + hunting(period, percent) + noise(0.05), op)
    assert swing is not None
    assert swing.period_s == pytest.approx(period, rel=0.15)
    assert swing.percent == pytest.approx(percent, rel=0.25)


@pytest.mark.parametrize("of_noise", [0.05, 0.5, 2.0])
def test_noise_is_no_swing(of_noise):
    """White noise has no line, however much there is of it."""
    op = steps()
    assert found(op, op + noise(of_noise), op) is None


def test_what_wanders_is_no_swing():
    """A model that is off by something slow, as beside a drift, has no line either."""
    op, off = steps(), np.cumsum(noise(0.1))
    assert found(op, op + off, op) is None


def test_a_swing_of_the_command_is_no_swing_of_the_position_alone():
    """A loop that oscillates moves the stem, even where the model follows it badly."""
    op = steps() + hunting(12.0, 4.0)
    assert found(op, 50.0 + 1.4 * (op - 50.0) + noise(0.05), op) is None


def test_too_few_samples_in_a_row_are_no_ground():
    """Where the position is known in every other sample only, nothing is said."""
    op = steps()
    signals = {Role.OP: Signal.good(op, "OP"), Role.MV: Signal.good(op + hunting(6.0, 4.0), "MV")}
    problem = make_problem(Recording(valve="V", signals=signals, interval_s=1.0))
    gaps = replace(problem, block=np.where(TIME % 2, problem.block, -1))
    assert own_swing(gaps, op) is None


def test_a_stem_that_hunts_is_not_called_healthy():
    """A stem that does not stick and swings by 3 % without its command has no verdict; the reason
    says how far and how often, and no S is shown. Without the swing it is healthy. A reading that
    is off as well is no cause of a swing."""
    draw = np.random.default_rng(5)
    op = steps() + np.cumsum(0.02 * draw.standard_normal(N))
    still, hunts, off_too = (
        Recording(
            valve="V",
            signals={Role.OP: Signal.good(op, "OP"), Role.MV: Signal.good(mv + noise(0.05), "MV")},
            interval_s=1.0,
        )
        for mv in (op, op + hunting(5.0, 3.0), op + hunting(5.0, 3.0) + 1.5)
    )
    cases = [Case(recording=still), Case(recording=hunts), Case(recording=off_too)]
    healthy, hunting_stem, reads_high = screen(cases, Options(narx=False))
    assert healthy.verdict is Verdict.HEALTHY
    assert [effect.slug for effect in reads_high.mismatch.effects] == ["zero_shift"]
    assert reads_high.verdict is Verdict.UNDETERMINED
    assert "from peak to peak every 5 s while OP does not" in reads_high.reason
    assert hunting_stem.verdict is Verdict.UNDETERMINED
    assert "from peak to peak every 5 s while OP does not" in hunting_stem.reason
    assert hunting_stem.S.value is None
    assert "positioner" in hunting_stem.advice


@pytest.mark.long
@pytest.mark.parametrize("seed", [6161, 7171])
def test_no_healthy_valve_swings_by_itself(seed):
    """Of 36 simulated loops with healthy valves, tuned well and badly, none has a swing of its own
    as large as the limit."""
    loops = enumerate(draw_healthy(36, seed))
    cases = [Case(recording=simulate_loop(loop, place).recording) for place, loop in loops]
    screened = screen(cases, Options(narx=False, mismatch=False))
    assert sum(one.verdict is Verdict.HEALTHY for one in screened) >= 27
    assert not [one.reason for one in screened if "from peak to peak" in one.reason]
