"""``train``: one NARX ensemble for each of many valves, all at once."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import torch

from stemwatch.models.narx.architecture import INPUTS, NO_ACTUATOR
from stemwatch.models.narx.ensemble_run import run_plan
from stemwatch.models.narx.example import (
    HeldOutErrors,
    NarxExample,
    NarxFit,
    NarxSettings,
    StageLog,
)
from stemwatch.models.narx.levenberg_marquardt import one_thread
from stemwatch.models.narx.network import NarxNetwork
from stemwatch.models.narx.run_plan import PlanStep, plan_run
from stemwatch.models.narx.stages import member_errors, train_members
from stemwatch.models.narx.training_record import TrainingRecord, prepare
from stemwatch.models.recording import Bools, Floats

DEFAULTS = NarxSettings()
AUTO = "auto"
# Valves in a batch. Beside one core of its own machine an H100 was slower below 8, even at 8, and
# quicker from 16 on (docs/networks.md).
LEAST_ON_GPU = 16
# The error of random members grows from the training part to the held-out part by about this factor
# more than that of members started from a fitted element (128 simulated records).
_RANDOM_START_FACTOR = 1.3
# A member whose error is more than so many times the best one's is left out of the mean.
_MOST_ERROR_RATIO = 1.3
_Ready = tuple[int, TrainingRecord]


def train(batch: Sequence[NarxExample], settings: NarxSettings = DEFAULTS) -> list[NarxFit]:
    """A fit for each example, in their order; a record that cannot be trained on gives a reason.

    First series-parallel (each sample predicted from the measured ones before it), then on free
    runs of growing length: one-step error alone says nothing about the free run. The least squares
    are Levenberg-Marquardt's, on sensitivities carried forward through the run, so that no graph
    is unrolled. Where an example has a ``start``, ``fitted_seeds`` of its members begin as that
    stick-slip element and are trained on the longest runs only: the ensemble is then grey-box.
    Float64 throughout. On a CPU the same settings give the same networks, whatever else is in the
    batch.
    """
    fits: dict[int, NarxFit] = {}
    ready: list[_Ready] = []
    for index, example in enumerate(batch):
        prepared = prepare(example, settings)
        if isinstance(prepared, str):
            fits[index] = NarxFit(valve=example.valve, reason=prepared)
        else:
            ready.append((index, prepared))
    for part in _parts(ready, settings.valves_per_batch):
        trained = _train_part([valve for _, valve in part], settings)
        fits |= {index: fit for (index, _), fit in zip(part, trained, strict=True)}
    return [fits[index] for index in range(len(batch))]


def _parts(ready: list[_Ready], largest: int) -> Iterator[list[_Ready]]:
    """Batches of at most ``largest`` records; valves with a start are not mixed with
    those without.
    """
    for started in (True, False):
        same_start = [item for item in ready if (item[1].example.start is not None) is started]
        for first in range(0, len(same_start), largest):
            yield same_start[first : first + largest]


def device_for(valves: int, asked_device: str = AUTO) -> str:
    """Where to train the networks of so many valves: ``asked_device``, or with "auto" a CUDA GPU
    where torch sees one and there are at least ``LEAST_ON_GPU`` valves, else the CPU.

    A GPU works on all networks of a batch at once and is idle most of the time with few of them. To
    keep a GPU out of it, hide it from the process (``CUDA_VISIBLE_DEVICES=``).
    """
    if asked_device != AUTO:
        return asked_device
    return "cuda" if valves >= LEAST_ON_GPU and torch.cuda.is_available() else "cpu"


def _train_part(valves: Sequence[TrainingRecord], settings: NarxSettings) -> list[NarxFit]:
    device = device_for(len(valves), settings.device)
    try:
        return _train_on(device, valves, settings)
    except (RuntimeError, AssertionError):  # torch raises these where a GPU is full or unusable
        if settings.device != AUTO or device == "cpu":
            raise
        return _train_on("cpu", valves, settings)


def _train_on(
    device: str, valves: Sequence[TrainingRecord], settings: NarxSettings
) -> list[NarxFit]:
    started = time.perf_counter()
    with one_thread(), torch.inference_mode():
        weights, logs = train_members(valves, settings, device)
    fits = [
        _fit_of_best_members(valve, members, log, settings)
        for valve, members, log in zip(valves, weights, logs, strict=True)
    ]
    seconds = (time.perf_counter() - started) / len(valves)
    return [replace(fit, seconds=seconds, device=device) for fit in fits]


def _fit_of_best_members(
    valve: TrainingRecord, weights: Floats, log: tuple[StageLog, ...], settings: NarxSettings
) -> NarxFit:
    """The ensemble of the best members, run over the whole record."""
    example = valve.example
    network = _network(valve, _best(valve, weights, settings), settings)
    plan = plan_run(valve.usable, cuts=(example.train_until,))
    simulated = run_plan(network, valve.op, valve.mv, plan)
    late = np.arange(plan.size) >= example.train_until
    runs_freely = (plan == PlanStep.RUN) & ~late
    rmse = _rmse(simulated, valve.mv, runs_freely)
    if not rmse < np.std(valve.mv[runs_freely]):
        reason = (
            "the training did not converge: even on the samples it was trained on, the free run is "
            f"no better than a constant (rmse {rmse:.3g}); MV may not follow this OP"
        )
        return NarxFit(valve=example.valve, reason=reason, log=log)
    return NarxFit(
        valve=example.valve,
        network=replace(network, reference_rmse=_reference_rmse(network, valve)),
        heldout=_held_out(network, valve, simulated, (plan == PlanStep.RUN) & late),
        simulated=simulated,
        log=log,
    )


def _held_out(
    network: NarxNetwork, valve: TrainingRecord, simulated: Floats, scored: Bools
) -> HeldOutErrors:
    rmse = _rmse(simulated, valve.mv, scored)
    one_step = network.one_step(valve.op, valve.mv, valve.usable)
    return HeldOutErrors(
        rmse=rmse,
        one_step_rmse=_rmse(one_step, valve.mv, scored),
        normalised=rmse / float(np.std(valve.mv[scored])),
        samples=int(scored.sum()),
    )


def _reference_rmse(network: NarxNetwork, valve: TrainingRecord) -> float:
    """The error by which later scores are divided, never 0. It includes the held-out part, because
    the error on the training part alone is too small for comparison.
    """
    horizon = network.reference_horizon
    run = network.free_run(valve.op, valve.mv, valve.usable, horizon=horizon)
    error = _rmse(run, valve.mv, plan_run(valve.usable) == PlanStep.RUN)
    return max(error, 1e-6 * float(np.std(valve.mv[valve.usable])))


def _best(valve: TrainingRecord, weights: Floats, settings: NarxSettings) -> Floats:
    """(m, P) the members with the lowest free-run error on the training part, not restarted."""
    plan = plan_run(valve.trained | valve.watched, valve.usable.size)
    errors = member_errors(valve, weights, plan, settings.hidden)
    if valve.example.start is not None:
        errors[: settings.seeds - settings.fitted] *= _RANDOM_START_FACTOR
    best = np.argsort(errors, kind="stable")[: settings.kept]
    close = best[~(errors[best] > _MOST_ERROR_RATIO * errors[best[0]])]
    return np.asarray(weights[close])


def _network(valve: TrainingRecord, weights: Floats, settings: NarxSettings) -> NarxNetwork:
    hidden, members = settings.hidden, weights.shape[0]
    gate = hidden + INPUTS + 1
    rows = gate + hidden + 1
    return NarxNetwork(
        weights={
            "value": weights[:, :gate],
            "gate": weights[:, gate:rows],
            "hidden": weights[:, rows:].reshape(members, hidden, INPUTS + 1),
        },
        scaling=valve.scaling,
        ranges=valve.ranges,
        interval_s=valve.example.interval_s,
        actuator=valve.example.start.actuator if valve.example.start else NO_ACTUATOR,
        reference_rmse=1.0,  # replaced as soon as the network can be run
        reference_horizon=settings.reference_horizon,
        seed=settings.seed,
    )


def _rmse(simulated: Floats, mv: Floats, scored: Bools) -> float:
    return float(np.sqrt(np.mean((simulated[scored] - mv[scored]) ** 2)))
