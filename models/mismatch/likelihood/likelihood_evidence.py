"""How strongly the likelihood of a record speaks for one hypothesis against another: by how much
the record is more likely, over how many of its blocks, and beside the limits of what chance
reaches.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stemwatch.models.mismatch.likelihood.maximum_likelihood import Likeliest

# Least gain of the logarithm of the likelihood by which a term is named, least t of its blocks, and
# least product of the two.
LEAST_GAIN, LEAST_T, LEAST_PRODUCT = 24.0, 1.3, 90.0


@dataclass(frozen=True)
class LikelihoodEvidence:
    """What the likelihood gains by a term: the logarithm of the ratio, and its t over the blocks;
    ``strength`` is how far these are beyond their limits, 1 at the limits."""

    gain: float
    t: float
    strength: float


def evidence_of(rich: Likeliest, simple: Likeliest, rarely: float = 1.0) -> LikelihoodEvidence:
    """How much more likely the record is by ``rich`` than by ``simple``: at the limits, of which
    that of t is ``rarely`` times as high, the strength is 1.
    """
    gained, t = more_likely(rich, simple)
    strength = min(
        gained / LEAST_GAIN, t / (LEAST_T * rarely), gained * t / (LEAST_PRODUCT * rarely)
    )
    return LikelihoodEvidence(gained, t, strength)


def more_likely(one: Likeliest, other: Likeliest) -> tuple[float, float]:
    """By how much one is more likely than another, as a logarithm, and its t over the blocks."""
    by_block = one.by_block - other.by_block
    enough = by_block.size > 2
    error = float(by_block.std(ddof=1) * np.sqrt(by_block.size)) if enough else np.inf
    total = float(by_block.sum())
    return total, total / max(error, 1e-9)
