"""Which models a recording cannot separate: those that were named together, or came near to being
named.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from stemwatch.models.closed_loop.process_response import process_response
from stemwatch.models.mismatch.acceptance_limits import NEAR, strength
from stemwatch.models.mismatch.fit.base_coordinate import N_BASE
from stemwatch.models.mismatch.fit.crossfit import Fitted
from stemwatch.models.mismatch.fit.evaluator import Evaluator
from stemwatch.models.mismatch.open_question import OpenQuestion, RivalModel
from stemwatch.models.mismatch.search.named_terms import Named, TermScore
from stemwatch.models.recording import Floats, Recording
from stemwatch.models.signals.forensics import noise_sigma
from stemwatch.models.stickslip.stroke_curve import StrokeCurve

MOST_RIVALS = 4


def left_open(evaluator: Evaluator, named: Named, effects_named: Sequence[str]) -> OpenQuestion:
    """The rival models left after ``named``; ``effects_named`` are the effects that are published.

    Where an effect was named together with others that the recording cannot separate from it, the
    rivals are these. Where nothing was named, they are S and J alone and what came nearest to being
    named.
    """
    problem = evaluator.problem
    return OpenQuestion(
        models=_rivals(evaluator, named, effects_named)[:MOST_RIVALS],
        published=_model("", named.fitted) if effects_named else None,
        unit_s=problem.unit_s,
        interval=problem.interval_s,
        duration=problem.op.size * problem.interval_s,
        sigma=problem.sigma,
        scatter=evaluator.scatter,
        restick=evaluator.restick,
    )


def _rivals(
    evaluator: Evaluator, named: Named, effects_named: Sequence[str]
) -> tuple[RivalModel, ...]:
    for needed in named.needed:
        if needed.term.slug in effects_named and len(needed.members) > 1:
            return tuple(_model(score.slug, score.fitted) for score in needed.stage.accepted)
    if effects_named or not named.stages:
        return ()
    first = named.stages[0]
    suspected = [score for score in first.scores if _suspected(evaluator, score)]
    if not suspected:
        return ()
    return (_model("", first.before), *(_model(score.slug, score.fitted) for score in suspected))


def _suspected(evaluator: Evaluator, score: TermScore) -> bool:
    is_suspected = strength(score.advantage, evaluator.measured_counts, score.slug) >= NEAR
    return is_suspected and score.term.material(score.values, evaluator.summary)


def _model(slug: str, fitted: Fitted) -> RivalModel:
    return RivalModel(
        slug=slug,
        base=_rows(fitted.candidates[:, :N_BASE]),
        terms={name: _rows(fitted.values(name)) for name in fitted.slugs},
    )


def _rows(values: Floats) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(float(x) for x in row) for row in values)


def on_site(
    question: OpenQuestion | None, recording: Recording, curve: StrokeCurve | None
) -> OpenQuestion:
    """``question`` with the operating point for a test, from the recording: OP, PV, interval.

    ``recording`` on its own clock; without ``question`` nothing could be fitted to it.
    """
    op = recording.op.values[recording.op.usable]
    open_question = question or OpenQuestion(
        unit_s=recording.own_unit_s or 1.0,
        interval=recording.interval_s,
        duration=len(recording) * recording.interval_s,
        sigma=0.1 if recording.mv is None else max(noise_sigma(recording.mv.values), 1e-3),
    )
    if op.size:
        low, high = (float(end) for end in np.percentile(op, (1.0, 99.0)))
        open_question = replace(open_question, op=float(op[-1]), op_low=low, op_high=high)
    if question is not None and not question.models:
        return replace(open_question, curve=curve)
    return replace(open_question, process=process_response(recording), curve=curve)
