"""Training a batch of networks stage by stage, each stopped by its own error on watched samples.

Networks start from random weights or from a fitted stick-slip element; each stage trains on free
runs of one length.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain

import numpy as np
import torch
from torch import Tensor

from stemwatch.models.narx.architecture import EDGE, ELEMENT_UNITS, INPUTS, StickSlipStart
from stemwatch.models.narx.example import NarxSettings, StageLog
from stemwatch.models.narx.kernel import free_run
from stemwatch.models.narx.levenberg_marquardt import descend
from stemwatch.models.narx.normal_equations import normal_matrices
from stemwatch.models.narx.run_plan import CODES, Plan, PlanStep, plan_run
from stemwatch.models.narx.training_record import TrainingRecord
from stemwatch.models.recording import Bools, Floats

_UP, _DOWN, _GOES_ON_UP, _GOES_ON_DOWN, _DIRECTION = range(ELEMENT_UNITS)
# Widths of the gate's edge, as shares of fs: with a wider edge more samples determine its place; a
# narrower one leaks less. The seeds take them in turn.
_WIDTHS = (0.01, 0.05)
_LEAST_LEVEL = 0.02  # of se: an element with less friction has no edge to start from
_GATE = 30.0  # a closed gate leaks exp(-30) per sample
_CONSENSUS = 12.0  # slope of the units that see command and stem go the same way
_LEAST_WATCHED = 30
# A gate set from S and J has steep edges, that is large weights, which the usual decay would
# shrink.
_FITTED_DECAY = 1e-4

_Trained = tuple[Floats, list[tuple[StageLog, ...]]]


def random_starts(settings: NarxSettings, members: int) -> Floats:
    """(members, P): a half-open gate and hardly any movement.

    Hidden weights normal / sqrt(inputs) times 1.5, their biases normal, gate normal / sqrt(hidden),
    value small. Each seed has its own generator, so that more seeds leave the first ones as they
    are.
    """
    hidden = settings.hidden
    starts = []
    for member in range(members):
        draw = np.random.default_rng([settings.seed, member]).standard_normal
        rows = draw((hidden, INPUTS + 1))
        rows[:, :INPUTS] *= 1.5 / np.sqrt(INPUTS)
        gate = draw(hidden + 1) / np.sqrt(hidden)
        value = 0.1 * draw(hidden + INPUTS + 1)
        starts.append(np.concatenate([value, gate, rows.ravel()]))
    return np.stack(starts)


def fitted_starts(
    start: StickSlipStart, unit_percent: float, settings: NarxSettings, members: int
) -> Floats:
    """(members, P) the stick-slip element of ``start``; members differ in the width of the gate's
    edge.

    ``unit_percent`` is the network's unit ``se`` in percent of OP.
    """
    fs = max(0.5 * (start.S + start.J) / unit_percent, _LEAST_LEVEL)
    fd = 0.5 * (start.S - start.J) / unit_percent
    widths = [fs * _WIDTHS[member % len(_WIDTHS)] for member in range(members)]
    return np.stack([_element(fs, fd, w, start.goes_on, settings.hidden) for w in widths])


def _element(fs: float, fd: float, width: float, goes_on: bool, hidden: int) -> Floats:
    """(P,) weights of the element, levels in units of ``se``.

    One unit opens the gate where ``e > fs``, one where ``e < -fs``, two where command and stem
    both go on in one direction; the fifth is the direction d, and the value is ``e - d fd``.
    Between two directions ``e`` decides: a stem that goes on upwards has ``e >= fd > -fs``, also
    where fd is negative (overshoot); one with a smaller ``e`` rests, and its reading is noisy.
    """
    rows = np.zeros((hidden, INPUTS + 1))
    rows[_UP, [0, -1]] = 1.0 / width, -fs / width
    rows[_DOWN, [0, -1]] = -1.0 / width, -fs / width
    slope = _CONSENSUS if goes_on else 0.0
    by_error = 0.125 * slope / max(fs - fd, 0.1 * fs)
    rows[_GOES_ON_UP, [0, 3, -1]] = by_error, slope, -0.75 * _CONSENSUS - by_error * fd
    rows[_GOES_ON_DOWN, [0, 3, -1]] = (
        -by_error,
        -slope,
        -0.75 * _CONSENSUS - by_error * fd,
    )
    rows[_DIRECTION, [0, 3]] = 6.0 / fs, 6.0
    gate = np.zeros(hidden + 1)
    gate[: _GOES_ON_DOWN + 1], gate[-1] = _GATE, 3.0 * _GATE
    value = np.zeros(hidden + INPUTS + 1)
    value[_DIRECTION], value[hidden] = -fd, 1.0
    return np.concatenate([value, gate, rows.ravel()])


def train_members(
    valves: Sequence[TrainingRecord], settings: NarxSettings, device: str
) -> _Trained:
    """Weights (valves, seeds, P) after the last stage, and each valve's log.

    Either every valve has a start or none has. Members that start from a fitted element are trained
    on the longest horizon only, because one-step errors would fit the measurement noise.
    """
    fitted = settings.fitted if valves[0].example.start is not None else 0
    stages = list(zip(settings.horizons, settings.steps, strict=True))
    members: list[_Trained] = []
    if fitted < settings.seeds:
        random = random_starts(settings, settings.seeds - fitted)
        starts = np.repeat(random[None], len(valves), axis=0)
        members.append(_train_stages(valves, starts, stages, settings, device))
    if fitted:
        starts = np.stack([_fitted(valve, settings, fitted) for valve in valves])
        weak_decay = replace(settings, decay=settings.decay * _FITTED_DECAY)
        members.append(_train_stages(valves, starts, stages[-1:], weak_decay, device))
    weights, logs = zip(*members, strict=True)
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
        normal, samples = normal_matrices(valves, settings.hidden, horizon, members, device)
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

    def _errors(self, weights: Tensor, improved: Bools) -> Floats:
        """(B,) errors on the watched samples where ``improved``; inf for the other networks."""
        members = _by_valve(weights, len(self._valves))
        improved_members = improved.reshape(members.shape[:2])
        errors = np.full(improved_members.shape, np.inf)
        for number, valve in enumerate(self._valves):
            chosen = improved_members[number]
            if chosen.any():
                flat, plan = members[number, chosen], self._plans[number]
                errors[number, chosen] = member_errors(valve, flat, plan, self._settings.hidden)
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
    accepted = steps.cpu().numpy().reshape(len(valves), -1)
    watched = watch.error.reshape(len(valves), -1)
    weights = _by_valve(watch.best, len(valves))
    for number, valve in enumerate(valves):
        se = valve.scaling["error_scale"]
        plan = plan_run(valve.trained, horizon)
        trained = member_errors(valve, weights[number], plan, settings.hidden)
        has_watched = bool(watch.watched[number * len(weights[number])])
        logs.append(
            StageLog(
                horizon=horizon,
                trained_rmse=tuple(float(se * error) for error in trained),
                watched_rmse=tuple(float(se * e) for e in watched[number]) if has_watched else None,
                steps=tuple(int(step) for step in accepted[number]),
            )
        )
    return logs
