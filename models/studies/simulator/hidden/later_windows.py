"""Later windows of the same valve: set points, loads, noise and breakaways drawn anew."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stemwatch.models.studies.simulator.hidden.case import HiddenCase
from stemwatch.models.studies.simulator.hidden.catalogue import with_effect
from stemwatch.models.studies.simulator.hidden.loops import moved_anew


def windows_of(case: HiddenCase, n: int) -> list[HiddenCase]:
    """``n`` windows of one valve, each as long as the case and ``case`` itself the first: the same
    nameplate, controller and hidden effects, with movements and chance of their own. The first k
    do not depend on ``n``."""
    return [
        case if window_number == 0 else _later(case, window_number) for window_number in range(n)
    ]


def _later(case: HiddenCase, window_number: int) -> HiddenCase:
    rng = np.random.default_rng([case.seed, window_number, 7])
    plain = moved_anew(case.plain, rng)
    loop = plain
    for name in case.hidden:
        loop = with_effect(loop, name, case.sizes)
    return replace(case, loop=loop, plain=plain, seed=int(rng.integers(2**31)), excitation={})
