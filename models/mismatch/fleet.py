"""Across a plant: how many of the named effects would chance alone have named."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

LEVEL = 0.05  # of the effects that stand, the share that chance may have named


def stands(p_values: Sequence[float | None], level: float = LEVEL) -> list[bool]:
    """Which of a plant's findings stand at a false discovery rate of ``level``.

    ``p_values`` holds one entry for each valve that was looked at, ``None`` where nothing was
    named (it still counts as looked at). Benjamini and Hochberg (1995): the k smallest stand, where
    k is the largest rank with ``p <= level k / m``.
    """
    m = len(p_values)
    p = np.array([1.0 if one is None else one for one in p_values])
    order = np.argsort(p, kind="stable")
    below = np.flatnonzero(p[order] <= level * np.arange(1, m + 1) / max(m, 1))
    last = float(p[order[below[-1]]]) if below.size else -1.0
    return [one is not None and one <= last for one in p_values]
