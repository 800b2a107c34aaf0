"""``fit_model``: one method of fitting, of intervals and of scoring for every literature model."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.estimate import Estimate
from stemwatch.models.recording import Bools, Floats, Recording
from stemwatch.models.statistics.block_bootstrap import COVERAGE, block_weights, cheapest
from stemwatch.models.stickslip import kernel
from stemwatch.models.stickslip.problem import FitProblem, make_problem
from stemwatch.models.studies.literature.model import ValveModel
from stemwatch.models.studies.literature.scores import FitScore, score
from stemwatch.models.studies.literature.search import (
    QUICK,
    SLOW,
    Cube,
    SearchEffort,
    loss_over,
    search,
)

REPLICATES = 300  # of the block bootstrap
WIDTHS = (0.002, 0.008, 0.03)  # of the cloud about the optimum, shares of a parameter's range
LEAST_SAMPLES = 100  # scored samples of the training part
AT_BOUND = 0.002  # share of a parameter's range within which it counts as being at its end


@dataclass(frozen=True, kw_only=True)
class ModelFit:
    """A model fitted to the samples before ``train_until``, or the reason why it could not be.

    ``parameters`` by name, with 95 % intervals where a simulation is cheap. ``values`` (k,) are the
    same numbers in the model's order, ``zero`` the reading of the position where the stem is at 0,
    percent. ``simulated`` (n,) is the free run over the whole record, started from the measurement
    at its beginning, after each hole and at ``train_until``; NaN where nothing could be run.
    ``outcome`` is empty, or a sentence: why there is no fit, or why the fit is doubtful.
    """

    model: str
    parameters: Mapping[str, Estimate]
    values: Floats | None = None
    zero: float = 0.0
    simulated: Floats | None = None
    training: FitScore | None = None
    heldout: FitScore | None = None
    seconds: float = 0.0
    outcome: str = ""

    @property
    def concluded(self) -> bool:
        """Whether the fit has parameters."""
        return self.values is not None


@dataclass(frozen=True)
class FitStretches:
    """A recording cut into stretches that a free run crosses without a hole."""

    problem: FitProblem
    stretches: tuple[tuple[int, int], ...]
    short: tuple[tuple[int, int], ...]  # the same, cut at each block of time as well
    counted: Bools  # (n,) samples that are scored
    train_until: int

    def simulate(
        self,
        model: ValveModel,
        parameters: Floats,
        zero: float,
        until: int,
        *,
        short: bool = False,
    ) -> Floats:
        """(n,) MV in percent by free runs, one a stretch; NaN outside and from ``until`` on.

        ``short`` runs start afresh from the measurement at each block of time.
        """
        out = np.full(self.problem.op.size, np.nan)
        for first, last in self.short if short else self.stretches:
            if first >= until:
                break
            op, y0 = self.problem.op[first:last], self.problem.mv[first] - zero
            out[first:last] = model.simulate(op, parameters, self.problem.interval_s, y0) + zero
        return out


def cut(problem: FitProblem, train_until: int) -> FitStretches:
    """Stretches from each start to the next; past ``train_until`` the run starts afresh."""
    starts = np.flatnonzero(problem.start == kernel.START)
    before = starts[:1] if starts.size else np.array([], dtype=np.intp)
    splits_record = train_until < problem.op.size and before.size and train_until > before[0]
    ends = np.unique([*starts, *([train_until] if splits_record else []), problem.op.size])
    pairs = tuple((int(a), int(b)) for a, b in pairwise(ends))
    blocks = np.arange(problem.n_blocks) * problem.op.size // problem.n_blocks
    first = int(ends[0])
    edges = np.unique([*ends, *blocks[blocks > first]])
    short = tuple((int(a), int(b)) for a, b in pairwise(edges))
    is_scored = problem.scored.copy()
    # As after any start, the stem's state is not known until it has slipped.
    is_scored[train_until : train_until + _warm_up(problem)] = False
    return FitStretches(
        problem=problem, stretches=pairs, short=short, counted=is_scored, train_until=train_until
    )


def _warm_up(problem: FitProblem) -> int:
    first = int(np.argmax(problem.start == kernel.START))
    return int(np.argmax(problem.scored[first:]))


def fit_model(model: ValveModel, recording: Recording, train_until: int) -> ModelFit:
    """Fit ``model`` to the samples before ``train_until``; the rest is held out.

    The mean square error of the free run is minimised over the model's parameters and the zero of
    the position reading, without derivatives: a slip that moves from one sample to the next makes a
    step in it. The search begins on runs of one block of time (about 90 s), because every slip
    depends on the one before, so that the error of a long run gives no direction until the
    parameters are nearly right. Seeded, so that the same recording gives the same numbers. A
    recording that cannot be fitted is a result with an outcome. Raises ``ValueError`` where
    ``train_until`` is not within the recording.
    """
    started = time.perf_counter()
    if not 0 < train_until <= len(recording):
        raise ValueError(
            f"{recording.valve}: train_until from 1 to {len(recording)} expected, received "
            f"{train_until}"
        )
    problem = _problem(recording, train_until)
    if isinstance(problem, str):
        unknown = {p.name: Estimate.unknown(problem, unit=p.unit) for p in model.parameters}
        return ModelFit(model=model.name, parameters=unknown, outcome=problem)
    return _fitted(model, problem, train_until, SLOW if model.slow else QUICK, started)


def _problem(recording: Recording, train_until: int) -> FitProblem | str:
    """The problem, or a sentence on why there is none."""
    if recording.mv is None:
        return "the recording has no valve position (MV) to fit to"
    if recording.mv.unit != recording.op.unit:
        return (
            f"the position is in {recording.mv.unit!r} and the command in {recording.op.unit!r}; "
            "these models need both in percent: give the range of the position"
        )
    problem = make_problem(recording)
    scored_count = int(problem.scored[:train_until].sum())
    if scored_count < LEAST_SAMPLES:
        return (
            f"only {scored_count} usable samples before train_until, {LEAST_SAMPLES} are "
            "needed; take a longer window"
        )
    if np.ptp(problem.op[:train_until]) == 0.0:
        return "the command does not move before train_until, so nothing can be fitted"
    if np.ptp(problem.mv[:train_until][problem.scored[:train_until]]) == 0.0:
        return "the position does not move before train_until, so nothing can be fitted"
    return problem


def _fitted(
    model: ValveModel, problem: FitProblem, train_until: int, effort: SearchEffort, started: float
) -> ModelFit:
    runs = cut(problem, train_until)
    trained = runs.counted & (np.arange(problem.op.size) < train_until)
    measured = problem.mv[trained]

    def squares(parameters: Floats, zero: float, *, short: bool = False) -> Floats:
        run = runs.simulate(model, parameters, zero, train_until, short=short)
        return np.asarray((run[trained] - measured) ** 2)

    low, high = np.percentile((problem.mv - problem.op)[trained], (2.0, 98.0))
    cube = Cube(model=model, swing=problem.swing, zero=0.5 * float(low + high))
    coarse = loss_over(cube, lambda q, zero: float(np.mean(squares(q, zero, short=True))))
    free_run = loss_over(cube, lambda q, zero: float(np.mean(squares(q, zero))))
    best = search(cube, coarse, free_run, effort).candidate
    values, zero = cube.values(best)
    simulated = runs.simulate(model, values, zero, problem.op.size)
    resolution = _resolution(problem)
    late = runs.counted & ~(np.arange(problem.op.size) < train_until)
    training = score(simulated, problem.mv, trained, resolution)
    limits = intervals(
        cube, best, squares, problem.block[trained], effort.cloud, _command_step(problem.op)
    )
    return ModelFit(
        model=model.name,
        parameters={
            p.name: Estimate(value=float(value), low=low, high=high, unit=p.unit)
            for p, value, (low, high) in zip(model.parameters, values, limits, strict=True)
        },
        values=values,
        zero=zero,
        simulated=simulated,
        training=training,
        heldout=score(simulated, problem.mv, late, resolution),
        seconds=time.perf_counter() - started,
        outcome=_doubts(cube, best, training),
    )


def score_run(
    recording: Recording, simulated: Floats, train_until: int
) -> tuple[FitScore | None, FitScore | None]:
    """(training, held-out) scores of any free run (n,) in percent, as ``fit_model`` gives them.

    For predictors that are no ``ValveModel``, such as networks. ``None`` with too few samples.
    """
    problem = _problem(recording, train_until)
    if isinstance(problem, str):
        return None, None
    is_scored, early = cut(problem, train_until).counted, np.arange(simulated.size) < train_until
    resolution = _resolution(problem)
    return (
        score(simulated, problem.mv, is_scored & early, resolution),
        score(simulated, problem.mv, is_scored & ~early, resolution),
    )


def _resolution(problem: FitProblem) -> float:
    """The largest step of MV that noise alone makes, percent: three standard deviations."""
    return 3.0 * float(np.sqrt(2.0)) * problem.sigma


def _command_step(op: Floats) -> float:
    """Median step of OP between samples where it moves, percent."""
    steps = np.abs(np.diff(op))
    moving = steps[steps > 0.0]
    return float(np.median(moving)) if moving.size else 0.0


def _doubts(cube: Cube, best: Floats, training: FitScore | None) -> str:
    """Reasons to doubt a fit, as sentences; empty where there are none."""
    doubts = []
    if training is not None and training.fit_percent <= 0.0:
        doubts.append(
            "Even on the samples it was fitted to, the free run is no better than a constant."
        )
    for end in ("upper", "lower"):
        names = _at_end(cube, best, end)
        if names:
            doubts.append(
                f"{', '.join(names)} ended at the {end} end of the search; the truth may lie "
                "beyond, or the record does not tell."
            )
    return " ".join(doubts)


def _at_end(cube: Cube, best: Floats, end: str) -> list[str]:
    """Parameters at an end of their range, except natural ends such as no friction at all."""
    names = []
    for parameter, share in zip(cube.model.parameters, best[:-1].tolist(), strict=True):
        natural = parameter.per_percent is not None or parameter.lower == 0.0
        if end == "upper" and share > 1.0 - AT_BOUND:
            names.append(parameter.name)
        if end == "lower" and share < AT_BOUND and not natural:
            names.append(parameter.name)
    return names


IntervalEnds = tuple[float | None, float | None]
Squares = Callable[[Floats, float], Floats]


def intervals(
    cube: Cube,
    best: Floats,
    squares: Squares,
    block: NDArray[np.int64],
    cloud: int,
    step: float,
) -> list[IntervalEnds]:
    """A 95 % interval of each parameter (k,), or (None, None) where ``cloud`` is 0.

    ``squares`` gives the squared residuals (m,) of parameters and zero, ``block`` (m,) the block of
    time of each, ``step`` the usual step of OP in percent. The interval is that of this record and
    this model: it does not cover the choice of the model.
    """
    size = len(cube.model.parameters)
    if not cloud:
        return [(None, None)] * size
    rng = np.random.default_rng(7)
    points = [best]
    for width in WIDTHS:
        population = best + width * rng.standard_normal((cloud // len(WIDTHS), size + 1))
        points += list(cube.bounds.clip(population))
    values, sums = _sums(cube, points, squares, block)
    counts = np.bincount(np.unique(block, return_inverse=True)[1])
    chosen = cheapest(values, sums, block_weights(counts, REPLICATES, rng), rng)
    chosen += _sampling(cube, step / np.sqrt(1.0 + counts.size), chosen.shape, rng)
    low, high = np.percentile(np.vstack((chosen, values[:1])), COVERAGE, axis=0)
    low = np.maximum(np.minimum(low, values[0]), [p.lower for p in cube.model.parameters])
    high = np.minimum(np.maximum(high, values[0]), [p.upper for p in cube.model.parameters])
    return [(float(a), float(b)) for a, b in zip(low, high, strict=True)]


def _sampling(cube: Cube, step: float, shape: tuple[int, ...], rng: np.random.Generator) -> Floats:
    """The error by sampling, which no reweighting shows: a slip is seen a ``step`` of OP late."""
    per_percent = np.array([p.per_percent or 0.0 for p in cube.model.parameters])
    return np.asarray(step * per_percent * rng.uniform(-1.0, 1.0, shape))


def _sums(
    cube: Cube,
    points: list[Floats],
    squares: Squares,
    block: NDArray[np.int64],
) -> tuple[Floats, Floats]:
    """Parameters (m, k) of the points that the model takes, and their sums by block (m, b)."""
    numbers = np.unique(block, return_inverse=True)[1]
    values, sums = [], []
    for point in points:
        parameters, zero = cube.values(point)
        if cube.model.objection(parameters) is None:
            values.append(parameters)
            sums.append(np.bincount(numbers, weights=squares(parameters, zero)))
    return np.array(values), np.array(sums)
