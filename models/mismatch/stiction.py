"""S and J of a hypothesis with their intervals: from its fit, from the breakaways, from the
likelihood of the whole record, or from the force balance of a drive.

A run with one level reads S and J too small where breakaways scatter (``stickslip.breakaways``), so
the breakaways are used where they agree with the element that was fitted. The likelihood knows of
that scatter, and of slips that noise hides (``breakaway_filter``). A fit's own interval
comes from the bootstrap and from a model error, because no stem is exactly the element.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.findings import Stiction
from stemwatch.models.mismatch.fit import base_coordinate
from stemwatch.models.mismatch.fit.crossfit import Fitted, gain
from stemwatch.models.mismatch.fit.evaluator import Evaluator
from stemwatch.models.mismatch.fit.uncertainty import estimate
from stemwatch.models.mismatch.likelihood.maximum_likelihood import RecordLikelihood, likeliest_of
from stemwatch.models.mismatch.search.breakaway_scatter import (
    less_scattered,
    scatter_matters,
    too_noisy,
)
from stemwatch.models.mismatch.search.reading_errors import without_error
from stemwatch.models.mismatch.search.same_rests import along_the_ridge
from stemwatch.models.mismatch.stem_model.delay import delayed
from stemwatch.models.recording import PERCENT, Floats
from stemwatch.models.signals.op_in_steps import set_in_steps
from stemwatch.models.stickslip.breakaways import LEAST_J, Breakaways, breakaways
from stemwatch.models.stickslip.force_balance import ForceBalance
from stemwatch.models.stickslip.interval import (
    REPLICATES,
    way_in_a_sample,
    with_jumps_of_steps,
    with_untold_jumps,
)
from stemwatch.models.stickslip.problem import FitProblem

# Standard error: no stem is exactly the element, and a little lag looks like a little dead band.
MODEL_ERROR, LEAST_ERROR = 0.08, 0.1  # of the level (S + J)/2; percent
# The same beside a named lag or drag, which can take the place of more dead band: of six valves
# without a jump on which one was named (draw_sticky, seeds 7171, 8181, 8383) five had S and J off
# by 0.25 to 0.7 %, and three intervals failed.
ERROR_WITH_LAG, LEAST_WITH_LAG = 0.12, 0.2
# The t-like value of a jump on unseen blocks (``crossfit.gain``), below which there may be none.
JUMP_ASKED = 2.0
SAME_LEVELS = (
    0.1  # of the level; breakaways and fit that differ by more belong to different elements
)


def stiction(
    evaluator: Evaluator,
    drawn_candidates: Callable[[], Floats],
    best: Floats,
    elements: Sequence[Floats],
    delay_s: float = 0.0,
    *,
    with_lag: bool = False,
) -> Stiction:
    """S and J of the fit ``best``, or from the breakaways where these agree with one of the
    ``elements`` that were fitted. ``delay_s``: the dead time of the command; ``with_lag``: whether
    a lag or a drag was named beside friction.
    """
    S = float(best[base_coordinate.S_PERCENT])
    J = S * float(best[base_coordinate.RATIO])
    gain, zero = 1.0 + float(best[base_coordinate.GAIN]), float(best[base_coordinate.ZERO])
    seen = breakaways(_later(evaluator.problem, delay_s), gain, zero, S, J) if elements else None
    if seen is not None and any(_same_element(seen, element) for element in elements):
        S_seen, J_seen = seen.draws(REPLICATES, np.random.default_rng(7))
        return Stiction(S=estimate(S_seen, seen.S, PERCENT), J=estimate(J_seen, seen.J, PERCENT))
    share, least = (ERROR_WITH_LAG, LEAST_WITH_LAG) if with_lag else (MODEL_ERROR, LEAST_ERROR)
    error = max(share * 0.5 * (S + J), least)
    all_drawn = drawn_candidates()
    S_replicates = all_drawn[:, base_coordinate.S_PERCENT]
    J_replicates = S_replicates * all_drawn[:, base_coordinate.RATIO]
    problem = evaluator.problem
    if set_in_steps(problem.op[problem.scored], problem.mv[problem.scored]):
        S_replicates, J_replicates = with_jumps_of_steps(
            S_replicates, J_replicates, way_in_a_sample(problem)
        )
    elif J < LEAST_J:
        J_replicates = with_untold_jumps(S_replicates, J_replicates)
    return Stiction(
        S=_positive(estimate(S_replicates, float(S), PERCENT, float(error))),
        J=_positive(estimate(J_replicates, float(J), PERCENT, float(error))),
    )


def _later(problem: FitProblem, delay_s: float) -> FitProblem:
    """The problem with its command delayed by ``delay_s``."""
    if delay_s == 0.0:
        return problem
    command = np.empty_like(problem.op)
    delayed(problem.op, problem.start, delay_s / problem.interval_s, command)
    return replace(problem, op=command)


def _same_element(seen: Breakaways, element: Floats) -> bool:
    """Whether both levels of the breakaways are near those of a fitted ``element``. An operator's
    step or ramp in the sample of a slip can mislead the breakaways.
    """
    S, ratio = float(element[base_coordinate.S_PERCENT]), float(element[base_coordinate.RATIO])
    level, kinetic = 0.5 * S * (1.0 + ratio), 0.5 * S * (1.0 - ratio)
    difference = max(abs(seen.level - level), abs(seen.kinetic - kinetic))
    return difference <= SAME_LEVELS * level


def of_candidate(candidate: Floats) -> tuple[Estimate, Estimate]:
    """S and J of a candidate, each an interval of no width."""
    S = float(candidate[base_coordinate.S_PERCENT])
    values = (S, S * float(candidate[base_coordinate.RATIO]))
    S_alone, J_alone = (Estimate(value=v, low=v, high=v, unit=PERCENT) for v in values)
    return S_alone, J_alone


def holding_no_jump(evaluator: Evaluator, fitted: Fitted, told: Stiction) -> Stiction:
    """``told``, the S and J of a fit with effects beside friction, with intervals that include a
    stem without a jump where unseen blocks do not need a jump. Where OP goes as far in a sample as
    the stem jumps, the values are those of a stem without a jump, and only the intervals hold the
    jump.

    Every step of a staircase moves the stem, whatever its breakaway level is, so that the level is
    only bounded; and a jump can take up the error in the shape of a lag or drag, on unseen steps as
    well as on those that were fitted.
    """
    if not (told.J.low or 0.0) > 0.0:
        return told
    without = without_error(evaluator, fitted, base_coordinate.RATIO, 0.0)
    in_steps = jump_within_a_step(evaluator.problem, told)
    if not in_steps and gain(evaluator, without, fitted).t >= JUMP_ASKED:
        return told
    S, J = of_candidate(without.candidates.mean(axis=0))
    both = Stiction(S=told.S.holding(S), J=told.J.holding(J))
    if not in_steps:
        return both
    return Stiction(S=replace(both.S, value=S.value), J=replace(both.J, value=J.value))


def jump_within_a_step(problem: FitProblem, told: Stiction) -> bool:
    """Whether OP goes as far in a sample as the stem jumps, so that no sample shows where the
    stem let go."""
    return way_in_a_sample(problem) >= (told.J.value or 0.0)


def of_likelihood(evaluator: Evaluator, fitted: Fitted) -> Stiction | None:
    """S and J by which the record is most likely where it is ``fitted`` by friction alone; ``None``
    where breakaways hardly reach beyond the noise, where OP goes as far in a sample as the stem
    jumps, or where the readings lie further from the stem than their noise.
    """
    if not scatter_matters(evaluator, fitted):
        return None
    likelihood = RecordLikelihood(evaluator)
    at = less_scattered(likelihood, likeliest_of(likelihood, fitted))
    at = less_scattered(likelihood, along_the_ridge(likelihood, at))
    S, J = base_coordinate.S_and_J(at.candidate)
    if too_noisy(evaluator, at) or way_in_a_sample(evaluator.problem) >= J:
        return None
    errors = likelihood.standard_errors(at)
    of_S, of_ratio = errors[base_coordinate.S_PERCENT], errors[base_coordinate.RATIO]
    of_J = np.hypot(of_S * J / S, of_ratio * S)
    normal = np.random.default_rng(7).standard_normal(REPLICATES)
    error = max(MODEL_ERROR * 0.5 * (S + J), LEAST_ERROR)
    return Stiction(
        S=_positive(estimate(S + of_S * normal, S, PERCENT, error)),
        J=_positive(estimate(J + of_J * normal, J, PERCENT, error)),
        by_likelihood=True,
    )


def of_balance(balance: ForceBalance, fitted: Stiction) -> Stiction:
    """S from the force balance, which uses every moving sample; J as it was ``fitted``."""
    error = max(MODEL_ERROR * balance.S, LEAST_ERROR, balance.least_error)
    S = _positive(estimate(balance.S_replicates, balance.S, PERCENT, float(error)))
    if balance.rival_S is not None:
        rival = np.full(REPLICATES, balance.rival_S)
        S = S.holding(_positive(estimate(rival, balance.rival_S, PERCENT, float(error))))
    return replace(fitted, S=S)


def _positive(estimate: Estimate) -> Estimate:
    return replace(estimate, low=max(estimate.low or 0.0, 0.0))
