"""Control of false discoveries across a plant: which named effects stand after many valves."""

from __future__ import annotations

from collections.abc import Sequence

LEVEL = 0.05  # accepted share of false discoveries among the effects that stand


def significant(p_values: Sequence[float | None], level: float = LEVEL) -> list[bool]:
    """Which of a plant's findings stand at a false discovery rate of ``level``.

    ``p_values`` holds one entry for each valve that was looked at, ``None`` where nothing was
    named: it still counts as tested, with p = 1, and never stands. A finding stands where its
    adjusted p value is at most ``level``: for the k-th smallest of m, ``min(p_j m / j)`` over all j
    >= k. Benjamini and Hochberg (1995), doi:10.1111/j.2517-6161.1995.tb02031.x.
    """
    if all(p_value is None for p_value in p_values):
        return [False] * len(p_values)
    from scipy.stats import false_discovery_control  # a second to import; seldom needed

    adjusted = false_discovery_control(
        [1.0 if p_value is None else p_value for p_value in p_values]
    )
    return [
        p_value is not None and bool(rate <= level)
        for p_value, rate in zip(p_values, adjusted, strict=True)
    ]
