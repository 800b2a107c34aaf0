"""How large an S would have shown, where OP and PV show no sign of sticking.

Of loops that stick by S, nine of ten have a score above that with

    logit = level + by_swings ln(n/8) + by_range ln(R/A) + by_S ln(min(S, A)/A)
            + beyond ln(max(S, A)/A) + by_amplitude ln(min(A, 8 %)/8 %)

n is the number of swings of the loop in its record (16 and more count as 16), A the amplitude of
OP and R its range, of which S can hardly be more. A counts by itself, because the score asks for
more than the S of a sound stem, in percent. The six numbers are a quantile regression
(Koenker and Bassett 1978, doi:10.2307/1913643) on simulated loops. Solved for S at the score that a
loop has, it is the S that would have shown.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stemwatch.models.recording import Floats

USUAL_SWINGS, MOST_SWINGS = 8.0, 16.0
# S over the amplitude of OP: a stem that sticks by less moves OP as a sound one may
LEAST_SHARE = 0.15
WIDEST_PERCENT = 8.0  # amplitude of OP from which it no longer counts by itself
# What a user is told: of loops by another hand than those that give the limit, fewer than nine of
# ten score above it (tests/benchmarks/bench_other_loops.py).
MOSTLY = "in four cases of five"
_LEAST_ODDS = 1e-6


@dataclass(frozen=True)
class NoSignLimit:
    """The six numbers of the module's formula."""

    level: float
    by_swings: float
    by_range: float
    by_S: float
    beyond: float
    by_amplitude: float

    def shows_from(
        self,
        score: float,
        swings: float,
        range_share: float,
        amplitude: float = WIDEST_PERCENT,
    ) -> float | None:
        """The least S, as a share of OP's amplitude, of which and of any larger one nine of ten
        score above ``score`` (0 to 1); ``None`` where that is true of no S up to the amplitude.

        ``range_share`` is R/A, ``amplitude`` A in percent.
        """
        weights = np.array(
            [
                self.level,
                self.by_swings,
                self.by_range,
                self.by_S,
                self.beyond,
                self.by_amplitude,
            ]
        )
        reached = float(logit(score))
        shares = np.array([1.0, max(range_share, 1.0)])
        rows = columns(shares, np.full(2, swings), shares[[1, 1]], np.full(2, amplitude))
        at_amplitude, at_range = rows @ weights
        if self.by_S <= 0.0 or reached > min(at_amplitude, at_range):
            return None
        return max(float(np.exp((reached - at_amplitude) / self.by_S)), LEAST_SHARE)


def columns(S_share: Floats, swings: Floats, range_share: Floats, amplitude: Floats) -> Floats:
    """(n, 6) what the six numbers multiply, for loops of S/A ``S_share``, ``swings``, R/A
    ``range_share`` and A ``amplitude`` in percent (n,) each."""
    log_S = np.log(np.maximum(S_share, LEAST_SHARE))
    return np.column_stack(
        [
            np.ones(log_S.size),
            np.log(np.minimum(swings, MOST_SWINGS) / USUAL_SWINGS),
            np.log(np.maximum(range_share, 1.0)),
            np.minimum(log_S, 0.0),
            np.maximum(log_S, 0.0),
            np.log(np.minimum(amplitude, WIDEST_PERCENT) / WIDEST_PERCENT),
        ]
    )


def logit(score: float | Floats) -> Floats:
    """ln(score/(1 - score)), finite at 0 and 1."""
    held = np.clip(score, _LEAST_ODDS, 1.0 - _LEAST_ODDS)
    return np.asarray(np.log(held / (1.0 - held)))
