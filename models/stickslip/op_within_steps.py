"""OP within the coarse steps that the recorder stored, reconstructed by the controller's own law.

A recorder that rounds OP to steps of half a percent leaves it uncertain by a quarter: the slips
seem to scatter, S comes out too small, and the steps of a smooth command look like a lag of the
stem. But OP answers PV and set point by the controller's law (``clock_shift``), and these are
stored finely. With ``c`` the sum of the moves that the law computes from them, the reconstructed
path ``x`` stays within its steps and moves as the law does,

    minimise  sum (x - stored)^2 / (step^2 / 12)  +  sum ((x - c)[k] - (x - c)[k-1])^2 w[k] / s^2

with ``s`` the residual of the law in a sample. The weights ``w`` are those of Student's
distribution, because a set-point change between two scans, a limit or an operator moves OP outside
of the law. Each of a few rounds solves one banded system. Where the controller's own output has
these steps, the stem follows them, and they are kept.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stemwatch.models.recording import Bools, Floats, Recording, Role
from stemwatch.models.signals.forensics import COARSE_PERCENT, quantum
from stemwatch.models.signals.op_in_steps import op_is_set_in_steps
from stemwatch.models.stickslip.advantage import advantage
from stemwatch.models.stickslip.first_look import FirstLook
from stemwatch.models.stickslip.hypotheses import sticking_grid

MOVES_OVER = 10  # samples: the law is fitted to moves, which are large against a step
FEWEST_MOVES = 200
LAW_ROUNDS, PATH_ROUNDS = 6, 5
FREEDOM = 2.0  # of Student's distribution of the law's residual
# Least residual of the law in a sample, as a share of a step.
LEAST_LEFT = 0.02
UNKNOWN_MOVE = 3.0  # steps that OP may move in a sample of which PV or set point are not known
# Share of the samples that the law puts outside of their step, from which it is not OP's law: at
# most 0.03 on 40 valves of `draw_valves` (seeds 5151, 6161) in steps of 0.5 %.
MOST_OUTSIDE = 0.1
STEPS_GAIN = 0.05  # gain of the steps over the path, from which they are the controller's own

WITHIN_STEPS = (
    "OP is recorded in coarse steps; where it was within them is told by PV and set point, which "
    "it answers by the controller's law."
)


@dataclass(frozen=True)
class OpWithinSteps:
    """The ``recording`` with OP reconstructed within its coarse ``step`` from PV and set point;
    ``open`` is the standard deviation that remains. Both in percent of OP.
    """

    recording: Recording
    step: float
    open: float


def op_within_steps(recording: Recording) -> OpWithinSteps | None:
    """OP within its coarse steps; ``None`` where it has none, where PV and set point do not
    determine it, or where the stem follows the steps.
    """
    step = quantum(recording.op.values[recording.op.usable])
    if step >= COARSE_PERCENT and op_is_set_in_steps(recording):
        return None
    moves = _moves_by_law(recording, step) if step >= COARSE_PERCENT else None
    if moves is None:
        return None
    op = recording.op
    stored = np.where(op.usable, op.values, 0.0)
    by_law = np.cumsum(np.where(np.isfinite(moves), moves, 0.0))
    left = max(_left_in_a_sample(stored - by_law, op.usable), LEAST_LEFT * step)
    path, outside = _path(stored, op.usable, by_law, np.isfinite(moves), step, left)
    if outside > MOST_OUTSIDE:
        return None
    signals = {**recording.signals, Role.OP: replace(op, values=path)}
    finer = replace(recording, signals=signals)
    if _follows_steps(recording, finer):
        return None
    # A random walk with this step, observed with this error, has the root of half their product as
    # its standard deviation where there are samples on both sides.
    rounding = step / np.sqrt(12.0)
    return OpWithinSteps(finer, step, float(min(np.sqrt(0.5 * left * rounding), rounding)))


def _path(
    stored: Floats, usable: Bools, by_law: Floats, told: Bools, step: float, left: float
) -> tuple[Floats, float]:
    """(n,) OP within its steps, NaN where it is not usable, and the share of the samples at which
    the law would have it outside. ``by_law`` (n,) is where the law alone would have it, ``told``
    (n,) in which samples, and ``left`` what it leaves in one."""
    both = usable[1:] & usable[:-1] & told[1:]
    certain = np.where(usable, 12.0 / step**2, 0.0)
    weight = np.where(told[1:], 1.0, (left / (UNKNOWN_MOVE * step)) ** 2)
    path, outside = stored, 0.0
    for _ in range(PATH_ROUNDS):
        path = by_law + _smooth(stored - by_law, certain, weight / left**2)
        off = np.abs(path - stored) / (0.5 * step)
        outside = float(np.mean(off[usable] > 1.0))
        moved = np.diff(path - by_law) / left
        weight = np.where(both, (1.0 + FREEDOM) / (FREEDOM + moved**2), weight)
        # Samples that have left their step are pulled back.
        certain = np.where(off > 1.0, certain * np.minimum(off**2, 16.0), certain)
    half = 0.5 * step
    return np.where(usable, np.clip(path, stored - half, stored + half), np.nan), outside


def _moves_by_law(recording: Recording, step: float) -> Floats | None:
    """(n,) OP's move in each sample by the law ``Kp de + Ki e`` that fits it best, with weights of
    its own for PV and set point; NaN where these are not known. ``None`` where too few are."""
    columns = []
    for role in (Role.PV, Role.SP):
        signal = recording.get(role)
        if signal is None or not signal.usable.any():
            continue
        values = np.where(signal.usable, signal.values, np.nan)
        values = values - np.nanmean(values)
        if np.nanmax(np.abs(values)) > 0.0:
            columns += [np.diff(values, prepend=values[0]), values]
    if recording.get(Role.PV) is None or not columns:
        return None
    law = np.column_stack((*columns, np.ones(len(recording))))
    known = np.isfinite(law).all(axis=1)
    total = np.cumsum(np.where(known[:, None], law, 0.0), axis=0)
    op = recording.op
    whole = np.cumsum(~(known & op.usable))
    told = (whole[MOVES_OVER:] == whole[:-MOVES_OVER]) & op.usable[:-MOVES_OVER]
    if np.count_nonzero(told) < FEWEST_MOVES:
        return None
    seen = (total[MOVES_OVER:] - total[:-MOVES_OVER])[told]
    moved = (op.values[MOVES_OVER:] - op.values[:-MOVES_OVER])[told]
    weight = np.ones(moved.size)
    best = np.zeros(law.shape[1])
    for _ in range(LAW_ROUNDS):
        root = np.sqrt(weight)
        best = np.linalg.lstsq(seen * root[:, None], moved * root, rcond=None)[0]
        off = moved - seen @ best
        scale = max(1.4826 * float(np.median(np.abs(off))), 0.3 * step)
        weight = 1.0 / (1.0 + (off / (2.0 * scale)) ** 2)
    return np.where(known, law @ best, np.nan)


def _left_in_a_sample(left: Floats, usable: Bools) -> float:
    """Standard deviation of the law's residual in a sample. Rounding is the same over many samples
    as over a few, so the part that grows between the two is the law's.
    """
    few, many = (
        np.median(np.abs(left[by:] - left[:-by])[usable[by:] & usable[:-by]]) * 1.4826
        for by in (MOVES_OVER, 4 * MOVES_OVER)
    )
    return float(np.sqrt(max(many**2 - few**2, 0.0) / (3.0 * MOVES_OVER)))


def _smooth(values: Floats, certain: Floats, stiff: Floats) -> Floats:
    """(n,) the path ``z`` of least ``sum certain (z - values)^2 + sum stiff (z[k] - z[k-1])^2``."""
    from scipy.linalg import solveh_banded  # slow to import, and most commands are stored finely

    bands = np.zeros((2, values.size))
    bands[1] = certain + np.append(stiff, 0.0) + np.append(0.0, stiff)
    bands[0, 1:] = -stiff
    return np.asarray(solveh_banded(bands, certain * values))


def _follows_steps(recording: Recording, finer: Recording) -> bool:
    """Whether the cheapest stick-slip element follows the stored steps better than the ``finer``
    path, block by block: then the controller's own output has these steps.

    Of 40 valves of `draw_valves` (seeds 5151, 6161) in steps of 0.5 % the steps gain -1.4 to 0.02;
    where the steps themselves move the same element, 0.10 to 2.0 on 38 and -0.1 on two.
    """
    look = FirstLook.of(recording)
    if look is None:
        return True
    evaluator = look.evaluator
    grid = sticking_grid(evaluator, look.base)
    path = np.where(np.isfinite(finer.op.values), finer.op.values, evaluator.problem.op)
    (stored, counts), (smooth, _) = (
        replace(evaluator, problem=replace(evaluator.problem, op=op)).block_losses(grid)
        for op in (evaluator.problem.op, path)
    )
    before, after = (losses[int(losses.sum(axis=1).argmin())] for losses in (smooth, stored))
    return advantage(before, after, counts, evaluator.delta).mean > STEPS_GAIN
