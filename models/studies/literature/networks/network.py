"""``Network``, the protocol of networks in a comparison, and how one is fitted and scored."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.recording import Bools, Floats, Recording
from stemwatch.models.stickslip.problem import FitProblem, make_problem
from stemwatch.models.studies.literature.canonical import CANONICAL
from stemwatch.models.studies.literature.fit import ModelFit, cut, fit_model, score_run
from stemwatch.models.studies.literature.model import DescribedModel
from stemwatch.models.studies.literature.scores import FitScore


@dataclass(frozen=True, kw_only=True)
class TrainingInput:
    """A recording prepared for training: the samples to learn from and the stretches to run over.

    ``stretches`` are (first, last) of runs without a hole, cut at ``train_until``. ``learned`` (n,)
    are the samples of the training part that may be fitted. ``element`` is the canonical stick-slip
    element fitted to the same samples.
    """

    recording: Recording
    train_until: int
    problem: FitProblem
    stretches: tuple[tuple[int, int], ...]
    learned: Bools
    element: ModelFit


@dataclass(frozen=True, kw_only=True)
class TrainedNetwork:
    """``weights`` (P,) of all networks together and their free run ``simulated`` (n,), percent;
    both ``None`` where nothing was learned. ``outcome``: why not, or a remark on the result."""

    weights: Floats | None = None
    simulated: Floats | None = None
    outcome: str = ""


class Network(DescribedModel, Protocol):
    """A network from command to stem position, both in percent.

    ``learn`` must use no position outside ``lesson.learned`` except those that a free run starts
    from, must give the same numbers for the same recording, and must refuse with a sentence.
    """

    def learn(self, lesson: TrainingInput) -> TrainedNetwork:
        """The weights fitted to the samples of ``lesson.learned`` and a free run, or why there are
        none.
        """
        ...


def fit_network(
    network: Network, recording: Recording, train_until: int, element: ModelFit | None = None
) -> ModelFit:
    """Train ``network`` on the samples before ``train_until``; scores as those of ``fit_model``.

    ``element`` is the canonical element as ``fit_model`` fitted it to the same samples; without one
    it is fitted here. A recording to which it cannot be fitted gets no network. The only parameter
    is the number of weights; the weights are ``values``. Raises ``ValueError``
    where ``train_until`` is not within the recording.
    """
    started = time.perf_counter()
    element = element or fit_model(CANONICAL, recording, train_until)
    if not element.concluded:
        return _refused(network, element.outcome, started)
    problem = make_problem(recording)
    runs = cut(problem, train_until)
    learned = network.learn(
        TrainingInput(
            recording=recording,
            train_until=train_until,
            problem=problem,
            stretches=runs.stretches,
            learned=runs.counted & (np.arange(len(recording)) < train_until),
            element=element,
        )
    )
    if learned.weights is None or learned.simulated is None:
        return _refused(network, learned.outcome, started)
    training, heldout = score_run(recording, learned.simulated, train_until)
    return ModelFit(
        model=network.name,
        parameters={"weights": Estimate(value=float(learned.weights.size))},
        values=learned.weights,
        simulated=learned.simulated,
        training=training,
        heldout=heldout,
        seconds=time.perf_counter() - started,
        outcome=_outcome(learned, training),
    )


def _refused(network: Network, reason: str, started: float) -> ModelFit:
    unknown = {"weights": Estimate.unknown(reason)}
    seconds = time.perf_counter() - started
    return ModelFit(model=network.name, parameters=unknown, seconds=seconds, outcome=reason)


def _outcome(learned: TrainedNetwork, training: FitScore | None) -> str:
    if training is None or training.fit_percent > 0.0:
        return learned.outcome
    poor = "Even on the samples it was trained on, the free run is no better than a constant."
    return f"{learned.outcome} {poor}".strip()
