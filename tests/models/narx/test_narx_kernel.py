"""The compiled normal matrix, against the one that torch builds from a whole Jacobian."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from stemwatch.models.narx import kernel, torch_batch
from stemwatch.models.narx.architecture import EDGE
from stemwatch.models.narx.example import NarxExample, NarxSettings
from stemwatch.models.narx.normal_equations import normal_matrices
from stemwatch.models.narx.run_plan import CODES, Indices, Plan, PlanStep, plan_run, segments
from stemwatch.models.narx.stages import random_starts
from stemwatch.models.narx.torch_batch import clamps, segment_blocks
from stemwatch.models.narx.training_record import TrainingRecord, prepare
from stemwatch.models.recording import Floats


def ready(seed: int = 1, samples: int = 900) -> TrainingRecord:
    """A stem that follows a slow command late and noisily, with a hole."""
    make = np.random.default_rng(seed)
    op = 50.0 + np.cumsum(make.normal(size=samples)) * 0.3
    mv = np.concatenate([op[:3], op[:-3]]) + 0.05 * make.normal(size=samples)
    usable = np.ones(samples, dtype=bool)
    usable[200:205] = False
    result = prepare(
        NarxExample(valve="V", op=op, mv=mv, usable=usable, train_until=600, interval_s=1.0),
        NarxSettings(),
    )
    assert isinstance(result, TrainingRecord), result
    return result


def compiled(
    valve: TrainingRecord,
    weights: Floats,
    horizon: int,
    most: float = np.inf,
    hidden: int = 5,
    runs: tuple[Indices, Indices] | None = None,
) -> Floats | None:
    """The kernel's normal matrix, or none where it gave up."""
    size, signals = weights.size + 1, valve.signals
    out = np.full((size, size), np.nan)
    matrix = kernel.normal_matrix(
        weights,
        hidden,
        signals.level,
        signals.move,
        signals.position,
        segments(valve.trained, horizon) if runs is None else runs,
        valve.limits,
        valve.ratio,
        EDGE,
        torch_batch.LIMIT,
        most,
        out,
    )
    return out if matrix else None


def by_torch(
    valves: list[TrainingRecord], flat: torch.Tensor, horizon: int, hidden: int = 5
) -> Floats:
    """The same of a padded batch, as on a device that is no CPU."""
    pieces, limits = segment_blocks(valves, horizon, hidden, 1, "cpu"), clamps(valves, 1, "cpu")
    split = torch_batch.Weights.split(flat, hidden)
    return torch_batch.normal_matrix(pieces, split, limits).numpy()


@pytest.mark.parametrize("horizon", [1, 20, 300])
@pytest.mark.parametrize("scale", [1.0, 8.0], ids=["gentle", "wild, so that clamps act"])
@pytest.mark.parametrize("most", [2**26, 1], ids=["in one block", "in a block for each segment"])
def test_the_kernel_and_torch_build_the_same_matrix(
    monkeypatch: pytest.MonkeyPatch, horizon: int, scale: float, most: int
) -> None:
    """One network at a time without padding, or all of them padded: the same numbers.

    To 1e-8 only, because a wild run carries a difference of the last digit far.
    """
    monkeypatch.setattr(torch_batch, "_MOST_SENSITIVITIES", most)
    valves = [ready(1), ready(2, 700)]
    flat = scale * random_starts(NarxSettings(), 2)
    expected = by_torch(valves, torch.from_numpy(flat), horizon)
    for valve, weights, matrix in zip(valves, flat, expected, strict=True):
        result = compiled(valve, weights, horizon)
        assert result is not None
        np.testing.assert_allclose(result, matrix, rtol=0, atol=1e-8 * np.abs(matrix).max())


def test_it_gives_up_exactly_where_the_error_allowed_is_passed() -> None:
    """A bound of r'r itself is not passed; the next smaller number is."""
    valve, weights = ready(), random_starts(NarxSettings(), 1)[0]
    complete = compiled(valve, weights, 20)
    assert complete is not None
    squares = 0.0
    for residual in _residuals(valve, weights, 20):
        squares += residual * residual
    assert squares == pytest.approx(complete[-1, -1], rel=1e-12)
    assert compiled(valve, weights, 20, most=squares * (1 + 1e-12)) is not None
    assert compiled(valve, weights, 20, most=squares * (1 - 1e-12)) is None
    assert compiled(valve, np.full(41, np.nan), 20) is None


def _residuals(valve: TrainingRecord, weights: Floats, horizon: int) -> Floats:
    """The same network's free runs against the measurement, sample by sample."""
    plan = plan_run(valve.trained, horizon)
    run = simulated(valve, weights[None], plan)[0]
    return np.asarray((run - valve.signals.position)[plan >= PlanStep.RUN])


def simulated(valve: TrainingRecord, weights: Floats, plan: Plan) -> Floats:
    """The free runs (m, n) of networks with weights (m, P); NaN where there is none."""
    signals = valve.signals
    out = np.full((weights.shape[0], plan.size), np.nan)
    kernel.free_run(
        weights,
        5,
        signals.level,
        signals.move,
        signals.position,
        plan,
        CODES,
        valve.limits,
        valve.ratio,
        EDGE,
        out,
    )
    return out


def test_a_network_without_an_acceptable_error_is_skipped() -> None:
    """Where no error is small enough the matrix is not built, and its error counts as infinite."""
    flat = torch.from_numpy(random_starts(NarxSettings(), 2))
    normal, samples = normal_matrices([ready()], 5, 20, 2, "cpu")
    matrices = normal(flat, torch.tensor([torch.inf, -torch.inf], dtype=torch.float64))
    assert bool(torch.isfinite(matrices[0]).all())
    assert matrices[1, -1, -1] == torch.inf
    assert not matrices[1, :-1].any()
    assert samples.tolist() == [float(segments(ready().trained, 20)[1].sum())] * 2


@settings(deadline=None)
@given(st.floats(min_value=-1e308, max_value=1e308))
def test_the_quick_tanh_is_a_tanh(x: float) -> None:
    """Within 4e-16 everywhere, also where the exponential overflows."""
    assert abs(kernel._tanh(x) - np.tanh(x)) <= 4e-16


def test_the_quick_tanh_is_odd_and_knows_no_number() -> None:
    """Densely where it bends: within 4e-16, never beyond 1, and NaN stays NaN."""
    bending = np.linspace(-21.0, 21.0, 20001)
    array = np.array([kernel._tanh(x) for x in bending])
    np.testing.assert_allclose(array, np.tanh(bending), rtol=0, atol=4e-16)
    assert np.abs(array).max() == 1.0
    assert [kernel._tanh(-x) for x in bending] == list(-array)
    assert [kernel._tanh(x) for x in (-np.inf, np.inf)] == [-1.0, 1.0]
    assert np.isnan(kernel._tanh(np.nan))


@pytest.mark.parametrize("hidden", [1, 3, 8])
def test_any_number_of_hidden_units_and_of_runs_side_by_side(hidden: int) -> None:
    """More units or fewer, and pieces of all lengths: still the matrix that torch builds."""
    valve = replace(ready(3), trained=np.arange(900) % 97 > np.arange(900) // 13)
    flat = random_starts(NarxSettings(hidden=hidden), 1)
    assert len(set(segments(valve.trained, 60)[1])) == 10
    expected = by_torch([valve], torch.from_numpy(flat), 60, hidden)[0]
    result = compiled(valve, flat[0], 60, hidden=hidden)
    np.testing.assert_allclose(result, expected, rtol=0, atol=1e-10 * np.abs(expected).max())


def test_the_order_of_the_runs_does_not_matter() -> None:
    """Longest first is quick; any order is right, and so is no run at all."""
    valve, weights = ready(), random_starts(NarxSettings(), 1)[0]
    starts, lengths = segments(valve.trained, 7)
    expected = compiled(valve, weights, 7)
    order = np.random.default_rng(0).permutation(starts.size)
    result = compiled(valve, weights, 7, runs=(starts[order], lengths[order]))
    np.testing.assert_allclose(result, expected, rtol=0, atol=1e-12 * np.abs(expected).max())
    nothing = compiled(valve, weights, 7, runs=(starts[:0], lengths[:0]))
    assert nothing is not None
    assert not nothing.any()


def test_members_side_by_side_run_as_each_alone() -> None:
    """Bit for bit, also where there are more members than lanes."""
    valve, flat = ready(), 3.0 * random_starts(NarxSettings(), 19)
    plan = plan_run(valve.trained, 50)
    together = simulated(valve, flat, plan)
    alone = [simulated(valve, flat[[at]], plan)[0] for at in range(19)]
    np.testing.assert_array_equal(together, alone)
    assert len(np.unique(together[:, -1])) == 1  # not trained on: left as it was
    assert len(np.unique(together[:, 400])) > 10
