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


# `study-oscillations --fit 5151,6161,7171,8181 --plants 40 --quiet 80`: the weights by 160 drawn
# plants, `evidence` by the 82 quiet ones of 320 others.
LIMITS = GroupLimits(share=0.1, coherence=0.55, weights=(0.69, 2.27, 0.6, 0.76), evidence=0.04)
# The weight of a verdict from a measured position is set by hand, because the drawn loops have
# none.
WEIGHTS = SourceWeights(
    member=(-0.4, 1.18, -2.7, 3.3, 3.62, 0.7, 3.0, 3.23),
    none=(0.55, 3.92, 1.82, -0.21, -3.0, 2.3, -2.53),
)
