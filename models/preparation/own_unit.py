"""How many samples make one unit of a recording's own clock: one, unless the valve takes dozens of
samples to answer.

The grids and limits of the fits reach lags of some fifteen samples. A drive recorded at 1 kHz may
take a hundred; then the unit is made of several samples, so that the grids reach as far. The
samples alone decide it. A coarse grid of stems that answer within the usual reach is compared with
one of slower stems; the unit grows only where the best of the slower ones leaves clearly less of
the stem's moves, so that friction, play or a top speed is not taken for a lag. A plain record of a
process has a sample for a unit.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from stemwatch.models.compiled import compiled
from stemwatch.models.preparation.fit_window import choose_fit_window
from stemwatch.models.recording import Floats, Recording
from stemwatch.models.stickslip import kernel
from stemwatch.models.stickslip.onsets import Samples
from stemwatch.models.stickslip.problem import FitProblem, make_problem

UNITS = (4, 16, 64)  # samples
FEWEST_UNITS = 300  # of a recording, whatever its unit
# Share of the residual that a slower stem may leave at most: 298 plain recordings had 0.96 and
# more.
SLOWER = 0.85
# Reach of the fits in units: the longest lag and delay, and the slowest stem in percent a unit.
LAG, DELAY, SPEED = 15.0, 8.0, 0.2
WIDTHS = (0.0, 0.04, 0.1, 0.2, 0.35, 0.6, 0.9)  # S in swings of OP
JUMP = 0.3  # J/S
MOST_SAMPLES = 7200  # of the recording that are looked at
OVER = 60  # samples over which moves are compared, because a wrong S causes an offset
# (delay, lag) in samples, and speeds in percent a sample.
USUAL = tuple(product((0.0, 3.0, 8.0), (0.0, 5.0, 15.0)))
SLOW = tuple(
    (share * answer, (1.0 - share) * answer)
    for answer, share in product((30.0, 60.0, 120.0, 240.0, 480.0), (0.0, 0.5, 1.0))
)
USUAL_SPEEDS, SLOW_SPEEDS = (0.2, 0.4, 1.0), (0.08, 0.03, 0.01)


def samples_in_unit(recording: Recording) -> int:
    """1, or one of ``UNITS`` where a stem as slow as that explains the position much better.

    Each stem is fitted to the position by a straight line, so that span, direction and unit of the
    position do not matter. 1 without a position, and where it does not move.
    """
    allowed = [unit for unit in UNITS if len(recording) >= unit * FEWEST_UNITS]
    if recording.mv is None or not allowed:
        return 1
    stretch = choose_fit_window(recording, MOST_SAMPLES)
    problem = make_problem(
        recording if stretch is None else recording.part(stretch.first, stretch.last)
    )
    if problem.swing <= 0.0 or _ends(problem).size < FEWEST_UNITS:
        return 1
    usual_loss, _ = _best(problem, USUAL, USUAL_SPEEDS)
    slow, stem = _best(problem, SLOW, SLOW_SPEEDS)
    if not slow < SLOWER * usual_loss:
        return 1
    needed = max(
        stem[kernel.DEAD_TIME_S] / DELAY, stem[kernel.LAG_UP_S] / LAG, SPEED / stem[kernel.RATE_UP]
    )
    return next((unit for unit in allowed if unit >= needed), allowed[-1])


def _best(
    problem: FitProblem, answers: tuple[tuple[float, float], ...], speeds: tuple[float, ...]
) -> tuple[float, Floats]:
    """The least residual of any stem of the grid, standard deviation, and the stem (10,)."""
    ends = _ends(problem)
    mv = problem.mv[ends] - problem.mv[ends - OVER]
    mv -= mv.mean()
    least, best = np.inf, np.zeros(kernel.N_PARAMETERS)
    out = np.empty(problem.op.size)
    answers_tried = [(delay, lag, np.inf) for delay, lag in answers] + [
        (0.0, 0.0, v) for v in speeds
    ]
    for width, (delay, lag, speed) in product(WIDTHS, answers_tried):
        stem = _stem(width * problem.swing, delay, lag, speed)
        kernel.simulate(problem.op, problem.op, problem.start, 1.0, stem, out)
        remaining = _share_left(out, ends, OVER, mv)
        if remaining < least:
            least, best = remaining, stem
    return least, best


def _ends(problem: FitProblem) -> Samples:
    """(m,) the samples at which a move over ``OVER`` samples ends that counts."""
    return np.flatnonzero(problem.scored[OVER:] & problem.scored[:-OVER]) + OVER


def _stem(S: float, delay: float, lag: float, speed: float) -> Floats:
    stem = np.zeros(kernel.N_PARAMETERS)
    stem[kernel.S], stem[kernel.J] = S, JUMP * S
    stem[kernel.DEAD_TIME_S] = delay
    stem[[kernel.LAG_UP_S, kernel.LAG_DOWN_S]] = lag
    stem[[kernel.RATE_UP, kernel.RATE_DOWN]] = speed
    stem[kernel.GAIN] = 1.0
    return stem


@compiled()
def _share_left(stem: Floats, ends: Samples, over: int, mv: Floats) -> float:
    """Standard deviation of moves ``mv`` (m,), centred, about their straight line in those of a
    ``stem`` (n,) over the same ``over`` samples, which end at ``ends`` (m,)."""
    mean, square, both, own = 0.0, 0.0, 0.0, 0.0
    for i in range(ends.size):
        move = stem[ends[i]] - stem[ends[i] - over]
        mean, square = mean + move, square + move * move
        both, own = both + move * mv[i], own + mv[i] * mv[i]
    power = square - mean * mean / ends.size
    remaining = own - both * both / power if power > 0.0 else own
    return float(np.sqrt(max(remaining, 0.0) / ends.size))
