"""Whether several recordings of one loop raise the suspicion of sticking, taken together.

The statistic is the mean of the log odds ln(p/(1 - p)) of the scores p in the better half of the
recordings (of three the better two), and its limit is that of one recording. The better half,
because a stem shows that it sticks only where the loop moves it enough: a recording without a sign
says less than one with. Not the best alone, because among many recordings of a sound valve one
looks like sticking by chance. ``stemwatch study-without-position`` counts both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import expit

from stemwatch.models.estimate import Estimate
from stemwatch.models.without_position.no_sign import logit
from stemwatch.models.without_position.suspicion import (
    Suspicion,
    WithoutPosition,
    trained_judge,
)

# Recordings of a loop that count with its newest. More gain little, and a valve that begins to
# stick would have to do so for longer before its recordings bear it out.
LAST_THAT_COUNT = 8


def suspected_together(answers: Sequence[WithoutPosition]) -> bool:
    """Whether ``answers``, of recordings of one loop, raise the suspicion of sticking together: one
    of them does, and the better half of the scores bears it out. Recordings without a score do not
    count. One that is suspected counts with the limit at least, since an answer of an earlier
    program had another limit.
    """
    limit = float(logit(trained_judge().limits.suspected_from))
    return bool(_suspicions(answers)) and log_odds_together(_scores(answers)) >= limit


def log_odds_together(scores: Sequence[float]) -> float:
    """The mean of the log odds in the better half of ``scores`` (0 to 1); there is at least one."""
    falling = np.sort(np.asarray(scores, dtype=np.float64))[::-1]
    return float(np.mean(logit(falling[: (falling.size + 1) // 2])))


def of_loop(newest: WithoutPosition, earlier: Sequence[WithoutPosition]) -> WithoutPosition:
    """The answer by the ``newest`` recording of a loop and by ``earlier`` ones, of which the last
    come first and ``LAST_THAT_COUNT`` count with the newest.

    Where none of them looks like sticking it is that of the newest. Otherwise sticking is suspected
    if all together bear it out, and if they do not, nothing can be told.
    """
    by_itself = [newest, *(answer.alone or answer for answer in earlier)][:LAST_THAT_COUNT]
    suspicions = _suspicions(by_itself)
    if not suspicions or len(by_itself) == 1:
        return newest
    if suspected_together(by_itself):
        together = _borne_out(by_itself, len(suspicions))
    elif newest.score is None and newest.verdict is Suspicion.CANNOT_TELL:
        together = newest  # with a reason of its own, which says what to mend
    else:
        together = not_borne_out(suspicions[0], len(suspicions), len(by_itself))
    return replace(
        together,
        score=float(expit(log_odds_together(_scores(by_itself)))),
        likeness=newest.likeness,
        traces=newest.traces,
        recordings=len(by_itself),
        alone=replace(newest, traces=None),
    )


def not_borne_out(suspicion: WithoutPosition, alike: int, recordings: int) -> WithoutPosition:
    """A ``suspicion`` that a loop's ``recordings``, ``alike`` of which look like sticking, do not
    bear out together: nothing can be told by it."""
    reason = (
        f"OP and PV cannot tell whether the valve sticks: {_look_alike(alike, recordings)}, and "
        "the others do not bear it out."
    )
    return WithoutPosition(
        verdict=Suspicion.CANNOT_TELL,
        reason=reason,
        advice=suspicion.advice,
        score=suspicion.score,
        apparent_S=Estimate.unknown(
            "the recordings together do not bear it out", unit=suspicion.apparent_S.unit
        ),
    )


def clearest(answers: Sequence[WithoutPosition]) -> int | None:
    """Which of ``answers``, the newest first, shows best that the valve may stick: the newest if it
    is suspected, else the suspicion with the highest score; ``None`` where none is suspected."""
    by_itself = [answer.alone or answer for answer in answers]
    suspected = [k for k, one in enumerate(by_itself) if one.verdict is Suspicion.SUSPECTED]
    if not suspected or suspected[0] == 0:
        return suspected[0] if suspected else None
    return max(suspected, key=lambda k: by_itself[k].score or 0.0)


def _borne_out(by_itself: Sequence[WithoutPosition], alike: int) -> WithoutPosition:
    """The clearest suspicion of answers, the newest first, ``alike`` of which look like sticking,
    with the words that all bear it out."""
    borne_out = f"{_look_alike(alike, len(by_itself))}, and together they bear it out"
    newest, shown = by_itself[0], clearest(by_itself)
    if not shown:
        return replace(newest, reason=f"{newest.reason} Taken with earlier ones: {borne_out}.")
    suspicion = by_itself[shown]
    reason = (
        f"Sticking is suspected from earlier recordings: {borne_out}.{_how_far(suspicion)} By "
        f"itself this is no verdict. The newest recording alone: {newest.reason}"
    )
    return replace(suspicion, reason=reason)


def _how_far(suspicion: WithoutPosition) -> str:
    """By how much the valve sticks in the clearest recording; empty where that is not known."""
    S = suspicion.apparent_S
    if S.value is None:
        return ""
    between = "" if S.low is None or S.high is None else f" ({S.low:.1f} to {S.high:.1f})"
    return f" In the clearest it sticks by about {S.value:.1f} {S.unit} of OP{between}."


def _look_alike(alike: int, recordings: int) -> str:
    """How many of the ``recordings`` of a valve look like sticking."""
    looks = "looks" if alike == 1 else "look"
    return f"{alike} of its {recordings} recordings {looks} like sticking"


def _suspicions(answers: Sequence[WithoutPosition]) -> list[WithoutPosition]:
    return [answer for answer in answers if answer.verdict is Suspicion.SUSPECTED]


def _scores(answers: Sequence[WithoutPosition]) -> list[float]:
    """The scores that count."""
    limit = trained_judge().limits.suspected_from
    return [
        max(answer.score or 0.0, limit if answer.verdict is Suspicion.SUSPECTED else 0.0)
        for answer in answers
        if answer.verdict is Suspicion.SUSPECTED or answer.score is not None
    ]
