"""A record prepared for training, or the reason why it cannot be trained on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stemwatch.models.narx.actuator import actuator_output
from stemwatch.models.narx.architecture import NO_ACTUATOR
from stemwatch.models.narx.example import NarxExample, NarxSettings
from stemwatch.models.narx.run_plan import PlanStep, plan_run
from stemwatch.models.narx.scaling import (
    ScaledSignals,
    believable,
    element_ranges,
    fit_ranges,
    fit_scaling,
    limits,
    scale,
)
from stemwatch.models.recording import Bools, Floats

# Five samples for each of 41 weights.
_LEAST_TRAINED = 200
_LEAST_JUDGED = 30
_SMALLEST_SPAN = 1e-12


@dataclass(frozen=True, kw_only=True)
class TrainingRecord:
    """A record ready for training; ``trained`` and ``watched`` (n,) are disjoint.

    ``op`` and ``mv`` (n,) are the example's, NaN where they are not ``usable``.
    """

    example: NarxExample
    op: Floats
    mv: Floats
    usable: Bools
    trained: Bools
    watched: Bools
    scaling: dict[str, float]
    ranges: dict[str, tuple[float, float]]
    signals: ScaledSignals

    @property
    def limits(self) -> tuple[float, float, float, float, float, float]:
        """Where runs are clamped, in units of ``se``: error, increment, position; low, high."""
        return limits(self.ranges, self.scaling)

    @property
    def ratio(self) -> float:
        """``se / sd``: the scale of the error over that of the change."""
        return self.scaling["error_scale"] / self.scaling["change_scale"]


def prepare(example: NarxExample, settings: NarxSettings) -> TrainingRecord | str:
    """The prepared record, or a sentence on why it cannot be trained on."""
    usable = believable(example.op, example.mv, example.usable)
    early = np.arange(usable.size) < example.train_until
    reason = _objection(example, usable, early)
    if reason is not None:
        return reason
    training = usable & early
    op, mv = (np.where(usable, signal, np.nan) for signal in (example.op, example.mv))
    actuator = example.start.actuator if example.start else NO_ACTUATOR
    command = actuator_output(op, example.interval_s, actuator)
    scaling = fit_scaling(command, mv, training, example.start)
    ranges = fit_ranges(command, mv, training, scaling)
    ranges["op"] = (float(op[training].min()), float(op[training].max()))
    if example.start is not None:
        ranges = element_ranges(ranges)
    trained, watched = _split(training, settings.watched_share)
    return TrainingRecord(
        example=example,
        op=op,
        mv=mv,
        usable=usable,
        trained=trained,
        watched=watched,
        scaling=scaling,
        ranges=ranges,
        signals=scale(command, mv, scaling, ranges),
    )


def _objection(example: NarxExample, usable: Bools, early: Bools) -> str | None:
    training, judging = usable & early, usable & ~early
    for part, least, purpose in (
        (training, _LEAST_TRAINED, "to train on"),
        (judging, _LEAST_JUDGED, "held out to judge the network on"),
    ):
        run_samples = int(np.sum(plan_run(part) == PlanStep.RUN))
        if run_samples < least:
            return (
                f"too few usable samples {purpose}: {run_samples} with two usable ones before "
                f"them, at least {least} needed; take a longer window"
            )
    if _hardly_moves(example.op[training]):
        return (
            "OP never moves in the training part, so nothing can be learned of how the valve "
            "follows; take a window in which the controller works the valve"
        )
    for part, part_name in ((training, "training"), (judging, "held-out")):
        if _hardly_moves(example.mv[part]):
            return (
                f"MV is constant in the {part_name} part: a valve that does not move at all, or a "
                "frozen transmitter; check the position signal"
            )
    return None


def _hardly_moves(values: Floats) -> bool:
    span = float(np.max(values) - np.min(values))
    return span <= max(_SMALLEST_SPAN, 1e-9 * float(np.max(np.abs(values))))


def _split(training: Bools, share: float) -> tuple[Bools, Bools]:
    """The last ``share`` of the usable training samples is watched, the rest trained on."""
    training_samples = np.flatnonzero(training)
    first_watched = (
        training_samples[round((1.0 - share) * (training_samples.size - 1))]
        if share
        else training.size
    )
    late = np.arange(training.size) > first_watched
    return training & ~late, training & late
