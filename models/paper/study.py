"""One case through every network: the paper's on its sine, ours, and all of them on new inputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stemwatch.models.narx.levenberg import one_thread
from stemwatch.models.paper import ours, published
from stemwatch.models.paper.cases import SAMPLES_PER_PERIOD, Case, Published
from stemwatch.models.paper.fitting import run_errors
from stemwatch.models.paper.scores import cdc_percent, rmse
from stemwatch.models.paper.signals import FAMILIES, paper_sine, training_input, unseen
from stemwatch.models.paper.step import Step, simulate
from stemwatch.models.recording import Floats

DEFAULT_SEEDS = 5
UNSEEN_EACH = 30
CLOSE = 0.03  # RMSE up to which a run on a new input counts as close
OURS = "ours, fitted start"
SINE, RICH = "the sine", "the training record"


@dataclass(frozen=True, kw_only=True)
class Unseen:
    """One family of new inputs: RMSE of the chosen seed's free runs, and of all seeds' medians."""

    family: str
    inputs: int
    median: float
    eightieth: float  # four in five are at or below
    largest: float
    close_share: float  # at or below ``CLOSE``
    seed_medians: tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class Result:
    """One kind of network in one case. ``rmse`` and ``cdc_percent`` are of the free run over the
    paper's sine, by seed; ``chosen`` is the seed with the best free run on what it was trained on.
    """

    network: str
    trained_on: str
    rmse: tuple[float, ...]
    cdc_percent: tuple[float, ...]
    chosen: int
    published: Published | None
    unseen: tuple[Unseen, ...]


@dataclass(frozen=True, kw_only=True)
class CaseResult:
    """``moving_percent``: the share of the sine's samples at which the stem moves, the highest CDC
    that there is. ``fitted`` and ``fitted_sine`` are S and J as fitted to the two records."""

    case: Case
    moving_percent: float
    fitted: tuple[float, float]
    fitted_sine: tuple[float, float]
    results: tuple[Result, ...]


@dataclass(frozen=True, kw_only=True)
class Task:
    """What a worker needs to study one case."""

    case: Case
    seeds: int = DEFAULT_SEEDS
    unseen_each: int = UNSEEN_EACH


@dataclass(frozen=True)
class _Record:
    name: str
    u: Floats
    y: Floats


@dataclass(frozen=True)
class _Network:
    name: str
    record: _Record
    step: Step
    weights: Floats
    published: Published | None = None
    trained: bool = True


def study(task: Task) -> CaseResult:
    """Train and judge every network on one case; the same task gives the same result."""
    with one_thread():
        return _study(task)


def _study(task: Task) -> CaseResult:
    case = task.case
    u = paper_sine()
    sine = _Record(SINE, u[SAMPLES_PER_PERIOD:], case.respond(u)[SAMPLES_PER_PERIOD:])
    u = training_input()
    rich = _Record(RICH, u, case.respond(u))
    fitted, fitted_sine = ours.fit_S_J(rich.u, rich.y), ours.fit_S_J(sine.u, sine.y)
    networks = [
        *_published(case, sine, task.seeds),
        *_ours(rich, sine, fitted, fitted_sine, task.seeds),
    ]
    families = {family: unseen(family, task.unseen_each) for family in FAMILIES}
    return CaseResult(
        case=case,
        moving_percent=float(100.0 * np.mean(np.diff(sine.y) != 0.0)),
        fitted=fitted,
        fitted_sine=fitted_sine,
        results=tuple(_judge(network, case, sine, families) for network in networks),
    )


def _published(case: Case, sine: _Record, seeds: int) -> list[_Network]:
    step, weights = published.train_feedforward(case.shape, sine.u, sine.y, seeds)
    narx, narx_weights = published.train_narx(case.shape, sine.u, sine.y, seeds)
    return [
        _Network("paper, feedforward", sine, step, weights, case.feedforward),
        _Network("paper, NARX", sine, narx, narx_weights, case.narx),
    ]


def _ours(
    rich: _Record,
    sine: _Record,
    fitted: tuple[float, float],
    fitted_sine: tuple[float, float],
    seeds: int,
) -> list[_Network]:
    grey = ours.train_from_fitted(rich.u, rich.y, fitted, seeds)
    narrow = ours.train_from_fitted(sine.u, sine.y, fitted_sine, seeds)
    blind = ours.train_from_random(rich.u, rich.y, seeds)
    return [
        _Network(OURS, rich, grey.step, grey.weights),
        _Network(f"{OURS}, untrained", rich, grey.step, grey.starts[:1], trained=False),
        _Network(f"{OURS}, sine only", sine, narrow.step, narrow.weights),
        _Network("ours, random start", rich, blind.step, blind.weights),
    ]


def _judge(
    network: _Network, case: Case, sine: _Record, families: dict[str, list[Floats]]
) -> Result:
    record = network.record
    chosen = int(np.argmin(run_errors(network.step, network.weights, record.u, record.y)))
    runs = simulate(network.step, network.weights, [sine.u], [sine.y])[:, 0]
    return Result(
        network=network.name,
        trained_on=record.name if network.trained else "nothing but S and J",
        rmse=_floats(rmse(runs, sine.y)),
        cdc_percent=_floats(cdc_percent(runs, sine.y)),
        chosen=chosen,
        published=network.published,
        unseen=tuple(
            _unseen(network, family, inputs, case, chosen) for family, inputs in families.items()
        ),
    )


def _unseen(
    network: _Network, family: str, inputs: Sequence[Floats], case: Case, chosen: int
) -> Unseen:
    truths = [case.respond(u) for u in inputs]
    errors = rmse(simulate(network.step, network.weights, inputs, truths), np.stack(truths))
    own = errors[chosen]
    return Unseen(
        family=family,
        inputs=len(inputs),
        median=float(np.median(own)),
        eightieth=float(np.quantile(own, 0.8)),
        largest=float(own.max()),
        close_share=float(np.mean(own <= CLOSE)),
        seed_medians=_floats(np.median(errors, axis=1)),
    )


def _floats(values: Floats) -> tuple[float, ...]:
    return tuple(float(value) for value in values)
