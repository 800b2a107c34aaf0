"""The slips of a fit, and another fit where the slips show it: a run that misses single slips, or
has them early or late by chance, may have the least loss with another S and J than those of the
slips.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from stemwatch.models.recording import Bools, Floats
from stemwatch.models.stickslip import parameters as coordinate
from stemwatch.models.stickslip.breakaways import (
    LEAST_J,
    SLOW_SAMPLES,
    Breakaways,
    breakaways,
    seen_breakaways,
)
from stemwatch.models.stickslip.evaluator import StickSlipEvaluator
from stemwatch.models.stickslip.events import events_of
from stemwatch.models.stickslip.hypotheses import polish
from stemwatch.models.stickslip.parameters import S_and_J
from stemwatch.models.stickslip.search import SearchResult

# Loss of a search that began at the S and J of the slips, as a share of the fit's, up to which the
# slips decide which of the two is right.
AS_GOOD = 1.1
LESS = np.linspace(1.0, 0.0, 21)  # shares by which a jump is tried smaller, none at last
NO_WORSE = 1.01  # times the loss of the fit, up to which another is as good


class Chosen(NamedTuple):
    """The hypothesis that is published, fitted to the whole record; its ``slips``, and slips that
    are seen although it needs none.
    """

    hypothesis: str
    fitted: SearchResult
    slips: Breakaways | None
    unneeded: Breakaways | None = None


def with_slips(
    evaluator: StickSlipEvaluator,
    all_blocks: Bools,
    hypothesis: str,
    final: SearchResult,
    naive: SearchResult,
) -> Chosen:
    """The slips of the ``final`` fit of ``hypothesis``; another fit where the slips show it.

    ``naive`` is that of S and J alone.
    """
    slips = slips_of(evaluator, final.candidate)
    if S_and_J(final.candidate)[1] < LEAST_J:
        slips_of_jumps = _breakaways_of_jumps(evaluator, naive.candidate)
        if slips_of_jumps is not None:
            return Chosen("sticking", naive, slips_of_jumps)
    if slips is None and hypothesis == "sticking":
        return Chosen(hypothesis, *_begun_at_slips(evaluator, all_blocks, final))
    return Chosen(hypothesis, final, slips)


def _begun_at_slips(
    evaluator: StickSlipEvaluator, blocks: Bools, fitted: SearchResult
) -> tuple[SearchResult, Breakaways | None, Breakaways | None]:
    """The fit of a search that begins at the S and J of the slips, with these, where their level is
    not the ``fitted`` one and this fit is about as good; else ``fitted``, and the slips that it
    does not need where it has no jump.

    Where a slip comes some samples late or early by chance, a run with another S and J may have the
    least loss, or the search may end there: the slips do not depend on a run.
    """
    S, J = S_and_J(fitted.candidate)
    gain, zero = 1.0 + float(fitted.candidate[coordinate.GAIN]), fitted.candidate[coordinate.ZERO]
    if gain == 0.0:
        return fitted, None, None
    seen = seen_breakaways(evaluator.problem, gain, zero, max(J, LEAST_J))
    if seen is None and J >= LEAST_J:
        # A fitted jump larger than all that are seen leaves none of them.
        size = events_of(evaluator.problem, fitted.candidate).size / abs(gain)
        if LEAST_J <= size < J:
            seen = seen_breakaways(evaluator.problem, gain, zero, size)
    if seen is None or (J >= LEAST_J and seen.near(0.5 * (S + J))):
        return fitted, None, None
    start = fitted.candidate.copy()
    start[list(coordinate.STICKING)] = seen.S, seen.J / max(seen.S, 1e-9)
    other = polish(evaluator, blocks, evaluator.bounds.clip(start), "sticking")
    slips = slips_of(evaluator, other.candidate)
    if slips is not None and other.loss <= AS_GOOD * fitted.loss:
        return other, slips, None
    return fitted, None, seen if J < LEAST_J and seen.near(0.5 * (S + J)) else None


def slips_of(evaluator: StickSlipEvaluator, candidate: Floats) -> Breakaways | None:
    """The slips of the recording, read as a candidate (9,) does; ``None`` where they are few."""
    gain, zero = 1.0 + float(candidate[coordinate.GAIN]), float(candidate[coordinate.ZERO])
    if gain == 0.0:
        return None
    S, J = S_and_J(candidate)
    without_friction = candidate.copy()
    without_friction[list(coordinate.STICKING)] = 0.0
    unhindered = evaluator.simulate(without_friction)
    return breakaways(evaluator.problem, gain, zero, S, J, _late_s(candidate), unhindered)


def _breakaways_of_jumps(evaluator: StickSlipEvaluator, candidate: Floats) -> Breakaways | None:
    """The breakaways where the stem is seen to rest and jump although the best fit has no jump:
    where it slips every few minutes only, a run that misses some slips has the least loss without
    any.
    """
    events = events_of(evaluator.problem, candidate)
    gain, zero = 1.0 + float(candidate[coordinate.GAIN]), float(candidate[coordinate.ZERO])
    if not events.evident or gain == 0.0:
        return None
    S, J = S_and_J(candidate)[0], events.size / abs(gain)
    return breakaways(evaluator.problem, gain, zero, S, J)


def least_jump(evaluator: StickSlipEvaluator, fitted: SearchResult) -> SearchResult:
    """The smallest S and J with the same dead band S - J that are as good as the ``fitted`` ones:
    a step moves the stem as far whatever smaller breakaway level it has exceeded.
    """
    S, J = S_and_J(fitted.candidate)
    jumps = J - min(S, J) * LESS
    candidates = np.tile(fitted.candidate, (jumps.size, 1))
    widths = S - J + jumps
    candidates[:, coordinate.S_PERCENT] = widths
    candidates[:, coordinate.RATIO] = jumps / np.maximum(widths, 1e-9)
    candidates = evaluator.bounds.clip(candidates)
    losses, counts = evaluator.block_losses(candidates)
    means = losses.sum(axis=1) / max(counts.sum(), 1.0)
    best = int(np.flatnonzero(means <= NO_WORSE * means[-1])[0])
    return SearchResult(candidates[best], float(means[best]))


def is_late(evaluator: StickSlipEvaluator, fitted: SearchResult) -> bool:
    """Whether the fitted dead time and lag add up to a sample or more."""
    return _late_s(fitted.candidate) >= SLOW_SAMPLES * evaluator.problem.interval_s


def _late_s(candidate: Floats) -> float:
    """The dead time and the mean lag of a candidate (9,), in the recording's unit of time."""
    lag_s = 0.5 * (candidate[coordinate.LAG_UP_S] + candidate[coordinate.LAG_DOWN_S])
    return float(candidate[coordinate.DEAD_TIME_S] + lag_s)
