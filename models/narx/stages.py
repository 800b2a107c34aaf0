"""The stages of training a batch: one horizon after another, every network watched on its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain

import numpy as np
import torch
from torch import Tensor

from stemwatch.models.narx.architecture import EDGE
from stemwatch.models.narx.example import NarxSettings, StageLog
from stemwatch.models.narx.kernel import free_run
from stemwatch.models.narx.levenberg_marquardt import descend
from stemwatch.models.narx.normal_equations import normal_of
from stemwatch.models.narx.run_plan import CODES, Plan, PlanStep, plan_run
from stemwatch.models.narx.starts import fitted_starts, random_starts
from stemwatch.models.narx.training_record import TrainingRecord
from stemwatch.models.recording import Bools, Floats

_LEAST_WATCHED = 30
# The steep edges of a gate that is set from S and J are large weights, which the usual decay would
# flatten.
_FITTED_DECAY = 1e-4

_Trained = tuple[Floats, list[tuple[StageLog, ...]]]


def train_members(
    valves: Sequence[TrainingRecord], settings: NarxSettings, device: str
) -> _Trained:
    """Weights (valves, seeds, P) after the last stage, and each valve's log.

    Either every valve has a start or none has. What starts from a fitted element is trained on the
    longest horizon only: one-step error would teach it the measurement noise.
    """
    fitted = settings.fitted if valves[0].example.start is not None else 0
    stages = list(zip(settings.horizons, settings.steps, strict=True))
    found: list[_Trained] = []
    if fitted < settings.seeds:
        random = random_starts(settings, settings.seeds - fitted)
        starts = np.repeat(random[None], len(valves), axis=0)
        found.append(_train_stages(valves, starts, stages, settings, device))
    if fitted:
        starts = np.stack([_fitted(valve, settings, fitted) for valve in valves])
        gently = replace(settings, decay=settings.decay * _FITTED_DECAY)
        found.append(_train_stages(valves, starts, stages[-1:], gently, device))
    weights, logs = zip(*found, strict=True)
    joined = [tuple(chain.from_iterable(log)) for log in zip(*logs, strict=True)]
    return np.concatenate(weights, axis=1), joined


def _fitted(valve: TrainingRecord, settings: NarxSettings, members: int) -> Floats:
    start = valve.example.start
    assert start is not None
    unit_percent = valve.scaling["error_scale"] / abs(valve.scaling["gain"])
    return fitted_starts(start, unit_percent, settings, members)


def _train_stages(
    valves: Sequence[TrainingRecord],
    starts: Floats,
    stages: Sequence[tuple[int, int]],
    settings: NarxSettings,
    device: str,
) -> _Trained:
    """From ``starts`` (valves, members, P) through (horizon, most steps) one after another."""
    members = starts.shape[1]
    weights = torch.from_numpy(starts.reshape(-1, starts.shape[2])).to(device)
    logs = []
    for horizon, steps in stages:
        normal, samples = normal_of(valves, settings.hidden, horizon, members, device)
        watch = _Watch(valves, settings, horizon, members)
        watch(weights, torch.ones_like(samples, dtype=torch.bool))
        descent = descend(
            weights,
            normal,
            samples,
            steps=steps,
            damping=settings.damping,
            decay=settings.decay,
            watch=watch,
        )
        weights = watch.best
        logs.append(_stage_logs(valves, watch, horizon, descent.steps, settings))
    return _by_valve(weights, len(valves)), list(zip(*logs, strict=True))


class _Watch:
    """Keeps each network where its free run on the watched samples was best.

    A network whose valve has too few watched samples is kept where its loss was lowest.
    """

    def __init__(
        self, valves: Sequence[TrainingRecord], settings: NarxSettings, horizon: int, members: int
    ) -> None:
        self._valves, self._settings = valves, settings
        self._plans = [plan_run(valve.watched, horizon) for valve in valves]
        self.best = torch.empty(0)
        self.error = np.full(len(valves) * members, np.inf)
        self._waited = np.zeros(self.error.size, dtype=np.int64)
        watched = [int(np.sum(valve.watched)) >= _LEAST_WATCHED for valve in valves]
        self.watched = np.repeat(watched, members)

    def __call__(self, weights: Tensor, improved: Tensor) -> Tensor:
        fell = improved.cpu().numpy()
        error = self._errors(weights, fell)
        better = fell & np.where(self.watched, error < self.error, True)
        self.error = np.where(better, error, self.error)
        self._waited = np.where(better | ~fell, self._waited, self._waited + 1)
        chosen = torch.from_numpy(better).to(weights.device)
        self.best = torch.where(chosen[:, None], weights, self.best) if len(self.best) else weights
        going = (self._waited < self._settings.patience) | ~self.watched
        return torch.from_numpy(going).to(weights.device)

    def _errors(self, weights: Tensor, asked: Bools) -> Floats:
        """Of the networks ``asked`` for; inf for the others."""
        members = _by_valve(weights, len(self._valves))
        wanted = asked.reshape(members.shape[:2])
        errors = np.full(wanted.shape, np.inf)
        for at, valve in enumerate(self._valves):
            chosen = wanted[at]
            if chosen.any():
                flat, plan = members[at, chosen], self._plans[at]
                errors[at, chosen] = member_errors(valve, flat, plan, self._settings.hidden)
        return errors.ravel()


def member_errors(valve: TrainingRecord, weights: Floats, plan: Plan, hidden: int) -> Floats:
    """(m,) root mean square error of each member's free run by ``plan``, scaled; inf where the run
    left the finite or there was nothing to run on."""
    out = np.full((weights.shape[0], plan.size), np.nan)
    signals = valve.signals
    free_run(
        weights,
        hidden,
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
    scored = plan >= PlanStep.RUN
    if not scored.any():
        return np.full(weights.shape[0], np.inf)
    errors = np.sqrt(np.mean((out[:, scored] - signals.position[scored]) ** 2, axis=1))
    return np.where(np.isfinite(errors), errors, np.inf)


def _by_valve(weights: Tensor, valves: int) -> Floats:
    flat = weights.cpu().numpy()
    return np.ascontiguousarray(flat.reshape(valves, -1, flat.shape[1]))


def _stage_logs(
    valves: Sequence[TrainingRecord],
    watch: _Watch,
    horizon: int,
    steps: Tensor,
    settings: NarxSettings,
) -> list[StageLog]:
    logs = []
    taken = steps.cpu().numpy().reshape(len(valves), -1)
    watched = watch.error.reshape(len(valves), -1)
    weights = _by_valve(watch.best, len(valves))
    for at, valve in enumerate(valves):
        se = valve.scaling["error_scale"]
        plan = plan_run(valve.trained, horizon)
        trained = member_errors(valve, weights[at], plan, settings.hidden)
        seen = bool(watch.watched[at * len(weights[at])])
        logs.append(
            StageLog(
                horizon=horizon,
                trained_rmse=tuple(float(se * error) for error in trained),
                watched_rmse=tuple(float(se * e) for e in watched[at]) if seen else None,
                steps=tuple(int(step) for step in taken[at]),
            )
        )
    return logs
