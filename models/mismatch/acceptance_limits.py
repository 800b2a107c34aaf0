"""How much a term must gain before it is named, and how much may be left unexplained.

No limit was chosen on the seed that the proof reports. Three of them follow from recordings with
nothing hidden: the strength of a named term, that of a pair, and the loss that may be left.
`stemwatch calibrate-mismatch` derives these by one rule and writes them beside the limits in use,
and a test compares the two. The others were chosen by hand on development sets with hidden effects.
"""

from __future__ import annotations

import numpy as np

from stemwatch.models.mismatch.fit.base_coordinate import RATIO, S_PERCENT
from stemwatch.models.mismatch.fit.crossfit import Fitted
from stemwatch.models.mismatch.fit.evaluator import Evaluator
from stemwatch.models.recording import Floats
from stemwatch.models.stickslip.advantage import Advantage

# Least mean log ratio of the losses, least t, and least product of the two.
MEAN, T, PRODUCT = 0.04, 1.4, 0.12
# Play is nearly the same as another S and J, and dwell as a scatter of the breakaways: chance finds
# them more often.
HARDER = {"lost_motion": 1.6, "dwell_dependent_breakaway": 1.9}
# A top speed acts after large fast moves only. What gains much in k blocks and nothing in the rest
# has a t of about sqrt(k), however much it gains: 1.4 for two of twenty blocks, each predicted from
# the other fold. Chance does not imitate it: of 72 valves with nothing hidden none gains more than
# 0.003 by one (`stemwatch calibrate-mismatch`, seed 4000). It multiplies the limits of t and of the
# product.
RARELY_ACTS = {"rate_limit": 0.65, "asymmetric_rate_limit": 0.65}
# A record of few blocks, or of few samples, shows a large t by chance more often: limits grow by
# 1 + FEW_BLOCKS / blocks + FEW_SAMPLES / samples.
FEW_BLOCKS, FEW_SAMPLES = 5.0, 100.0
# Later terms start from a smaller residual, and the search is narrower.
LATER = 0.8
# Share of the limits that a second term must reach beside one that was accepted for its own sake:
# beside the right name of one hidden effect a wrong one of material size reaches 0.67 at most (58
# valves of all kinds of records, `draw_effect`, seeds 4063 and 4065). Play and dwell must reach all
# of it: play came to 0.82 there, and to 0.96 beside two right names.
BESIDE_ANOTHER = 0.75
# What the weaker of two terms that are looked for together must reach beside the other: the search
# chooses among hundreds of pairs.
LEAST_OF_A_PAIR = 1.25
# Share of the limits at which a term is named. A term that comes this near deserves another search
# or a field test.
NEAR = 0.4
NULL_RATE = 0.025
# What is left (``remaining_loss``), from which there may be more than noise and scatter in it: in
# 104 recordings of the blind trial (seeds 5151 and 6161) two effects of which neither was named
# alone were found from 3.5 on.
SOMETHING_LEFT = 2.6
# What is left in the worst tenth of the blocks, in noise variances, from which a recording is not
# explained; a short record has few blocks, and its worst tenth is one of them.
MUCH_LEFT = 9.6
# Less than that is systematic too, where nothing was named at all: 4 of 192 valves with nothing
# hidden leave more (seeds 4000 and 4064).
NOT_LITTLE_LEFT = 7.0
# Where the noise is at least this share of the breakaway level, it covers most of what the scatter
# of the breakaways leaves: of 102 such nulls (seeds 4063 and 4064) the 97th percentile leaves 4.0
# and none more than 5.0.
NOISY, NOT_LITTLE_IN_NOISE = 0.03, 5.0
SMALLEST_LEVEL = 1e-3  # percent
# Where much is left, a term must explain a good part of it; else it only stands in for a missing
# effect.
MEAN_WHERE_MUCH_IS_LEFT = 0.35
# Over a short time many effects look like a straight line through the reading.
MEAN_OF_A_LINE = 1.0


def short_record_factor(counts: Floats) -> float:
    """How much the limits grow for a record with ``counts`` (n_blocks,) scored samples."""
    blocks, samples = max(int(np.count_nonzero(counts)), 1), max(float(counts.sum()), 1.0)
    return 1.0 + FEW_BLOCKS / blocks + FEW_SAMPLES / samples


def strength(advantage: Advantage, counts: Floats, slug: str, stage: int = 0) -> float:
    """How far an advantage lies beyond its limits: 1 at the limits, the least of the three ratios
    (mean, t, and their product)."""
    short = short_record_factor(counts)
    rarely = RARELY_ACTS.get(slug, 1.0)
    ease = (LATER if stage else 1.0) * HARDER.get(slug, 1.0) * rarely
    if advantage.mean <= 0.0 or advantage.t <= 0.0:
        return 0.0
    return min(
        advantage.mean / (MEAN * short),
        advantage.t / (T * rarely * short),
        advantage.mean * advantage.t / (PRODUCT * ease * short * short),
    )


def chance(strongest: float) -> float:
    """The probability that a valve with nothing hidden shows a term of this strength, 0 to 1.

    The share ``NULL_RATE`` of them passes the limits at all. Beyond the limits the tail of the
    strength falls about as one over the strength (three of 120 recordings with nothing hidden, seed
    4010).
    """
    return min(1.0, NULL_RATE / max(strongest, 1e-9))


def convincing(
    advantage: Advantage, counts: Floats, slug: str, stage: int = 0, beside: bool = False
) -> bool:
    """True where the advantage of a term is larger than recordings with nothing hidden show;
    ``beside`` another one that was accepted for its own sake, than those with one effect show.
    """
    least = BESIDE_ANOTHER if beside and slug not in HARDER else 1.0
    return strength(advantage, counts, slug, stage) >= least


def remaining_loss(evaluator: Evaluator, fitted: Fitted) -> float:
    """What a hypothesis leaves in the worst tenth of the blocks of time that it was not fitted to
    (``worst_blocks``); about 2 where only noise and scatter are left.
    """
    return worst_blocks(evaluator, fitted.heldout)


def worst_blocks(evaluator: Evaluator, losses: Floats) -> float:
    """The 90th percentile, over the blocks of time, of the robust ``losses`` (n_blocks,) a sample,
    divided by the variance of the noise and of the uncertainty of OP.
    """
    counts, problem = evaluator.counts, evaluator.problem
    filled = counts > 0
    worst = np.percentile(losses[filled] / counts[filled], 90.0)
    return float(worst / (problem.sigma**2 + problem.op_open**2))


def something_left(evaluator: Evaluator, fitted: Fitted) -> bool:
    """True where more may be left than noise and scatter."""
    return (
        remaining_loss(evaluator, fitted)
        >= SOMETHING_LEFT * short_record_factor(evaluator.measured_counts) ** 2
    )


def much_left(evaluator: Evaluator, fitted: Fitted) -> bool:
    """True where what is left is systematic, and nothing in the hypothesis explains it."""
    return (
        remaining_loss(evaluator, fitted)
        > MUCH_LEFT * short_record_factor(evaluator.measured_counts) ** 2
    )


def not_little_left(evaluator: Evaluator, fitted: Fitted) -> bool:
    """True where too much is left to call the recording explained by S and J alone."""
    limit = NOT_LITTLE_IN_NOISE if noise_share(evaluator, fitted) >= NOISY else NOT_LITTLE_LEFT
    return (
        remaining_loss(evaluator, fitted)
        > limit * short_record_factor(evaluator.measured_counts) ** 2
    )


def noise_share(evaluator: Evaluator, fitted: Fitted) -> float:
    """The noise of the position as a share of the breakaway level ``(S + J)/2``."""
    S, ratio = fitted.candidates.mean(axis=0)[[S_PERCENT, RATIO]]
    return evaluator.problem.sigma / max(0.5 * float(S * (1.0 + ratio)), SMALLEST_LEVEL)
