"""Whether several recordings of one loop raise the suspicion of sticking, taken together.

The statistic is the mean of the log odds ln(p/(1 - p)) of the scores p in the better half of the
recordings (of three the better two), and its limit is that of one recording. The better half,
because a stem shows that it sticks only where the loop moves it enough: a recording without a sign
says less than one with. Not the best alone, because among many recordings of a sound valve one
looks like sticking by chance. ``stemwatch study-without-position`` counts both.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stemwatch.models.without_position.no_sign import logit
from stemwatch.models.without_position.suspicion import (
    Suspicion,
    WithoutPosition,
    trained_judge,
)


def suspected_together(answers: Sequence[WithoutPosition]) -> bool:
    """Whether ``answers``, of recordings of one loop, raise the suspicion of sticking together: one
    of them does, and the better half of the scores bears it out. Recordings without a score do not
    count. One that is suspected counts with the limit at least, since an answer of an earlier
    program had another limit.
    """
    limit = trained_judge().limits.suspected_from
    scores = [
        max(answer.score or 0.0, limit if answer.verdict is Suspicion.SUSPECTED else 0.0)
        for answer in answers
        if answer.verdict is Suspicion.SUSPECTED or answer.score is not None
    ]
    is_any = any(answer.verdict is Suspicion.SUSPECTED for answer in answers)
    return is_any and log_odds_together(scores) >= float(logit(limit))


def log_odds_together(scores: Sequence[float]) -> float:
    """The mean of the log odds in the better half of ``scores`` (0 to 1); there is at least one."""
    falling = np.sort(np.asarray(scores, dtype=np.float64))[::-1]
    return float(np.mean(logit(falling[: (falling.size + 1) // 2])))
