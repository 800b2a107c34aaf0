"""A stem that something outside shakes: it lets go in time with a swing that its command does not
have.

A pulsating flow, a pump or supply air that swings pushes on the stem. That moves a sticking stem
hardly at all, but decides when it lets go: on the way up at one phase of the swing, on the way down
half a swing later. Single breakaways then come early or late as if they scattered, and noise and
archives hide the rest. The times at which they come do not hide. With breakaways at ``t_k`` to the
side ``w_k`` (1 rising, -1 falling, less their mean), the power

    P(f) = |sum of w_k exp(2 pi i f t_k)|^2 / (sum of w_k^2)

of breakaways that know nothing of ``f`` is exponential with mean 1 (Rayleigh's test, Schuster 1898,
doi:10.1029/TM003i001p00013). A loop that oscillates times its breakaways too. But then OP has the
swing, and the model keeps the same time in a free run: its share of all the power there could be is
no less than that of the recorded stem. And a stem that is seen through coarse steps, or that sticks
again on one move, goes on at even intervals; so the breakaways after longer rests must keep time as
well.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stemwatch.models.mismatch.fit.base_coordinate import RATIO, S_PERCENT
from stemwatch.models.mismatch.fit.base_fit import naive_evaluator
from stemwatch.models.mismatch.fit.crossfit import Fitted
from stemwatch.models.mismatch.fit.evaluator import Evaluator
from stemwatch.models.recording import Floats
from stemwatch.models.stickslip.onsets import Samples

SLOWEST, QUICKEST = 0.02, 0.45  # cycles a sample
STEP = 0.4  # of one over the length of the record, by which neighbouring frequencies differ
FEWEST = 16  # breakaways
# Chance exceeds it once in 700 hours at 1 s. Of 240 simulated valves with nothing hidden (seeds
# 4063 and 4064) seven reach 16, and of 54 healthy and sticking ones (`draw_healthy`, `draw_sticky`,
# seed 5151) seven, all in a loop that oscillates.
LEAST_POWER = 14.0
RESTED, LEAST_OF_RESTED = 1.5, 8.0  # swings from the breakaway before; power of those
MOST_OF_MODEL = 1.0 / 6.0  # of the share of all power that the recorded stem has
MOST_OF_OP = 0.2  # of the breakaway level: amplitude of a swing in OP that times no breakaways
MOVES, RESTS = 1e-6, 2  # percent in a sample; samples
TINY = 1e-12  # a sum of squares that is none


@dataclass(frozen=True)
class Shaking:
    """A swing of ``period`` samples, and the ``power`` by which the breakaways keep time with
    it."""

    period: float
    power: float


def find_shaking(evaluator: Evaluator, fitted: Fitted) -> Shaking | None:
    """The swing in time with which the recorded stem lets go and the model of ``fitted`` does not;
    ``None`` where there is none, or with too few breakaways."""
    at, side = evaluator.onsets.at, evaluator.onsets.side.astype(np.float64)
    if at.size < FEWEST:
        return None
    frequencies, powers = spectrum(at, side, evaluator.problem.op.size)
    best = int(np.argmax(powers))
    frequency, highest = float(frequencies[best]), float(powers[best])
    if highest < LEAST_POWER:
        return None
    rested = np.diff(at, prepend=-at[-1]) * frequency > RESTED
    if power(at[rested], side[rested], frequency) < LEAST_OF_RESTED:
        return None
    if _oscillates(evaluator, fitted, frequency, highest / at.size):
        return None
    return Shaking(period=1.0 / frequency, power=highest)


def _oscillates(evaluator: Evaluator, fitted: Fitted, frequency: float, share: float) -> bool:
    """Whether the loop itself swings at ``frequency``, so that the model of ``fitted`` or OP do;
    ``share`` of all the power there could be is that of the recorded stem."""
    at, side = _of_the_model(evaluator, fitted)
    own_share = power(at, side, frequency) / max(at.size, 1)
    if own_share > MOST_OF_MODEL * share:
        return True
    S, ratio = fitted.candidates.mean(axis=0)[[S_PERCENT, RATIO]]
    level = 0.5 * float(S * (1.0 + ratio))
    return _amplitude(evaluator.problem.op, frequency) > MOST_OF_OP * level


def spectrum(at: Samples, side: Floats, samples: int) -> tuple[Floats, Floats]:
    """(m,) frequencies, cycles a sample, and (m,) the power at each of events ``at`` (k,) to
    ``side`` (k,) in a record of so many ``samples``; 0 where all are to one side."""
    weight = side - side.mean()
    train = np.bincount(at, weight, minlength=samples)
    length = int(samples / STEP)
    first, last = int(SLOWEST * length), int(QUICKEST * length)
    sums = np.fft.rfft(train, length)[first:last]
    return np.arange(first, last) / length, np.abs(sums) ** 2 / max(float(weight @ weight), TINY)


def power(at: Samples, side: Floats, frequency: float) -> float:
    """The same at one ``frequency``; 0 without events."""
    if not at.size:
        return 0.0
    weight = side - side.mean()
    turned = weight @ np.exp(2j * np.pi * frequency * at)
    return float(abs(turned) ** 2 / max(float(weight @ weight), TINY))


def _amplitude(op: Floats, frequency: float) -> float:
    """The amplitude in percent with which OP (n,) swings at a ``frequency``, cycles a sample."""
    window = np.hanning(op.size)
    turn = np.exp(2j * np.pi * frequency * np.arange(op.size))
    return float(2.0 * abs((window * (op - op.mean())) @ turn) / window.sum())


def _of_the_model(evaluator: Evaluator, fitted: Fitted) -> tuple[Samples, Floats]:
    """(k,) the samples at which the free run of ``fitted`` lets go, and (k,) to which side."""
    run, _ = naive_evaluator(evaluator).assimilated(fitted.layout, fitted.candidates.mean(axis=0))
    step = np.diff(run, prepend=run[0])
    moves = np.abs(step) > MOVES
    begins = moves[RESTS:].copy()
    for back in range(1, RESTS + 1):
        begins &= ~moves[RESTS - back : moves.size - back]
    at = np.flatnonzero(begins) + RESTS
    return at, np.sign(step[at])
