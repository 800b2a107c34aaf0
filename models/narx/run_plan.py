"""At which samples a free run starts, goes on and restarts: one plan for running and training."""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.recording import Bools

Plan = NDArray[np.uint8]
Indices = NDArray[np.int64]
SEEDS = 2  # a run needs y(t-1) and y(t-2)


class PlanStep(IntEnum):
    """What a run does at one sample."""

    SKIP = 0  # unusable: no run here
    SEED = 1  # take the measurement; not scored
    RUN = 2  # simulate from what was simulated
    RESTART = 3  # simulate from the two measurements before


CODES = (int(PlanStep.SEED), int(PlanStep.RUN), int(PlanStep.RESTART))


def plan_run(usable: Bools, horizon: int | None = None, cuts: tuple[int, ...] = ()) -> Plan:
    """(n,) ``PlanStep`` of each sample: two seeds after each gap, a restart after each ``horizon``.

    At each index in ``cuts`` the run starts afresh too, as if there were a gap of no length.
    """
    if horizon is not None and horizon < 1:
        raise ValueError(f"horizon: at least 1 sample expected, received {horizon}")
    age = _age(usable, cuts)
    plan = np.where(age < SEEDS, PlanStep.SEED, PlanStep.RUN)
    if horizon is not None:
        plan[(age >= SEEDS) & ((age - SEEDS) % horizon == 0)] = PlanStep.RESTART
    plan[~usable] = PlanStep.SKIP
    return plan.astype(np.uint8)


def segments(usable: Bools, horizon: int) -> tuple[Indices, Indices]:
    """First simulated sample and length (at most ``horizon``) of each piece of free run."""
    plan = plan_run(usable, horizon)
    starts = np.flatnonzero(plan == PlanStep.RESTART)
    simulated = np.concatenate([plan >= PlanStep.RUN, [False]])
    ends = np.flatnonzero(~simulated)
    run_ends = ends[np.searchsorted(ends, starts)]
    return starts, np.minimum(horizon, run_ends - starts)


def _age(usable: Bools, cuts: tuple[int, ...]) -> Indices:
    """(n,) samples since the run a sample belongs to began."""
    index = np.arange(usable.size)
    begins = usable & ~np.concatenate([[False], usable[:-1]])
    begins[[cut for cut in cuts if 0 <= cut < usable.size]] = True
    return np.asarray(index - np.maximum.accumulate(np.where(begins, index, 0)), dtype=np.int64)
