"""The score of a benchmark, built so that answers without knowledge gain nothing.

Five parts, each 1 for the truth and 0 for no answer. The answer to a case that says nothing of it
(always the same, or drawn by lot) never has an expected score above 0, so that nobody gains by
answering what he does not know.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.recording import Floats
from stemwatch.service.studies.benchmark.answers import CaseAnswer, Number, Sticks
from stemwatch.service.studies.benchmark.truth import ValveTruth

# Half of the valves stick: a wrong word costs twice what a right one gains, as a valve that is
# taken out for nothing, or left sticking, costs more than one more measurement.
WRONG_STICTION = -2.0
WRONG_CAUSE = -1.0  # no cause is right for more than half of the cases
MISS = 0.05  # share of truths that a 95 % interval may miss
PARTS = ("stiction with position", "stiction without", "S", "J", "cause")
_DRAWS = 2000


@dataclass(frozen=True, kw_only=True)
class PartScore:
    """One part: ``score`` over the cases that are asked, ``answered`` and ``right`` of them. Of S
    and J, ``right`` counts intervals that hold the truth and ``error`` is the median error of the
    values that were given, percent of OP span."""

    part: str
    score: float
    asked: int
    answered: int
    right: int
    error: float | None = None


@dataclass(frozen=True, kw_only=True)
class BenchmarkScore:
    """The mean of the parts, with its 95 % interval over the draw of cases (bootstrap)."""

    total: float
    low: float
    high: float
    parts: tuple[PartScore, ...]


@dataclass(frozen=True)
class _Marks:
    """One part over all n cases: scores (n,), NaN where the case is not asked."""

    scores: Floats
    answered: int
    right: int
    error: float | None = None


def benchmark_score(
    truths: Sequence[ValveTruth], answers: Mapping[str, CaseAnswer]
) -> BenchmarkScore:
    """The score of ``answers``; a case that is missing there is not answered."""
    marks = _marks_of(truths, answers)
    scores = np.array([part.scores for part in marks])
    everyone = np.arange(len(truths))[np.newaxis]
    draws = np.random.default_rng(1).integers(0, len(truths), (_DRAWS, len(truths)))
    low, high = np.quantile(_means(scores, draws).mean(axis=0), [0.025, 0.975])
    return BenchmarkScore(
        total=float(_means(scores, everyone).mean()),
        low=float(low),
        high=float(high),
        parts=_parts(marks),
    )


def _marks_of(
    truths: Sequence[ValveTruth], answers: Mapping[str, CaseAnswer]
) -> tuple[_Marks, ...]:
    given = [answers.get(truth.case, CaseAnswer()) for truth in truths]
    return (
        _stiction(truths, given, position=True),
        _stiction(truths, given, position=False),
        _numbers([t.S if t.sticks else None for t in truths], [a.S for a in given]),
        _numbers([t.J if t.sticks and t.position else None for t in truths], [a.J for a in given]),
        _causes(truths, given),
    )


def _parts(marks: Sequence[_Marks]) -> tuple[PartScore, ...]:
    return tuple(
        PartScore(
            part=name,
            score=float(
                _means(part.scores[np.newaxis], np.arange(part.scores.size)[np.newaxis])[0, 0]
            ),
            asked=int(np.isfinite(part.scores).sum()),
            answered=part.answered,
            right=part.right,
            error=part.error,
        )
        for name, part in zip(PARTS, marks, strict=True)
    )


def _means(scores: Floats, draws: NDArray[np.int64]) -> Floats:
    """(parts, draws) means of ``scores`` (parts, n) over the cases of each of ``draws`` (m, n)
    that are asked; 0 where none is."""
    asked = np.isfinite(scores)
    total = np.where(asked, scores, 0.0)[:, draws].sum(axis=2)
    return np.asarray(total / np.maximum(asked[:, draws].sum(axis=2), 1))


def _stiction(
    truths: Sequence[ValveTruth], given: Sequence[CaseAnswer], *, position: bool
) -> _Marks:
    """1 for the right word, ``WRONG_STICTION`` for the wrong one, 0 for "cannot tell"."""
    scores = np.full(len(truths), np.nan)
    for index, (truth, answer) in enumerate(zip(truths, given, strict=True)):
        if truth.position is not position:
            continue
        if answer.stiction is Sticks.CANNOT_TELL:
            scores[index] = 0.0
        else:
            is_right = (answer.stiction is Sticks.YES) == truth.sticks
            scores[index] = 1.0 if is_right else WRONG_STICTION
    return _counted(scores)


def _causes(truths: Sequence[ValveTruth], given: Sequence[CaseAnswer]) -> _Marks:
    """1 over the number of words for words that hold the truth, ``WRONG_CAUSE`` for others."""
    scores = np.full(len(truths), np.nan)
    for index, (truth, answer) in enumerate(zip(truths, given, strict=True)):
        if not truth.cause:
            continue
        if not answer.causes:
            scores[index] = 0.0
        else:
            is_right = truth.cause in answer.causes
            scores[index] = 1.0 / len(answer.causes) if is_right else WRONG_CAUSE
    return _counted(scores)


def _counted(scores: Floats) -> _Marks:
    asked = scores[np.isfinite(scores)]
    return _Marks(scores, int(np.sum(asked != 0.0)), int(np.sum(asked > 0.0)))


def _numbers(truths: Sequence[float | None], given: Sequence[Number]) -> _Marks:
    """``1 - IS / IS of the best interval that is the same for all cases``; 0 without an interval.

    IS is the interval score, proper for a central interval: Gneiting and Raftery (2007),
    doi:10.1198/016214506000001437, equation (43).
    """
    asked = np.array([truth for truth in truths if truth is not None])
    scores = np.full(len(truths), np.nan)
    if not asked.size:
        return _Marks(scores, 0, 0)
    # The quantiles of the truths themselves make the least mean score of all fixed intervals.
    low, high = np.quantile(asked, [MISS / 2.0, 1.0 - MISS / 2.0], method="inverted_cdf")
    blind = float(np.mean([interval_score(low, high, truth) for truth in asked]))
    answered = right = 0
    errors = []
    for index, (truth, number) in enumerate(zip(truths, given, strict=True)):
        if truth is None:
            continue
        scores[index] = 0.0
        if number.value is not None:
            errors.append(abs(number.value - truth))
        if number.interval is not None:
            scores[index] = 1.0 - interval_score(*number.interval, truth) / max(blind, 1e-9)
            answered += 1
            right += number.interval[0] <= truth <= number.interval[1]
    return _Marks(scores, answered, right, float(np.median(errors)) if errors else None)


def interval_score(low: float, high: float, truth: float) -> float:
    """Width, and 2 / ``MISS`` times what the truth lies outside; in the unit of the truth."""
    return (high - low) + 2.0 / MISS * (max(low - truth, 0.0) + max(truth - high, 0.0))
