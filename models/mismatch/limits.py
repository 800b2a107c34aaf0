"""How much a term must gain before it is named, and how much may be left unexplained.

All limits come from recordings with nothing hidden (`stemwatch calibrate-mismatch`), never from
those that the proof reports.
"""

from __future__ import annotations

import numpy as np

from stemwatch.models.mismatch.bench import Bench
from stemwatch.models.mismatch.crossfit import Fitted
from stemwatch.models.stickslip.fit import Advantage

# Least mean log ratio of the losses, least t, and least product of the two.
MEAN, T, PRODUCT = 0.04, 1.4, 0.12
# A record of few blocks shows a large t by chance more often: t must grow by 1 + FEW / blocks.
FEW = 5.0
# Later terms stand on what the first has cleared away, and the search is narrower.
LATER = 0.8
# What is left in the worst tenth of the blocks, in noise variances, from which a recording is not
# explained; a short record has few blocks, and its worst tenth is one of them.
MUCH_LEFT = 12.0
# Where much is left, a term must explain a good part of it to be more than its accomplice.
MEAN_WHERE_MUCH_IS_LEFT = 0.35


def convincing(advantage: Advantage, blocks: int, stage: int = 0) -> bool:
    """True where an advantage is beyond what recordings with nothing hidden show."""
    short = 1.0 + FEW / max(blocks, 1)
    ease = LATER if stage else 1.0
    return (
        advantage.mean >= MEAN * ease * short
        and advantage.t >= T * short
        and advantage.mean * advantage.t >= PRODUCT * ease * short * short
    )


def left(bench: Bench, fitted: Fitted) -> float:
    """What a hypothesis leaves in the worst tenth of the blocks of time: the held-out robust loss
    over the noise variance, its 90th percentile; about 2 where only noise and scatter are left."""
    counts = bench.counts
    filled = counts > 0
    worst = np.percentile(fitted.heldout[filled] / counts[filled], 90.0)
    return float(worst / bench.problem.sigma**2)


def much_left(bench: Bench, fitted: Fitted) -> bool:
    """True where what is left is systematic, and nothing in the hypothesis explains it."""
    few = 1.0 + FEW / max(int(np.count_nonzero(bench.counts)), 1)
    return left(bench, fitted) > MUCH_LEFT * few * few
