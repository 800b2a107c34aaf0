"""Whether S changed within a recording, once and at once: a repair, a tightened packing.

Each block of time is run by itself from its own reading, so the loss of any S and J over a part of
the record is a sum of block losses. With L(a, b) the least loss over blocks a to b of all S and J
that are tried, beside the fitted lag and zero, S changed after block k where

    (L(1, k) + L(k + 1, n)) / L(1, n)

is lowest, at least a fifth of the blocks on either side (Page 1955, doi:10.2307/2333009, for the
question). It is believed where that is at most ``LEAST_LEFT`` and both S differ enough to matter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stemwatch.models.recording import Floats
from stemwatch.models.stickslip import parameters as coordinate
from stemwatch.models.stickslip.fit import StickSlipFit

# Chosen on 50 simulated valves whose S does not change (`draw_sticky`, seeds 6161 and 7171, and
# `draw_healthy`, 6161), which leave 0.76 and more, and nine that were repaired half way, which
# leave 0.23 at most. Of 56 other valves without a change (7171 and 8181) none leaves so little.
LEAST_LEFT = 0.5
DIFFERENT_PERCENT = 0.75  # of OP
EDGE, FEWEST = 5, 3  # one in so many blocks on either side, and so many at least
WIDTHS = np.linspace(0.0, 1.6, 17)  # times the fitted S
SHARES = np.linspace(0.0, 1.0, 24) ** 1.6  # of the widest S that is possible
RATIOS = (0.0, 0.15, 0.3, 0.6, 1.0)  # J/S


@dataclass(frozen=True)
class ChangeOfStiction:
    """S ``before`` and ``after``, percent of travel, and when it changed, in units of the own clock
    from the first sample that was fitted.
    """

    before: float
    after: float
    at_s: float


def change_of_stiction(fit: StickSlipFit) -> ChangeOfStiction | None:
    """Where S changed within what was fitted; ``None`` where one S describes all of it as well."""
    candidates, problem = _candidates(fit), fit.evaluator.problem
    losses, _ = fit.evaluator.block_losses(candidates)
    edge = max(problem.n_blocks // EDGE, FEWEST)
    if problem.n_blocks < 2 * edge + 1:
        return None
    until = np.cumsum(losses, axis=1)
    from_then = until[:, -1:] - until
    together = until.min(axis=0) + from_then.min(axis=0)
    last = edge - 1 + int(np.argmin(together[edge - 1 : problem.n_blocks - edge]))
    before = float(candidates[int(until[:, last].argmin()), coordinate.S_PERCENT])
    after = float(candidates[int(from_then[:, last].argmin()), coordinate.S_PERCENT])
    left = float(together[last]) / max(float(until[:, -1].min()), 1e-12)
    if left > LEAST_LEFT or abs(before - after) < DIFFERENT_PERCENT:
        return None
    share = (last + 1) / problem.n_blocks
    return ChangeOfStiction(before, after, share * problem.op.size * problem.interval_s)


def _candidates(fit: StickSlipFit) -> Floats:
    """(m, 9) the fitted candidate with other S and J."""
    bounds = fit.evaluator.bounds
    all_widths = np.concatenate((fit.S * WIDTHS, bounds.high[coordinate.S_PERCENT] * SHARES))
    widths, ratios = np.meshgrid(all_widths, np.array(RATIOS), indexing="ij")
    candidates = np.tile(fit.candidate, (widths.size, 1))
    candidates[:, coordinate.S_PERCENT] = widths.ravel()
    candidates[:, coordinate.RATIO] = ratios.ravel()
    return bounds.clip(candidates)
