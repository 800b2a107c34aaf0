"""The loss of candidates on one recording, with the settings that every search on it shares."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stemwatch.models.recording import Bools, Floats
from stemwatch.models.stickslip import parameters as coordinate
from stemwatch.models.stickslip.parameters import Bounds, to_kernel
from stemwatch.models.stickslip.problem import FitProblem
from stemwatch.models.stickslip.search import Loss

# When a moving stem sticks again, %/s of the actuator.
CANONICAL, ALWAYS, ONLY_WHEN_TURNING = 0.0, np.inf, -1e-9


@dataclass(frozen=True)
class StickSlipEvaluator:
    """The problem with the settings that every search on it shares."""

    problem: FitProblem
    bounds: Bounds
    delta: float  # scale of the robust loss, percent
    restick: float  # %/s, see the kernel
    free_gain: bool

    def loss(self, blocks: Bools) -> Loss:
        """The mean robust loss over the chosen blocks as a function of candidates."""

        chosen = replace(self, problem=self.problem.only(blocks))

        def value(candidates: Floats) -> Floats:
            losses, counts = chosen.block_losses(candidates)
            return np.asarray(losses[:, blocks].sum(axis=1) / max(counts[blocks].sum(), 1.0))

        return value

    def block_losses(self, candidates: Floats) -> tuple[Floats, Floats]:
        """Robust losses (m, n_blocks) of candidates (m, 9), and the samples (n_blocks,) in them."""
        return self.problem.losses(to_kernel(candidates, self.restick), self.delta)

    def simulate(self, candidate: Floats, *, resynced: bool = False) -> Floats:
        """(n,) MV in percent of a ``candidate`` (9,) by a free run.

        ``resynced``: reset to the measurement at the start of each block of time, as in the fit.
        """
        q = to_kernel(candidate, self.restick)[0]
        return self.problem.simulate(q, resynced=resynced)

    def spread(self, free: tuple[int, ...], scale: float) -> Floats:
        """(9,) widths of a search over the free coordinates and the reading's own."""
        full = (self.bounds.high - self.bounds.low) * scale
        width = np.zeros(coordinate.N_COORDINATES)
        coordinates = [*free, *coordinate.READING, *((coordinate.GAIN,) if self.free_gain else ())]
        width[coordinates] = full[coordinates]
        return width
