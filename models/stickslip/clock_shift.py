"""OP and position by one clock: how late the archive stored OP.

Two tags of one loop may come through two collectors, and OP may carry a time stamp that is seconds
late. Then the position moves before its command, which no valve can do, and S comes out too small
by twice OP's move in that time. A position that is stored late looks like a dead time, and is
reported as one.

It shows in two independent ways.

**The controller.** OP follows set point and PV at once, by the controller's own law, ``OP[k] - OP[k
- w] = Kp (e[k - n] - e[k - n - w]) + Ki sum of e`` with ``e = SP - PV``: by least squares for each
delay ``n``, one delay explains OP far better than any other. PV shares its clock with the position
or with OP; the stem must not contradict that OP is the late one.

**The stem.** The command is shifted earlier by whole samples, then by parts of a sample, and the
best stick-slip element is fitted at each shift. The shift is believed where the blocks of the
record agree that it lowers the loss; for a stem that only answers late it raises the loss. In this
fit a late OP and a smaller S look much alike, so that it decides the size of the shift only where
the controller does not.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.recording import Bools, Floats, Quality, Recording, Role
from stemwatch.models.signals.forensics import repeat_share
from stemwatch.models.stickslip import parameters as coordinate
from stemwatch.models.stickslip.advantage import Advantage, advantage
from stemwatch.models.stickslip.evaluator import StickSlipEvaluator
from stemwatch.models.stickslip.first_look import FirstLook
from stemwatch.models.stickslip.hypotheses import sticking_grid

# Samples by which OP is shifted earlier: where neither of the first two lowers the loss, none does.
LOOKED_AT, TRIED = (1, 3), (2, 5, 8, 12)
FURTHER = (17, 22, 27, 32)  # where the best of those before is the last that was tried
WITHIN = np.arange(-2.0, 2.01, 0.25)  # samples about the best of them, FURTHER twice as far
# Limits of the block-wise advantage (``stickslip.advantage``). `stemwatch calibrate-archives`
# derives these and ``LEFT_AT_ONCE`` from valves whose clocks agree.
LEAST_MEAN, LEAST_T = 0.1, 1.5
STEPPED = 0.05  # share of repeats of OP, from which it is shifted by whole samples only
LEAST = 0.5  # samples; sampling alone causes less
# For the controller's law: OP's moves are taken over MOVES_OVER samples, and delays from EARLIEST
# to LATEST are tried. A delay is believed where it leaves at most MOST_LEFT of OP's moves, and at
# most LEFT_AT_ONCE of what a delay of no or one sample leaves. 80 recordings whose clocks agree
# (`draw_valves`, seeds 5151, 6161, 8383; `draw_sticky`, `draw_healthy`, 5151, 7171) leave 0.00 to
# 0.21 at none or one sample; stored 5 s late 0.00 to 0.21 at 5 or 6 samples, at most 0.48 times
# what they leave at none or one.
MOVES_OVER, FEWEST_MOVES = 5, 200
EARLIEST, LATEST = -1, 14  # samples; the first and the last are only neighbours of the delays tried
MOST_LEFT, LEFT_AT_ONCE = 0.35, 0.5
# Where OP and PV have one clock, only the position's can be ahead. Of 72 valves of `draw_sticky`
# (seeds 5151, 7171, 8181, 8383) with equal clocks, three look so by the stem alone, by up to 2.5
# samples.
LEAST_AGAINST = 3.0
WHOLE = 0.4  # samples: a shift this near to a whole number is taken as that number


def find_op_late(recording: Recording) -> float:
    """How late OP was stored against the position, seconds of the recording's clock; 0 where it was
    not, or where this cannot be decided."""
    return late_evidence(recording).late_s(recording.interval_s)


def brought_forward(recording: Recording, late_s: float) -> Recording:
    """``recording`` with OP shifted earlier by ``late_s``; its last samples are then left out.

    An OP that keeps its values for several samples is shifted by whole samples, so that it keeps
    them.
    """
    samples = late_s / recording.interval_s
    if samples == 0.0:
        return recording
    op, last = recording.op, len(recording) - 1
    samples = float(round(samples)) if repeat_share(op.values) >= STEPPED else samples
    shifted_index = np.arange(len(recording)) + int(samples)
    usable = (
        op.usable[np.minimum(shifted_index, last)]
        & op.usable[np.minimum(shifted_index + (samples % 1 > 0), last)]
    )
    usable &= np.arange(len(recording)) + samples <= last
    quality = np.where(
        usable, Quality.GOOD, np.maximum(op.quality[np.minimum(shifted_index, last)], Quality.BAD)
    )
    values = np.where(usable, _moved(op.values, samples), np.nan)
    signals = {**recording.signals, Role.OP: replace(op, values=values, quality=quality)}
    return replace(recording, signals=signals)


@dataclass(frozen=True)
class LateEvidence:
    """By how many ``samples`` OP is best shifted earlier, and the gain; 0 samples and no gain where
    this cannot be decided.
    """

    samples: float
    gain: Advantage
    by_controller: bool = False
    against_controller: bool = False

    @property
    def is_believed(self) -> bool:
        """Whether OP is believed to be late. Where the controller's law shows it, the stem must
        only not contradict it: PV may be the signal with another clock.
        """
        if self.by_controller:
            return self.gain.mean >= 0.0
        least = LEAST_AGAINST if self.against_controller else LEAST
        return self.samples >= least and self.gain.mean >= LEAST_MEAN and self.gain.t >= LEAST_T

    def late_s(self, interval_s: float) -> float:
        """How late OP is believed to be, seconds of the recording's clock; 0 where it is not."""
        return self.samples * interval_s if self.is_believed else 0.0


_NOTHING = LateEvidence(0.0, Advantage(0.0, 0.0))


def late_evidence(recording: Recording, first_look: FirstLook | None = None) -> LateEvidence:
    """The evidence for an OP that was stored late."""
    first_look = first_look or FirstLook.of(recording)
    if first_look is None:
        return _NOTHING
    evaluator, base = first_look.evaluator, first_look.base
    grid = sticking_grid(evaluator, base)[1::4]  # the reading's own zero
    unshifted = _cheapest(evaluator, grid, 0.0)

    def gain(late: _Shifted) -> Advantage:
        fair = _cheapest(evaluator, np.vstack((grid, _grid_about(unshifted.candidate))), 0.0)
        return advantage(fair.losses, late.losses, late.counts, evaluator.delta)

    controller = behind_controller(recording)
    behind = controller.samples
    if behind > 0.0:
        near_grid = np.vstack((grid, _grid_about(_cheapest(evaluator, grid, behind).candidate)))
        evidence = LateEvidence(
            behind, gain(_cheapest(evaluator, near_grid, behind)), by_controller=True
        )
        if evidence.is_believed:
            return evidence
    looked = [_cheapest(evaluator, grid, float(shift)) for shift in LOOKED_AT]
    if min(map(_total, looked)) >= _total(unshifted):
        return _NOTHING
    best = min(*looked, *(_cheapest(evaluator, grid, float(shift)) for shift in TRIED), key=_total)
    last = float(TRIED[-1])
    for shift in FURTHER:  # an optimum at the edge of what was tried is none
        if best.samples < last:
            break
        last = float(shift)
        best = min(best, _cheapest(evaluator, grid, last), key=_total)
    near_grid = _grid_about(best.candidate)
    parts = best.samples + WITHIN * (2.0 if best.samples >= TRIED[-1] else 1.0)
    best = min(
        (_cheapest(evaluator, near_grid, float(shift)) for shift in parts[parts > 0.0]), key=_total
    )
    return LateEvidence(best.samples, gain(best), against_controller=controller.agrees)


@dataclass(frozen=True)
class BehindController:
    """By how many ``samples`` OP is stored after the PV and set point that it answers; 0 where it
    is not, or where the law does not fit. ``left`` is the share of OP's moves that the best delay
    of two or more samples leaves, ``of_at_once`` its ratio to the share left without a delay; NaN
    where too few samples are known.
    """

    samples: float = 0.0
    left: float = np.nan
    of_at_once: float = np.nan

    @property
    def at_once(self) -> float:
        """Share of OP's moves that is left without a delay."""
        return self.left / self.of_at_once

    @property
    def agrees(self) -> bool:
        """Whether OP answers at once and at no other time: it has PV's clock."""
        return self.at_once <= MOST_LEFT and self.of_at_once >= 1.0 / LEFT_AT_ONCE

    def rather_than(self, other: BehindController, times: float) -> bool:
        """Whether the controller's law fits this pair of signals better than the ``other`` pair, by
        the factor ``times``.
        """
        return self.agrees and self.at_once * times <= other.at_once


def behind_controller(
    recording: Recording, output: Role = Role.OP, answering: Role = Role.PV
) -> BehindController:
    """How late the ``output`` is against the signal ``answering`` it, by the controller's law. The
    two are OP and PV, or two signals that may have been exchanged for them.
    """
    output_signal, pv, sp = recording.get(output), recording.get(answering), recording.get(Role.SP)
    if output_signal is None or pv is None:
        return BehindController()
    watched = [pv, *([sp] if sp is not None and sp.usable.any() else [])]
    followed = [_centred(signal.values, signal.usable) for signal in watched]
    if np.ptp(followed[0]) == 0.0:
        return BehindController()
    followed = [values for values in followed if np.ptp(values) > 0.0]
    n, moves_over = len(recording), MOVES_OVER
    sample_index = np.arange(moves_over - EARLIEST + LATEST, n + EARLIEST)
    if sample_index.size < FEWEST_MOVES:
        return BehindController()
    moves = np.zeros((n, 2 * len(followed)))
    for row, values in enumerate(followed):
        moves[moves_over:, 2 * row] = values[moves_over:] - values[:-moves_over]
        total = np.concatenate(([0.0], np.cumsum(values)))
        moves[moves_over:, 2 * row + 1] = total[moves_over + 1 :] - total[1:-moves_over]
    op, op_known = (
        _centred(output_signal.values, output_signal.usable),
        _usable_throughout(output_signal.usable, moves_over)[sample_index],
    )
    moved = np.where(op_known, op[sample_index] - op[sample_index - moves_over], 0.0)
    all_known = np.all(
        [_usable_throughout(signal.usable, moves_over) for signal in watched], axis=0
    )
    left_by_shift = np.array(
        [
            _unexplained(moves, all_known, moved, op_known, sample_index - shift)
            for shift in range(EARLIEST, LATEST)
        ]
    )
    if not np.isfinite(left_by_shift).all():
        return BehindController()
    at_once, first = float(left_by_shift[-EARLIEST : 2 - EARLIEST].min()), 2 - EARLIEST
    best = int(left_by_shift[first:-1].argmin()) + first
    least, share = float(left_by_shift[best]), float(left_by_shift[best]) / max(at_once, 1e-12)
    if least > MOST_LEFT or share > LEFT_AT_ONCE:
        return BehindController(0.0, least, share)
    before, after = left_by_shift[best - 1], left_by_shift[best + 1]
    bend = before - 2.0 * least + after
    vertex = float(0.5 * (before - after) / bend) if bend > 0.0 else 0.0
    is_whole = abs(vertex) < WHOLE or abs(vertex) > 1.0
    return BehindController(best + EARLIEST + (0.0 if is_whole else vertex), least, share)


def _centred(values: Floats, usable: Bools) -> Floats:
    """(n,) ``values`` about their mean; 0 where they are not usable."""
    mean = float(values[usable].mean()) if usable.any() else 0.0
    return np.where(usable, values - mean, 0.0)


def _usable_throughout(usable: Bools, span: int) -> Bools:
    """(n,) whether the last ``span + 1`` samples are all usable."""
    good = np.concatenate(([0], np.cumsum(usable)))
    usable_throughout = np.zeros(usable.size, dtype=bool)
    usable_throughout[span:] = good[span + 1 :] - good[: -span - 1] == span + 1
    return usable_throughout


def _unexplained(
    moves: Floats,
    all_known: Bools,
    op_moves: Floats,
    op_known: Bools,
    sample_index: NDArray[np.intp],
) -> float:
    """Share of the squares of ``op_moves`` (m,) that the moves of PV and set point at the samples
    ``sample_index`` leave, by least squares; NaN where too few are known."""
    first, last = int(sample_index[0]), int(sample_index[-1]) + 1
    both_known = op_known & all_known[first:last]
    if np.count_nonzero(both_known) < FEWEST_MOVES:
        return float("nan")
    seen, op = (
        np.where(both_known[:, None], moves[first:last], 0.0),
        np.where(both_known, op_moves, 0.0),
    )
    squares = float(op @ op)
    if squares <= 0.0:
        return float("nan")
    best = np.linalg.lstsq(seen.T @ seen, seen.T @ op, rcond=None)[0]
    residual = op - seen @ best
    return float(residual @ residual) / squares


@dataclass(frozen=True)
class _Shifted:
    """The best ``candidate`` (9,) with OP shifted earlier by ``samples``; its losses by block."""

    samples: float
    candidate: Floats
    losses: Floats
    counts: Floats


def _total(shifted: _Shifted) -> float:
    return float(shifted.losses.sum())


def _grid_about(candidate: Floats) -> Floats:
    """(m, 9) elements about a candidate, in which S makes up for a change of the delay."""
    widths = np.linspace(0.6, 1.5, 19)
    ratios = np.linspace(-0.3, 0.3, 7)
    width, ratio = (axis.ravel() for axis in np.meshgrid(widths, ratios, indexing="ij"))
    grid = np.tile(candidate, (width.size, 1))
    grid[:, coordinate.S_PERCENT] *= width
    grid[:, coordinate.RATIO] = np.maximum(grid[:, coordinate.RATIO] + ratio, 0.0)
    return grid


def _cheapest(evaluator: StickSlipEvaluator, candidates: Floats, samples: float) -> _Shifted:
    moved = replace(evaluator.problem, op=_moved(evaluator.problem.op, samples))
    losses, counts = replace(evaluator, problem=moved).block_losses(candidates)
    best = int(np.argmin(losses.sum(axis=1)))
    return _Shifted(samples, candidates[best], losses[best], counts)


def _moved(values: Floats, samples: float) -> Floats:
    clock = np.arange(values.size, dtype=np.float64)
    return np.interp(clock + samples, clock, values)
