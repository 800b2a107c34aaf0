"""The stages of training a batch: one horizon after another, every network watched on its own."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
import torch
from torch import Tensor

from stemwatch.models.narx.batch import blocks, bounds
from stemwatch.models.narx.example import NarxSettings, StageLog
from stemwatch.models.narx.kernel import free_run
from stemwatch.models.narx.levenberg import descend
from stemwatch.models.narx.network import INPUTS
from stemwatch.models.narx.plan import CODES, Step, plan_run
from stemwatch.models.narx.prepared import Prepared
from stemwatch.models.narx.sensitivities import Block, Bounds, Weights, normal_matrix
from stemwatch.models.recording import Bools, Floats

_LEAST_WATCHED = 30


def start_weights(settings: NarxSettings) -> Floats:
    """(seeds, P) random starts: a half-open gate and hardly any movement.

    Hidden weights normal / sqrt(inputs) times 1.5, their biases normal, gate normal / sqrt(hidden),
    value small. Each seed has its own generator, so that more seeds leave the first ones as they
    are.
    """
    hidden = settings.hidden
    starts = []
    for member in range(settings.seeds):
        draw = np.random.default_rng([settings.seed, member]).standard_normal
        rows = draw((hidden, INPUTS + 1))
        rows[:, :INPUTS] *= 1.5 / np.sqrt(INPUTS)
        gate = draw(hidden + 1) / np.sqrt(hidden)
        value = 0.1 * draw(hidden + INPUTS + 1)
        starts.append(np.concatenate([value, gate, rows.ravel()]))
    return np.stack(starts)


def train_stages(
    valves: Sequence[Prepared], settings: NarxSettings, device: str
) -> tuple[Floats, list[tuple[StageLog, ...]]]:
    """Weights (valves, seeds, P) after the last stage, and each valve's log."""
    weights = torch.from_numpy(start_weights(settings)).to(device).repeat(len(valves), 1)
    limits = bounds(valves, settings.seeds, device)
    logs = []
    for horizon, steps in zip(settings.horizons, settings.steps, strict=True):
        pieces, samples = blocks(valves, horizon, settings.seeds, device)
        watch = _Watch(valves, settings, horizon)
        watch(weights, torch.ones_like(samples, dtype=torch.bool))
        descent = descend(
            weights,
            partial(_normal, pieces, limits, settings.hidden),
            samples,
            steps=steps,
            damping=settings.damping,
            decay=settings.decay,
            watch=watch,
        )
        weights = watch.best
        logs.append(_stage_logs(valves, watch, horizon, descent.steps, settings))
    return _by_valve(weights, len(valves)), list(zip(*logs, strict=True))


def _normal(pieces: list[Block], limits: Bounds, hidden: int, flat: Tensor) -> Tensor:
    return normal_matrix(pieces, Weights.split(flat, hidden), limits)


class _Watch:
    """Keeps each network where its free run on the watched samples was best.

    A network whose valve has too few watched samples is kept where its loss was lowest.
    """

    def __init__(self, valves: Sequence[Prepared], settings: NarxSettings, horizon: int) -> None:
        self._valves, self._settings, self._horizon = valves, settings, horizon
        self.best = torch.empty(0)
        self.error = np.full(len(valves) * settings.seeds, np.inf)
        self._waited = np.zeros(self.error.size, dtype=np.int64)
        watched = [int(np.sum(valve.watched)) >= _LEAST_WATCHED for valve in valves]
        self.watched = np.repeat(watched, settings.seeds)

    def __call__(self, weights: Tensor, improved: Tensor) -> Tensor:
        fell = improved.cpu().numpy()
        error = self._errors(weights)
        better = fell & np.where(self.watched, error < self.error, True)
        self.error = np.where(better, error, self.error)
        self._waited = np.where(better | ~fell, self._waited, self._waited + 1)
        chosen = torch.from_numpy(better).to(weights.device)
        self.best = torch.where(chosen[:, None], weights, self.best) if len(self.best) else weights
        going = (self._waited < self._settings.patience) | ~self.watched
        return torch.from_numpy(going).to(weights.device)

    def _errors(self, weights: Tensor) -> Floats:
        members = _by_valve(weights, len(self._valves))
        errors = [
            member_errors(valve, flat, valve.watched, self._horizon, self._settings.hidden)
            for valve, flat in zip(self._valves, members, strict=True)
        ]
        return np.concatenate(errors)


def member_errors(
    valve: Prepared, weights: Floats, part: Bools, horizon: int, hidden: int
) -> Floats:
    """(m,) root mean square error of each member's free run in ``part``, scaled; inf where the
    run left the finite or there was nothing to run on."""
    plan = plan_run(part, horizon)
    out = np.full((weights.shape[0], part.size), np.nan)
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
        out,
    )
    scored = plan >= Step.RUN
    if not scored.any():
        return np.full(weights.shape[0], np.inf)
    errors = np.sqrt(np.mean((out[:, scored] - signals.position[scored]) ** 2, axis=1))
    return np.where(np.isfinite(errors), errors, np.inf)


def _by_valve(weights: Tensor, valves: int) -> Floats:
    flat = weights.cpu().numpy()
    return np.ascontiguousarray(flat.reshape(valves, -1, flat.shape[1]))


def _stage_logs(
    valves: Sequence[Prepared], watch: _Watch, horizon: int, steps: Tensor, settings: NarxSettings
) -> list[StageLog]:
    logs = []
    taken = steps.cpu().numpy().reshape(len(valves), -1)
    watched = watch.error.reshape(len(valves), -1)
    weights = _by_valve(watch.best, len(valves))
    for at, valve in enumerate(valves):
        se = valve.scaling["error_scale"]
        trained = member_errors(valve, weights[at], valve.trained, horizon, settings.hidden)
        seen = bool(watch.watched[at * settings.seeds])
        logs.append(
            StageLog(
                horizon=horizon,
                trained_rmse=tuple(float(se * error) for error in trained),
                watched_rmse=tuple(float(se * e) for e in watched[at]) if seen else None,
                steps=tuple(int(step) for step in taken[at]),
            )
        )
    return logs
