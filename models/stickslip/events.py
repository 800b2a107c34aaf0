"""Stick-slip in the recording without a model: the stem rests, and jumps towards its command.

Breakaways scatter, so the slips of a fitted model may all be a few samples off although the
friction is evident. Jumps from rest are seen without a model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stemwatch.models.recording import Floats
from stemwatch.models.signals.excitation import jumps_from_rest, travel
from stemwatch.models.stickslip import parameters as coordinate
from stemwatch.models.stickslip.problem import FitProblem

# Simulated healthy valves have a share below 0.1 (0 for nearly all); sticking ones whose slips the
# fitted model misses had 0.38 and more.
EVIDENT_SLIPS, EVIDENT_SHARE, EVIDENT_TOWARDS = 5, 0.35, 0.9
# Of the jumps of a stem whose command this is, at this time, 0.98 and more go towards it. So do
# those of 11 of 93 recordings with mixed-up tags (`stemwatch miswiring`, seeds 5151, 7171, 9393),
# but in none of them does the stem rest while its command goes on (``rests``).
OWN_TOWARDS = 0.95


@dataclass(frozen=True)
class SlipEvents:
    """``share`` of the stem's way made in jumps from rest, 0 to 1, and the share of the jumps that
    go ``towards`` the command, which is near 1 for friction and not for another valve's position;
    ``size`` of the jumps, percent of MV (median).
    """

    count: int
    share: float
    towards: float
    size: float = 0.0

    @property
    def evident(self) -> bool:
        """True where the jumps alone show that the stem sticks."""
        return (
            self.count >= EVIDENT_SLIPS
            and self.share >= EVIDENT_SHARE
            and self.towards >= EVIDENT_TOWARDS
        )

    @property
    def of_this_command(self) -> bool:
        """True where the jumps are those of a sticking stem, nearly all towards the command."""
        return self.evident and self.towards >= OWN_TOWARDS


def events_of(problem: FitProblem, candidate: Floats) -> SlipEvents:
    """The slips of a ``problem``, read with gain and zero of a ``candidate`` (9,)."""
    jumps = jumps_from_rest(problem.mv, problem.op, problem.sigma)
    path = travel(problem.mv, max(5.0 * problem.sigma, 0.1))
    share = float(np.abs(jumps.sizes).sum()) / max(path, 1e-9)
    if not jumps.count:
        return SlipEvents(0, 0.0, 0.0)
    gain, zero = 1.0 + candidate[coordinate.GAIN], candidate[coordinate.ZERO]
    force = problem.op[jumps.begins] - (problem.mv[jumps.begins] - zero) / gain
    towards = float(np.mean(np.sign(force) == np.sign(jumps.sizes)))
    size = float(np.median(np.abs(jumps.sizes)))
    return SlipEvents(jumps.count, min(share, 1.0), towards, size)
