"""The block bootstrap: how much an estimate would vary had other blocks of time been recorded.

Neighbouring residuals depend on one another, so blocks of time are drawn with replacement and not
samples (Kuensch 1989, doi:10.1214/aos/1176347265). No replicate is fitted anew: a cloud of
candidates is simulated once, its losses are kept by block, and the estimate of a replicate is the
candidate that is cheapest under that replicate's weights. One matrix product serves all replicates.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.recording import Floats

COVERAGE = (2.5, 97.5)  # percentiles of a 95 % interval
_TIE = 1e-9  # of the mean loss: ties between equal candidates are broken at random


def block_weights(counts: NDArray[Any], replicates: int, rng: np.random.Generator) -> Floats:
    """(replicates, b) how often each block is drawn, as floats.

    ``counts`` (b,) are the samples in each block; a block without any is never drawn, and each of
    the others is as likely as the next. A row sums to the number of blocks that hold samples.
    """
    filled = np.flatnonzero(counts > 0)
    weights = np.zeros((replicates, counts.size))
    share = np.full(filled.size, 1.0 / filled.size)
    weights[:, filled] = rng.multinomial(filled.size, share, size=replicates)
    return weights


def cheapest(
    candidates: Floats, losses: Floats, weights: Floats, rng: np.random.Generator
) -> Floats:
    """(replicates, k) the candidate with the least loss in each replicate.

    ``candidates`` (m, k), their ``losses`` by block (m, b), ``weights`` (replicates, b) as
    ``block_weights`` draws them. Candidates whose slips all fall on the same samples have equal
    losses; one of them is taken at random.
    """
    totals = weights @ losses.T
    totals += _TIE * totals.mean() * rng.random(totals.shape)
    return np.asarray(candidates[np.argmin(totals, axis=1)])
