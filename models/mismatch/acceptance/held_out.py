"""The fit without and with the named effects, on a part of the record that neither fit has seen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.mismatch.findings import FreeRuns, HeldOutFit
from stemwatch.models.mismatch.fit import base_coordinate
from stemwatch.models.mismatch.fit.base_coordinate import S_and_J
from stemwatch.models.mismatch.fit.base_fit import (
    AGAIN,
    CLEARLY,
    NAIVE,
    beyond_command,
    fit_naive,
    naive_evaluator,
    naive_layout,
    sticking_again,
    suggested_zero,
)
from stemwatch.models.mismatch.fit.batched_search import Search, conclude
from stemwatch.models.mismatch.fit.crossfit import CAREFUL, Fitted, folds, on_both, search, widened
from stemwatch.models.mismatch.fit.evaluator import CoordinateLayout, Evaluator, TermSet
from stemwatch.models.mismatch.fit.starting_points import beginnings
from stemwatch.models.mismatch.term import Term
from stemwatch.models.mismatch.terms._common import CALIBRATE_FROM_PERCENT
from stemwatch.models.recording import Bools, Floats
from stemwatch.models.statistics.block_bootstrap import COVERAGE, block_weights

REPLICATES = 400
FEWEST = 30  # samples, from which an error is given


@dataclass(frozen=True)
class HeldOutComparison:
    """Free runs with the parameters of the first part, and their errors on the rest; ``followed``
    is the fit there of the extended model with the breakaways where they were seen, percent, and
    ``trained`` (size,) that model."""

    heldout: HeldOutFit
    runs: FreeRuns
    trained: Floats
    followed: float | None = None

    def of_naive_alone(self) -> HeldOutComparison:
        """The same where S and J alone are published."""
        runs = replace(self.runs, extended=self.runs.naive)
        return replace(self, heldout=self.heldout.of_naive_alone(), runs=runs)


class FirstPart:
    """S and J fitted to the first part of a record, from which the fit of every hypothesis starts
    there. They are computed once for all hypotheses.
    """

    def __init__(self, evaluator: Evaluator) -> None:
        self.evaluator = evaluator
        self.blocks = evaluator.problem.training_blocks()
        self.naive_only = naive_evaluator(evaluator)

    @cached_property
    def naive(self) -> Floats:
        """(6,) S and J alone, as others fit them."""
        return conclude(self.naive_only, fit_naive(self.naive_only, self.blocks))

    @cached_property
    def naive_slip_by_slip(self) -> Floats:
        """(6,) S and J alone, fitted with the breakaways where they were seen."""
        layout = naive_layout(self.evaluator)
        starts = np.vstack((_few_candidates(self.evaluator), self.naive, self.base.candidates[:1]))
        starts = layout.bounds.clip(starts)
        return conclude(
            self.evaluator, search(self.evaluator, layout, self.blocks, starts, CAREFUL)
        ).candidate

    @cached_property
    def base(self) -> Fitted:
        """S, J and the reading, with the breakaways where they were seen."""
        evaluator = self.evaluator
        layout = evaluator.layout(TermSet())
        starts = np.vstack((_few_candidates(evaluator), beyond_command(evaluator.summary, 0.0)))
        starts = np.vstack((starts, *_of_a_reading_off(evaluator, starts)))
        sliding = conclude(
            evaluator,
            search(evaluator, layout, self.blocks, layout.bounds.clip(starts), CAREFUL),
        )
        candidate = sliding.candidate[None, :]
        starts = np.vstack((candidate, *sticking_again(layout, candidate)))
        sticking = conclude(evaluator, search(evaluator, layout, self.blocks, starts, AGAIN))
        best = sticking if sticking.loss < CLEARLY * sliding.loss else sliding
        return on_both(layout, best.candidate)


def compare_held_out(
    evaluator: Evaluator,
    layout: CoordinateLayout,
    terms: Sequence[Term],
    ceiling: Floats | None,
    starts: Floats | None = None,
    first_part: FirstPart | None = None,
) -> HeldOutComparison:
    """Fit naive and extended to the first part only, run both freely over the whole record.

    ``layout`` is the final hypothesis, ``terms`` its terms in the order in which they were found.
    ``ceiling`` (n,) is the free run of a network that was fitted to the same first part. With
    ``starts`` (m, size), which know the first part alone, the final hypothesis begins there.
    ``first_part`` holds the fits that all hypotheses of this record share.
    """
    problem = evaluator.problem
    if first_part is None or first_part.evaluator is not evaluator:
        first_part = FirstPart(evaluator)
    train, naive_only, simple = first_part.blocks, first_part.naive_only, first_part.naive
    naive = naive_only.simulate(naive_layout(naive_only), simple)
    if starts is None:
        trained = conclude(evaluator, _trained(first_part, layout, terms))
    else:
        trained = conclude(
            evaluator, search(evaluator, layout, train, layout.bounds.clip(starts), CAREFUL)
        ).candidate
    candidate = _running_free(evaluator, layout, terms, train, trained, simple)
    extended = evaluator.simulate(layout, candidate)
    begin = int(np.ceil(problem.op.size * train.sum() / problem.n_blocks))
    unseen = _unseen(evaluator, begin)
    runs = FreeRuns(naive=naive, extended=extended, heldout_from=begin)
    heldout = _heldout(evaluator, runs, unseen, ceiling)
    assimilated, _ = evaluator.assimilated(layout, trained)
    followed = _fit(problem.mv[unseen], assimilated[unseen])
    return HeldOutComparison(heldout, runs, trained, followed)


def slip_by_slip(
    comparison: HeldOutComparison, layout: CoordinateLayout, first_part: FirstPart
) -> HeldOutComparison:
    """The same two models, each of them with the breakaways where they were seen.

    A stem that sticks again after each slip is, in a free run, soon a slip ahead or behind, and no
    free run of it is nearer than that of a stem that slides, which forgets. What is asked here is
    where a stem that has let go comes to rest; neither model was fitted to these slips.
    """
    evaluator = first_part.evaluator
    naive, _ = evaluator.assimilated(naive_layout(evaluator), first_part.naive_slip_by_slip)
    extended, _ = evaluator.assimilated(layout, comparison.trained)
    runs = replace(comparison.runs, naive=naive, extended=extended)
    unseen = _unseen(evaluator, runs.heldout_from)
    heldout = replace(_heldout(evaluator, runs, unseen, None), slip_by_slip=True)
    return replace(comparison, heldout=heldout, runs=runs)


def on_alternate_blocks(
    comparison: HeldOutComparison, fitted: Fitted, terms: Sequence[Term], first_part: FirstPart
) -> HeldOutComparison:
    """Both models fitted to every other block of time, and run freely over the blocks between.

    The first part of a record cannot tell how a drift goes on, how fast friction will grow, or
    where a stop is that the stem has not met yet: what fits it best goes wrong behind it. The
    blocks between those that were fitted are as unseen, and nothing is foretold.

    ``fitted`` is the final hypothesis on both folds, ``terms`` its terms in the order in which they
    were found.
    """
    evaluator, naive_only = first_part.evaluator, first_part.naive_only
    samples = evaluator.problem.op.size
    naive, extended = np.empty(samples), np.empty(samples)
    of_naive, both_folds = naive_layout(naive_only), folds(evaluator)
    for candidate, fold, other in zip(
        fitted.candidates, both_folds, reversed(both_folds), strict=True
    ):
        simple = conclude(naive_only, fit_naive(naive_only, fold))
        free = _running_free(evaluator, fitted.layout, terms, fold, candidate, simple)
        inside = other[np.maximum(evaluator.problem.block, 0)]
        naive[inside] = naive_only.simulate(of_naive, simple)[inside]
        extended[inside] = evaluator.simulate(fitted.layout, free)[inside]
    runs = replace(comparison.runs, naive=naive, extended=extended, heldout_from=0)
    heldout = _heldout(evaluator, runs, evaluator.measured, None)
    return replace(comparison, heldout=replace(heldout, alternate_blocks=True), runs=runs)


def _unseen(evaluator: Evaluator, begin: int) -> Bools:
    """(n,) the measured samples from ``begin`` on."""
    return evaluator.measured & (np.arange(evaluator.problem.op.size) >= begin)


def _fit(mv: Floats, run: Floats) -> float | None:
    """``100 (1 - rmse / std)`` of some samples, or ``None`` where MV does not vary."""
    spread = float(np.std(mv)) if mv.size else 0.0
    if mv.size < FEWEST or spread == 0.0:
        return None
    return 100.0 * (1.0 - _rms(mv - run) / spread)


def _trained(
    first_part: FirstPart, layout: CoordinateLayout, terms: Sequence[Term]
) -> Search[Floats]:
    """The extended model fitted to the first part alone: from a grid of S and J, then term by term
    in the order in which they were found.
    """
    evaluator, train, fitted = first_part.evaluator, first_part.blocks, first_part.base
    for term in terms:
        rich = evaluator.layout(fitted.layout.hypothesis.plus(term))
        begin_at = beginnings(term, *S_and_J(fitted.candidates[0]))
        starts = widened(evaluator, rich.hypothesis, fitted, term, begin_at)
        fit = yield from search(evaluator, rich, train, starts, CAREFUL)
        fitted = on_both(rich, fit.candidate)
    start = layout.bounds.clip(fitted.candidates[:1])  # a gain that is no finding is held at 1
    fit = yield from search(evaluator, layout, train, start, CAREFUL)
    return fit.candidate


def _running_free(
    evaluator: Evaluator,
    layout: CoordinateLayout,
    terms: Sequence[Term],
    train: Bools,
    trained: Floats,
    simple: Floats,
) -> Floats:
    """``trained`` refitted by free runs, the loss of the naive model.

    An assimilated run and a free run have different optima; judged by its free run, the extended
    model would be at a disadvantage against a simpler model that was fitted by free runs. S and J
    of the naive fit, ``simple`` (6,), are starts as well, less the part of them that belongs to a
    term.
    """
    rows = [trained]
    if not terms:
        rows.append(np.concatenate((simple, np.zeros(layout.size - simple.size))))
    S, J = S_and_J(simple)
    for term in terms:
        size = float(trained[layout.places[term.slug]][0])
        for start in beginnings(term, S, J):
            row = trained.copy()
            lower_S = max(start.S - start.S_less * size, 0.3 * start.S)
            jump = min(max(start.J - start.J_less * size, 0.0), lower_S)
            row[base_coordinate.S_PERCENT] = lower_S
            row[base_coordinate.RATIO] = jump / max(lower_S, 1e-6)
            rows.append(row)
    free = replace(evaluator, window=0.0)
    starts = layout.bounds.clip(np.vstack(rows))
    for _ in range(2):  # as the naive model is fitted
        best = conclude(free, search(free, layout, train, starts, NAIVE)).candidate
        starts = best[None, :]
    return best


def _of_a_reading_off(evaluator: Evaluator, starts: Floats) -> list[Floats]:
    """``starts`` (m, 6) with the zero that the loop suggests, where that is far from none: from no
    zero a search then ends at an S as wide as the zero is off."""
    zero = suggested_zero(evaluator.problem)
    if abs(zero) < CALIBRATE_FROM_PERCENT:
        return []
    moved = starts.copy()
    moved[:, base_coordinate.ZERO] = zero
    return [moved]


def _few_candidates(evaluator: Evaluator) -> Floats:
    """(m, 6) S and J from a coarse grid."""
    widths = max(1.2 * evaluator.summary.swing, 2.0) * np.linspace(0.02, 1.0, 14) ** 1.8
    parts = np.array(np.meshgrid(widths, (0.0, 0.3, 0.6, 0.9), indexing="ij")).reshape(2, -1).T
    rows = np.zeros((parts.shape[0], base_coordinate.N_BASE))
    rows[:, [base_coordinate.S_PERCENT, base_coordinate.RATIO]] = parts
    return rows


def _heldout(
    evaluator: Evaluator, runs: FreeRuns, unseen: Bools, ceiling: Floats | None
) -> HeldOutFit:
    """The errors of both runs on the ``unseen`` samples (n,), percent; without a number where these
    are few or MV does not vary.
    """
    problem = evaluator.problem
    mv = problem.mv[unseen]
    spread = float(np.std(mv)) if mv.size else 0.0
    if mv.size < FEWEST or spread == 0.0:
        return HeldOutFit(noise_floor=problem.sigma)
    naive, extended = (mv - run[unseen] for run in (runs.naive, runs.extended))
    low, high = _interval(naive, extended, mv, problem.block[unseen])
    rmse_naive, rmse_extended = _rms(naive), _rms(extended)
    return HeldOutFit(
        rmse_naive=rmse_naive,
        rmse_extended=rmse_extended,
        rmse_ceiling=_ceiling(ceiling, problem.mv, unseen),
        # A model with a smaller residual than the estimated noise shows that the noise is smaller.
        noise_floor=min(problem.sigma, rmse_naive, rmse_extended),
        fit_naive=100.0 * (1.0 - rmse_naive / spread),
        fit_extended=100.0 * (1.0 - rmse_extended / spread),
        gain_low=low,
        gain_high=high,
    )


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _ceiling(ceiling: Floats | None, mv: Floats, unseen: Bools) -> float | None:
    """The rms error of the network's free run on the unseen samples, percent."""
    if ceiling is None or ceiling.size != mv.size:
        return None
    error = (mv - ceiling)[unseen & np.isfinite(ceiling)]
    return _rms(error) if error.size >= FEWEST else None


def _interval(
    naive: Floats, extended: Floats, mv: Floats, block: NDArray[np.int64]
) -> tuple[float, float]:
    """95 % interval of the difference of the fits, in percent, by drawing blocks of time."""
    numbers, block_index = np.unique(block, return_inverse=True)
    centred = (mv - mv.mean()) ** 2
    squares = (naive**2, extended**2, centred)
    sums = np.array([np.bincount(block_index, weights=w, minlength=numbers.size) for w in squares])
    rng = np.random.default_rng(5)
    weights = block_weights(np.bincount(block_index), REPLICATES, rng)
    before, after, spread = np.sqrt(np.maximum(sums @ weights.T, 1e-12))
    low, high = np.percentile(100.0 * (before - after) / spread, COVERAGE)
    return float(low), float(high)
