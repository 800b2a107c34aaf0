"""The fit of S and J beside alternative methods, on the same simulated sticking loops and one core.

    python tests/benchmarks/bench_fit.py [--valves 16] [--seed 5151] [--json FILE]

Recordings come from the force-balance plant, so S and J are known. All methods minimise the same
robust loss over the same first part of the record, with the same compiled kernel where they run it
candidate by candidate:

- *stemwatch*: ``fit_stickslip`` whole: three hypotheses, the choice between them, the refit on the
  whole record. Its *simulations* are counted; *times them bare* is its time over that of so many
  bare simulations, that is, what the search costs beside the simulating.
- *grid, numpy*: S, J and zero over 40 x 12 x 3 candidates, all of them vectorised in numpy and one
  step of Python for each sample; S and J alone, no dead time, lag or speed limit.
- *DE, S and J*: scipy's differential evolution over S, J/S and zero.
- *DE, all*: the same over everything ``stemwatch`` fits: dead time, lags and speeds as well.

*S off* and *J off* are medians of the distance from the truth in percent of span; *loss* is the
mean of the loss that a method reached on the part it minimised, over that of the hypothesis that
stemwatch chose, fitted to that part (below 1 is lower). Where it chose S and J alone, the wider
model may well reach less.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import differential_evolution

from stemwatch.models.recording import Floats, Recording
from stemwatch.models.stickslip import kernel
from stemwatch.models.stickslip import parameters as coordinate
from stemwatch.models.stickslip.evaluator import StickSlipEvaluator
from stemwatch.models.stickslip.fit import StickSlipFit, fit_stickslip
from stemwatch.models.stickslip.parameters import to_kernel
from stemwatch.models.stickslip.problem import FitProblem
from stemwatch.models.studies.simulator import draw_sticky, simulate_loop

GRID_S, GRID_RATIO, GRID_ZERO = 40, 12, 3
SEED = 1


@dataclass(frozen=True)
class Valve:
    """A simulated recording and its truth, percent of span."""

    recording: Recording
    S: float
    J: float


@dataclass(frozen=True)
class Result:
    """The result of a method for a valve, its time, and its number of simulations."""

    seconds: float
    candidate: Floats
    simulations: int


class Counter:
    """Counts the candidates passed to ``FitProblem.losses``, which it replaces."""

    def __init__(self) -> None:
        self.simulations = 0
        self._own = FitProblem.losses

    def __enter__(self) -> Counter:
        def counted(problem: FitProblem, candidates: Floats, delta: float) -> tuple[Floats, Floats]:
            self.simulations += candidates.shape[0]
            return self._own(problem, candidates, delta)

        FitProblem.losses = counted  # type: ignore[method-assign, assignment]  # to count
        return self

    def __exit__(self, *_: object) -> None:
        FitProblem.losses = self._own  # type: ignore[method-assign]


def valves(count: int, seed: int) -> list[Valve]:
    """Sticking loops with all shapes in turn."""
    loops = [
        simulate_loop(loop, 1000 * seed + n) for n, loop in enumerate(draw_sticky(count, seed))
    ]
    return [Valve(recording=loop.recording, S=loop.truth.S, J=loop.truth.J) for loop in loops]


def ours(valve: Valve) -> tuple[Result, StickSlipFit]:
    """The product's fit, once counted and once timed."""
    with Counter() as counter:
        fit_stickslip(valve.recording)
    started = time.process_time()
    fit = fit_stickslip(valve.recording)
    return Result(time.process_time() - started, fit.candidate, counter.simulations), fit


def bare_seconds(fit: StickSlipFit, simulations: int) -> float:
    """Seconds that so many bare simulations of this recording take, one vector after another."""
    problem, q = fit.evaluator.problem, to_kernel(fit.candidate, fit.evaluator.restick)[0]
    out, marks = np.empty(problem.op.size), problem.resynced_marks
    times_s = []
    for _ in range(50):
        started = time.perf_counter()
        kernel.simulate(problem.op, problem.mv, marks, problem.interval_s, q, out)
        times_s.append(time.perf_counter() - started)
    return simulations * float(np.median(times_s))


def training_loss(evaluator: StickSlipEvaluator) -> Callable[[Floats], Floats]:
    """The loss over the training part as a function of candidates (m, 9)."""
    return evaluator.loss(evaluator.problem.training_blocks())


def numpy_grid(evaluator: StickSlipEvaluator) -> Result:
    """S, J/S and zero on a grid, every candidate in one array, sample by sample."""
    started = time.process_time()
    problem = evaluator.problem
    widths = np.linspace(0.0, evaluator.bounds.high[coordinate.S_PERCENT], GRID_S)
    ratios = np.linspace(0.0, 1.3, GRID_RATIO)
    error = (problem.mv - problem.op)[problem.scored]
    middle = float(np.percentile(error, 2) + np.percentile(error, 98)) / 2.0
    zeros = middle + problem.swing * np.linspace(-0.05, 0.05, GRID_ZERO)
    s, ratio, zero = (item.ravel() for item in np.meshgrid(widths, ratios, zeros, indexing="ij"))
    fs, fd = 0.5 * s * (1.0 + ratio), 0.5 * s * (1.0 - ratio)
    train = problem.training_blocks()
    until = int(np.flatnonzero(np.isin(problem.block, np.flatnonzero(train)))[-1]) + 1
    x = np.clip(problem.mv[0] - zero, problem.op[0] - fs, problem.op[0] + fs)
    moving, way = np.zeros(s.size, dtype=bool), np.ones(s.size)
    product, total = np.zeros(s.size), 0
    for k in range(1, until):
        step = problem.op[k] - problem.op[k - 1]
        moving &= way * step > 0.0
        force = problem.op[k] - x
        breaks = ~moving & (np.abs(force) > fs)
        way = np.where(breaks, np.sign(force), way)
        moving |= breaks
        x = np.where(moving, problem.op[k] - way * fd, x)
        if problem.block[k] >= 0:
            product += np.log1p(((problem.mv[k] - x - zero) / evaluator.delta) ** 2)
            total += 1
    best = int(np.argmin(product))
    candidate = np.zeros(coordinate.N_COORDINATES)
    candidate[[coordinate.S_PERCENT, coordinate.RATIO, coordinate.ZERO]] = (
        s[best],
        ratio[best],
        zero[best],
    )
    return Result(time.process_time() - started, candidate, s.size)


def evolution(evaluator: StickSlipEvaluator, free: tuple[int, ...]) -> Result:
    """scipy's differential evolution over ``free``, its population handed over at once."""
    loss = training_loss(evaluator)
    count = 0

    def value(drawn: Floats) -> Floats:
        nonlocal count
        candidates = np.zeros((drawn.shape[1], coordinate.N_COORDINATES))
        candidates[:, list(free)] = drawn.T
        count += candidates.shape[0]
        return loss(candidates)

    limits = list(
        zip(evaluator.bounds.low[list(free)], evaluator.bounds.high[list(free)], strict=True)
    )
    started = time.process_time()
    result = differential_evolution(
        value, limits, rng=SEED, vectorized=True, updating="deferred", polish=False
    )
    candidate = np.zeros(coordinate.N_COORDINATES)
    candidate[list(free)] = result.x
    return Result(time.process_time() - started, candidate, count)


def measure(count: int, seed: int) -> list[dict[str, object]]:
    """One row for each method."""
    some = valves(count, seed)
    fit_stickslip(some[0].recording)  # compiled before the clock runs
    narrow = (coordinate.S_PERCENT, coordinate.RATIO, coordinate.ZERO)
    wide = (*narrow, *coordinate.ACTUATOR)
    result: dict[str, list[tuple[Result, float]]] = {}
    bare = []
    for valve in some:
        own, fit = ours(valve)
        bare.append(bare_seconds(fit, own.simulations))
        loss = training_loss(fit.evaluator)
        least = float(loss(fit.trained[None, :])[0])
        tried = {
            "stemwatch": own,
            "grid, numpy": numpy_grid(fit.evaluator),
            "DE, S and J": evolution(fit.evaluator, narrow),
            "DE, all": evolution(fit.evaluator, wide),
        }
        for name, item in tried.items():
            reached = least if item is own else float(loss(item.candidate[None, :])[0])
            result.setdefault(name, []).append((item, reached / least))
    own_seconds = float(np.mean([item.seconds for item, _ in result["stemwatch"]]))
    rows = [_row(name, some, results, own_seconds) for name, results in result.items()]
    rows[0]["times_bare"] = round(own_seconds / float(np.mean(bare)), 2)
    return rows


def _row(
    name: str, some: list[Valve], results: list[tuple[Result, float]], own_seconds: float
) -> dict[str, object]:
    seconds = float(np.mean([item.seconds for item, _ in results]))
    s = np.array([item.candidate[coordinate.S_PERCENT] for item, _ in results])
    j = s * np.array([item.candidate[coordinate.RATIO] for item, _ in results])
    return {
        "method": name,
        "seconds": round(seconds, 4),
        "times_ours": round(seconds / own_seconds, 2),
        "simulations": round(float(np.mean([item.simulations for item, _ in results]))),
        "times_bare": None,
        "S_off": round(float(np.median(np.abs(s - [valve.S for valve in some]))), 3),
        "J_off": round(float(np.median(np.abs(j - [valve.J for valve in some]))), 3),
        "loss": round(float(np.mean([ratio for _, ratio in results])), 3),
    }


def main() -> None:
    """Read the options, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--valves", type=int, default=16)
    parser.add_argument("--seed", type=int, default=5151)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    rows = measure(arguments.valves, arguments.seed)
    print("".join(f"{name.replace('_', ' '):>14}" for name in rows[0]))
    for row in rows:
        print("".join(f"{'-' if cell is None else cell:>14}" for cell in row.values()))
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
