"""The curve from OP to stroke, corrected by an assimilated fit, in which every breakaway is where
it was seen.

A curve is found by free runs (``find_stroke_curve``). A breakaway that comes early or late leaves
an error of a whole jump in them, which bends the curve there. In an assimilated run the stem lets
go where the recording shows it, so that the residual while it moves is small. The part of that
residual that follows OP and is the same in both directions belongs to the curve. It is fitted by a
polynomial of OP, the mean of those of both folds, and is accepted where S, J and reading alone,
fitted anew, then predict the unseen blocks better.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stemwatch.models.mismatch.fit.base_fit import BaseFit, fit_base
from stemwatch.models.mismatch.fit.batched_search import conclude
from stemwatch.models.mismatch.fit.crossfit import folds, gain, scored
from stemwatch.models.mismatch.measurement.record_effects import measured_record
from stemwatch.models.mismatch.prepared_recording import problem_of, summary_of
from stemwatch.models.recording import Floats, Recording
from stemwatch.models.stickslip.curve_signs import MOVING_SAMPLES, at_a_stop
from stemwatch.models.stickslip.find_stroke_curve import (
    DEGREES,
    EARLIER_USED,
    LEAST_BEND_GAIN,
    LEAST_BEND_T,
    monotone,
    robust_weights,
)
from stemwatch.models.stickslip.stroke_curve import StrokeCurve, in_travel, shapes_of

MOVES = 1e-9  # percent in a sample


def refined(recording: Recording, curve: StrokeCurve | None) -> StrokeCurve | None:
    """The ``curve`` that was found, corrected where that predicts unseen blocks better. It is
    returned unchanged where it was given, where its slope is not known, or where OP moved too
    little.
    """
    if curve is None or not curve.unsure_degree or curve.remark == EARLIER_USED:
        return curve
    base = _base_of(recording, curve)
    correction = _correction(recording, base)
    if correction is None:
        return curve
    command = curve.command(recording.op.values) + correction
    corrected = monotone(recording, command, slope_known=True)
    if corrected is None:
        return curve
    again = _base_of(recording, corrected)
    # Both losses need one scale; the coordinates are the same.
    judge = replace(again.evaluator, delta=base.evaluator.delta, _layouts={})
    fitted = conclude(
        judge, scored(judge.layout(base.fitted.layout.hypothesis), again.fitted.candidates)
    )
    gained = gain(base.evaluator, base.fitted, fitted)
    if gained.mean < LEAST_BEND_GAIN or gained.t < LEAST_BEND_T:
        return curve
    return replace(corrected, remark=curve.remark)


def _base_of(recording: Recording, curve: StrokeCurve) -> BaseFit:
    """S, J and reading alone, fitted to a recording read through the curve."""
    measured = measured_record(recording)
    problem = problem_of(in_travel(recording, curve), measured)
    return fit_base(problem, summary_of(problem, measured.spacing_s), measured.slack)


def _correction(recording: Recording, base: BaseFit) -> Floats | None:
    """(n,) the correction of the curve by the assimilated runs of both folds, percent of travel;
    ``None`` where either moves too little.
    """
    evaluator, problem = base.evaluator, base.evaluator.problem
    op = recording.op.values
    shapes = np.nan_to_num(shapes_of(op, op[np.isfinite(op)], DEGREES[-1]))
    inside = evaluator.measured & ~at_a_stop(problem.op, problem.mv)
    corrections = []
    for candidate, fold in zip(base.fitted.candidates, folds(evaluator), strict=True):
        simulated, _ = evaluator.assimilated(base.fitted.layout, candidate)
        step = np.diff(simulated, prepend=simulated[0])
        used = inside & (np.abs(step) > MOVES) & np.append(fold, False)[problem.block]
        if np.count_nonzero(used) < MOVING_SAMPLES:
            return None
        columns = np.column_stack((shapes, np.sign(step)))[used]
        weights = robust_weights(columns, (problem.mv - simulated)[used])
        corrections.append(shapes @ weights[:-1])
    return np.asarray(np.mean(corrections, axis=0))
