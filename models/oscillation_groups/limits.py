"""Limits of a common oscillation, and weights of the evidence for a source.

``stemwatch study-oscillations --fit`` prints the numbers from drawn plants.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class GroupLimits:
    """``share`` of a loop's variance that a member has in common with the others, and ``coherence``
    with them in the band.

    ``weights`` of the evidence for a group (constant, ln of the largest share, ln of the largest
    regularity, the largest log odds of sticking by OP and PV), a logit; ``evidence``, the logit
    that chance alone reaches in at most one quiet plant of twenty, with a certainty of 95 %.
    """

    share: float
    coherence: float
    weights: tuple[float, float, float, float]
    evidence: float


@dataclass(frozen=True, kw_only=True)
class SourceWeights:
    """Weights of a member's evidence above the group's mean, and of "none of these": constant, log
    of the members, largest harmonics of PV, largest log odds of sticking by OP and PV, verdict,
    and, where connections are known, a constant and the largest nearness."""

    member: tuple[float, ...]
    none: tuple[float, ...]


# `study-oscillations --fit 5151,6161,7171,8181 --plants 40 --quiet 130`: the weights by 160 drawn
# plants, `evidence` by the 135 quiet ones of 520 others.
LIMITS = GroupLimits(share=0.11, coherence=0.55, weights=(1.21, 2.18, 0.58, 0.9), evidence=0.06)
# The weight of a verdict from a measured position is set by hand, because the drawn loops have
# none.
WEIGHTS = SourceWeights(
    member=(0.03, 0.69, -2.78, 3.07, 3.23, 0.69, 3.0, 3.04),
    none=(-0.04, 3.59, 1.51, -0.07, -3.0, 2.4, -2.68),
)
