"""Which few minutes of a long recording show how the valve behaves: a typical stretch.

Two hours of a limit cycle of 40 s, drawn whole, are a filled band. The plots open on a handful of
reversals of OP instead, and on ones where the model is neither at its best nor at its worst.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.recording import Bools, Floats, Recording
from stemwatch.models.screening_result import Screening
from stemwatch.models.signals.excitation import ranges, reversals, swing
from stemwatch.service.presenter.wording import figure

# Eight reversals are four cycles: enough to see that they repeat, few enough to see each slip.
MOST_REVERSALS = 8
FEWEST_REVERSALS = 5
# A turn counts where OP goes back by a quarter of its swing, and by more than noise.
TURN_SHARE = 0.25
SMALLEST_TURN_PERCENT = 0.5
# A longer stretch shows hardly more detail than the whole record.
LONGEST_SHARE = 0.6
LEAST_KNOWN_SHARE = 0.8
MIDDLE_PERCENTILES = (40.0, 60.0)

Indices = NDArray[np.intp]


@dataclass(frozen=True, kw_only=True)
class TypicalStretch:
    """Samples ``first`` (inclusive) to ``last`` (exclusive).

    ``name`` heads the plots, ``why`` says what makes the stretch typical, or that it is the only
    one.
    """

    first: int
    last: int
    name: str
    why: str


@dataclass(frozen=True, kw_only=True)
class _Candidates:
    """Every run of ``count`` reversals in one part of the record, as samples [first, last)."""

    first: Indices
    last: Indices
    count: int
    held_out: bool

    def keep(self, selected: Bools) -> _Candidates:
        return _Candidates(
            first=self.first[selected],
            last=self.last[selected],
            count=self.count,
            held_out=self.held_out,
        )


def typical_stretch(screening: Screening) -> TypicalStretch | None:
    """The stretch on which the plots open; ``None`` where the whole record shows as much.

    Candidates are all runs of 5 to 8 reversals of OP, in the held-out part if it has so many. Of
    those whose error (rmse of MV less the stick-slip model; without a model, OP's swing) lies
    between the 40th and the 60th percentile, it is the one of the most ordinary duration.
    """
    if screening.recording is None:
        return None
    traces = screening.traces
    return typical_stretch_of(screening.recording, traces.stiction, traces.heldout_from)


def typical_stretch_of(
    recording: Recording, simulated: Floats | None, heldout: int | None
) -> TypicalStretch | None:
    """The same for any free run (n,) of MV and any first sample that it was not fitted to."""
    turns = _turns(recording.op.values)
    parts = [] if heldout is None else [(heldout, True)]
    for begin, held_out in [*parts, (0, False)]:
        candidates = _candidates(turns[turns >= begin], begin, len(recording), held_out)
        chosen = None if candidates is None else _most_typical(simulated, recording, candidates)
        if chosen is not None:
            return chosen
    return None


def _turns(op: Floats) -> Indices:
    """Indices at which OP turns round; gaps are skipped, not bridged by a value."""
    finite = np.flatnonzero(np.isfinite(op))
    if finite.size < 3:
        return finite[:0]
    threshold = max(TURN_SHARE * swing(op), SMALLEST_TURN_PERCENT)
    return finite[reversals(op[finite], threshold)]


def _candidates(turns: Indices, begin: int, end: int, held_out: bool) -> _Candidates | None:
    if turns.size < FEWEST_REVERSALS:
        return None
    count = min(max(turns.size // 2, FEWEST_REVERSALS), MOST_REVERSALS)
    # With a margin before the first and after the last turn, so that both are visible as turns.
    margin = int(np.median(np.diff(turns))) // 3 + 1
    first = np.maximum(turns[: turns.size - count + 1] - margin, begin)
    last = np.minimum(turns[count - 1 :] + margin + 1, end)
    candidates = _Candidates(first=first, last=last, count=count, held_out=held_out)
    return candidates.keep(last - first <= LONGEST_SHARE * end)


def _most_typical(
    simulated: Floats | None, recording: Recording, candidates: _Candidates
) -> TypicalStretch | None:
    errors = _errors(simulated, recording, candidates)
    measure = _swings(recording, candidates) if errors is None else errors
    finite = np.isfinite(measure)
    if not finite.any():
        return None
    candidates, measure = candidates.keep(finite), measure[finite]
    low, high = np.percentile(measure, MIDDLE_PERCENTILES, method="nearest")
    length = candidates.last - candidates.first
    distance = np.abs(length - np.median(length)).astype(np.float64)
    distance[(measure < low) | (measure > high)] = np.inf
    # Of several that are equally ordinary, the middle one: the record's ends are seldom typical.
    equal = np.flatnonzero(distance == distance.min())
    k = int(equal[equal.size // 2])
    reason = _reason(candidates, measure[k], float(np.median(measure)), of_model=errors is not None)
    name = "A typical stretch" if candidates.first.size > 1 else "A stretch"
    return TypicalStretch(
        first=int(candidates.first[k]), last=int(candidates.last[k]), name=name, why=reason
    )


def _errors(
    simulated: Floats | None, recording: Recording, candidates: _Candidates
) -> Floats | None:
    """Rmse of MV less the stick-slip model on each candidate; NaN where too much is missing."""
    mv = recording.mv
    if mv is None or simulated is None or simulated.shape != mv.values.shape:
        return None
    square = (mv.values - simulated) ** 2
    finite = np.isfinite(square)
    if not finite.any():
        return None
    total = _sums(np.where(finite, square, 0.0), candidates)
    count = _sums(finite.astype(np.float64), candidates)
    enough_known = count >= LEAST_KNOWN_SHARE * (candidates.last - candidates.first)
    rmse: Floats = np.sqrt(total / np.maximum(count, 1.0))
    return np.where(enough_known, rmse, np.nan)


def _sums(values: Floats, candidates: _Candidates) -> Floats:
    running = np.concatenate(([0.0], np.cumsum(values)))
    return np.asarray(running[candidates.last] - running[candidates.first])


def _swings(recording: Recording, candidates: _Candidates) -> Floats:
    return ranges(recording.op.values, np.stack((candidates.first, candidates.last), axis=1))


def _reason(candidates: _Candidates, measure: float, middle: float, *, of_model: bool) -> str:
    part = " in the held-out part" if candidates.held_out else ""
    measure_text = "the stick-slip model misses MV by" if of_model else "OP swings over"
    unit = "% rmse" if of_model else "%"
    number = f"{measure_text} {figure(measure, 2)} {unit} here"
    if candidates.first.size == 1:
        return f"The only stretch with {candidates.count} reversals of OP{part}; {number}."
    others = f"{figure(middle, 2)} % in the middle one of {candidates.first.size} such stretches"
    return f"Chosen as typical: {candidates.count} reversals of OP{part}; {number}, {others}."
