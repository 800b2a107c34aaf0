"""Limits of a common oscillation, and weights of the evidence for a source.

``stemwatch study-oscillations --fit`` prints the numbers from drawn plants.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class GroupLimits:
    """``share`` of a loop's variance that a member has in common with the others, and ``coherence``
    with them in the band. ``pair_share`` is what the weaker of two loops must have that are a group
    by themselves: a share of a tenth is known to a third, and with less only half of such pairs are
    groups.

    ``weights`` of the evidence for a group (constant, ln of the largest share, ln of the largest
    regularity, ln of the largest product of a loop's odds of sticking by OP and PV and its share),
    a logit; ``evidence``, the logit that travelling loads alone reach in at most one quiet plant of
    twenty, with a certainty of 95 %. ``by_chance`` is the number of groups as coherent as one that
    may be expected among unrelated loops.
    """

    share: float
    coherence: float
    pair_share: float
    weights: tuple[float, float, float, float]
    evidence: float
    by_chance: float


@dataclass(frozen=True, kw_only=True)
class SourceWeights:
    """Weights of a member's evidence above the group's mean, and of "none of these": constant, log
    of the members, largest harmonics of PV, largest log odds of sticking by OP and PV, verdict,
    and, where connections are known, a constant and the largest nearness."""

    member: tuple[float, ...]
    none: tuple[float, ...]


# `study-oscillations --plants 40 --quiet 120 --fit` with the seeds in docs/oscillation-groups.md
# prints the weights, by 400 drawn plants, and `evidence`, by the 365 quiet ones of 1,200 others.
LIMITS = GroupLimits(
    share=0.1,
    coherence=0.55,
    pair_share=0.13,
    weights=(1.6, 2.11, 0.64, 0.85),
    evidence=-0.36,
    by_chance=0.05,
)
# The weight of a verdict from a measured position is set by hand, because the drawn loops have
# none.
WEIGHTS = SourceWeights(
    member=(0.23, 0.99, -4.2, 4.43, 3.01, 0.8, 3.0, 4.71),
    none=(1.25, 4.25, 2.24, -0.33, -3.0, 3.42, -3.72),
)
