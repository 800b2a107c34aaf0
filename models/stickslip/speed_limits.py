"""Top speeds of the stem that a recording shows: only where the command went faster."""

from __future__ import annotations

import numpy as np

from stemwatch.models.stickslip import parameters as coordinate
from stemwatch.models.stickslip.fit import StickSlipFit

FASTER = 1.5  # the command must be so many times faster than the limit ...
FEWEST = 5  # ... in at least so many samples ...
LEAST_SHARE = 0.005  # ... and in this share of all


def shown_speed_limits(fit: StickSlipFit) -> dict[str, float]:
    """Top speed of the position, percent per second, by direction ("rising", "falling").

    Only where the command went clearly faster often enough: a limit shows in nothing else, and the
    smear of a slip between two samples would be taken for one.
    """
    problem = fit.evaluator.problem
    speed = np.diff(problem.op) / problem.interval_s
    speeds: dict[str, float] = {}
    for name, sign, mask in (
        ("rising", 1.0, coordinate.SLOW_UP),
        ("falling", -1.0, coordinate.SLOW_DOWN),
    ):
        slow = float(fit.candidate[mask])
        if slow <= 0.0:
            continue
        faster_samples = int(np.sum(sign * speed > FASTER / slow))
        if faster_samples >= max(FEWEST, LEAST_SHARE * speed.size):
            speeds[name] = 1.0 / slow
    return speeds
