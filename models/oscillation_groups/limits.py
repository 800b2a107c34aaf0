"""What counts as an oscillation, as having it in common, and what speaks for a source."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class GroupLimits:
    """``regularity`` of zero crossings (1 is the usual limit for one loop by itself),
    ``prominence`` over the background, ``share`` of a loop's variance, ``coherence`` with the group
    in its band."""

    regularity: float
    prominence: float
    share: float
    coherence: float


@dataclass(frozen=True, kw_only=True)
class SourceWeights:
    """Weights of a member's evidence above the group's mean, and of "none of these": constant, log
    of the members, largest harmonics of PV, non-linearity and verdict."""

    member: tuple[float, ...]
    none: tuple[float, ...]


# Chosen on drawn plants (seeds 5151, 6161): one of 23 without a source has a group. What one loop
# alone reaches by chance is printed by `stemwatch study-oscillations`.
LIMITS = GroupLimits(regularity=2.0, prominence=3.0, share=0.1, coherence=0.8)
# Multinomial logit over the groups of 160 drawn plants (seeds 5151, 6161, 7171, 8181). What a
# verdict from a measured position weighs is set by hand: the drawn loops have none. The lead has no
# weight yet.
WEIGHTS = SourceWeights(
    member=(0.93, 1.19, -2.51, 3.80, 0.0, 0.45, 3.0),
    none=(1.25, 3.85, 1.79, -0.26, -3.0),
)
