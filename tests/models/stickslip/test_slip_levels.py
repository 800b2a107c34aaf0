"""Both levels of a stem whose command is known at the samples only."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stemwatch.models.recording import Floats, Recording, Role, Signal
from stemwatch.models.stickslip.onsets import least_departure
from stemwatch.models.stickslip.problem import FitProblem, make_problem
from stemwatch.models.stickslip.slip_levels import (
    FEWEST,
    UNSEEN_SHARE,
    SlipLevels,
    Slips,
    seen_slips,
    slip_levels,
)

LEVEL, KINETIC = 4.0, 1.5


def ramps(samples: int, legs: int, seed: int, *, scatter: float = 0.0, gain: float = 1.0):
    """OP runs up and down, each leg at a speed of its own, and turns as the stem slips; ``samples``
    of it are kept to a leg. Command and position (n,), percent."""
    rng = np.random.default_rng(seed)
    fine = 50
    op, mv, here, stem, way = [], [], 50.0, 50.0, 1.0
    clock = 0
    for _ in range(legs):
        level = LEVEL * (1.0 + scatter * rng.standard_normal())
        speed = (LEVEL + KINETIC) / (samples * fine) * rng.uniform(0.8, 1.25)
        while way * (here - stem) < level:
            here += way * speed
            if clock % fine == 0:
                op.append(here)
                mv.append(stem)
            clock += 1
        stem, way = here - way * KINETIC, -way
    position = gain * np.array(mv) + 0.02 * rng.standard_normal(len(mv))
    return np.array(op), position


def problem_of(op: Floats, mv: Floats) -> FitProblem:
    signals = {Role.OP: Signal.good(op, "V.OP"), Role.MV: Signal.good(mv, "V.MV")}
    return make_problem(Recording(valve="V", signals=signals, interval_s=1.0))


def slips_of(problem: FitProblem, gain: float = 1.0) -> Slips:
    slips = seen_slips(problem, gain, 0.0)
    assert slips is not None
    return slips


def found(problem: FitProblem, gain: float = 1.0) -> SlipLevels:
    return slip_levels(slips_of(problem, gain))


@pytest.mark.parametrize("samples", [5, 8, 15])
@pytest.mark.parametrize("scatter", [0.0, 0.1])
def test_levels_between_samples_are_found(samples: int, scatter: float) -> None:
    """Peaks of OP lie between samples: S and J within two standard errors, which are small."""
    levels = found(problem_of(*ramps(samples, 100, samples, scatter=scatter)))
    assert abs(levels.S - (LEVEL + KINETIC)) < 2.0 * levels.S_error
    assert abs(levels.J - (LEVEL - KINETIC)) < 2.0 * levels.J_error
    assert levels.S_error < 0.07 * (LEVEL + KINETIC)
    assert levels.level_error < 0.07 * LEVEL
    assert levels.S == pytest.approx(levels.level + levels.kinetic)
    assert levels.J == pytest.approx(levels.level - levels.kinetic)
    assert levels.J_error > levels.S_error


def test_the_middle_of_the_bounds_is_near_the_levels() -> None:
    """The middle decides whether the likelihood is computed."""
    slips = slips_of(problem_of(*ramps(8, 100, 8, scatter=0.05)))
    levels = slip_levels(slips)
    assert slips.middle[0] == pytest.approx(levels.level, abs=0.2)
    assert slips.middle[1] == pytest.approx(levels.kinetic, abs=0.2)


def test_fewer_samples_give_wider_bounds_and_larger_errors() -> None:
    """Fewer samples to a leg: wider bounds, and larger errors."""
    few, several = (found(problem_of(*ramps(samples, 100, 3))) for samples in (5, 20))
    assert few.bounds > 2.0 * several.bounds
    assert few.level_error > several.level_error
    assert few.S_error > several.S_error
    assert few.J_error > several.J_error


def test_the_command_has_answered_when_it_turns_at_the_slip() -> None:
    """Its speed after the sample of a slip is the other way round."""
    assert slips_of(problem_of(*ramps(8, 60, 4))).answered < 0.0


def test_a_reversed_reading_has_the_same_levels() -> None:
    """Percent of OP, whatever the reading's gain."""
    plain = found(problem_of(*ramps(8, 60, 5)))
    op, mv = ramps(8, 60, 5, gain=-0.5)
    other = found(problem_of(op, mv), gain=-0.5)
    assert other.level == pytest.approx(plain.level, abs=0.1)
    assert other.kinetic == pytest.approx(plain.kinetic, abs=0.1)


def test_too_few_slips_give_no_levels() -> None:
    """Two fewer than are asked for."""
    assert seen_slips(problem_of(*ramps(20, FEWEST - 2, 6)), 1.0, 0.0) is None


def test_a_stem_that_follows_lets_go_at_once() -> None:
    """Its starts after the turns of OP are taken for slips, with hardly a level."""
    rng = np.random.default_rng(7)
    op = 50.0 + 5.0 * np.sin(np.arange(600) / 20.0)
    levels = found(problem_of(op, op + 0.02 * rng.standard_normal(600)))
    assert levels.level < 0.05 * LEVEL
    assert levels.kinetic < 0.05 * LEVEL


def test_slips_that_noise_hides_do_not_raise_J() -> None:
    """Of slips near what must be exceeded to be seen, only the larger ones are; S stays."""
    op, mv = ramps(8, 60, 4)
    slips = slips_of(problem_of(op, mv))
    quiet, noisy = slip_levels(slips), slip_levels(replace(slips, sigma=slips.sigma + 0.1))
    apart = UNSEEN_SHARE * (least_departure(slips.sigma + 0.1) - least_departure(slips.sigma))
    assert quiet.J - noisy.J == pytest.approx(apart, abs=0.1)
    assert quiet.S == pytest.approx(noisy.S, abs=0.1)


@pytest.mark.parametrize(("J", "may"), [(0.3, True), (0.5, False)])
def test_a_jump_as_small_as_creep_may_be_none(J: float, *, may: bool) -> None:
    """However slowly OP goes."""
    levels = SlipLevels(
        20, 2.0 + J / 2, 0.1, 2.0 - J / 2, 0.1, 0.01, 0.01, bounds=0.1, per_sample=0.1
    )
    assert levels.may_slide is may
