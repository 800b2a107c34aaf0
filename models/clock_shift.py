"""OP and position by one clock: how late the archive stored OP.

Two tags of one loop may come through two collectors, and OP may carry a time stamp that is seconds
late. Then the position moves before its command, which no valve can do; friction read against the
late command comes out too small, by twice what OP moves in that time. A position that is stored
late looks as a dead time does, and is named so.

The command is brought forward by whole samples and the cheapest stick-slip element is looked for
at each, then by parts of a sample. It is believed where it makes both halves of the record clearly
cheaper: a stem that only answers late is made dearer by it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stemwatch.models.recording import Floats, Recording, Role
from stemwatch.models.stickslip import parameters as coordinate
from stemwatch.models.stickslip.fit import StickSlipEvaluator, advantage, first_look, sticking_grid
from stemwatch.models.stickslip.problem import make_problem

TRIED = (1, 2, 3, 5, 8, 12)  # samples by which OP is brought forward
WITHIN = np.arange(-2.0, 2.01, 0.25)  # samples about the best of them
LEAST_MEAN, LEAST_T = 0.1, 1.5
LEAST = 0.5  # samples; less is within what sampling does


@dataclass(frozen=True)
class ClockShift:
    """OP carries time stamps that are ``late_s`` seconds too late against those of the position."""

    late_s: float

    def sentence(self) -> str:
        """For people."""
        return (
            f"OP is stored {self.late_s:.1f} s late: the position moves before its command. It is read with "
            "the command brought forward by as much; let both tags be stored by one clock."
        )


def find_clock_shift(recording: Recording) -> ClockShift | None:
    """How late OP was stored, or ``None`` where it was not, or where nothing tells."""
    problem = make_problem(recording)
    if not problem.scored.any() or problem.swing <= 0.0:
        return None
    evaluator, base = first_look(problem)
    grid = sticking_grid(evaluator, base)[1::4]  # the reading's own zero
    plain = _cheapest(evaluator, grid, 0.0)
    best = min((_cheapest(evaluator, grid, float(at)) for at in TRIED), key=lambda one: one.total)
    if best.total >= plain.total:
        return None
    near = _about(best.candidate)
    parts = best.samples + WITHIN
    best = min(
        (_cheapest(evaluator, near, float(part)) for part in parts[parts > 0.0]),
        key=lambda one: one.total,
    )
    plain = _cheapest(evaluator, np.vstack((grid, _about(plain.candidate))), 0.0)
    gain = advantage(plain.losses, best.losses, best.counts, evaluator.delta)
    if best.samples < LEAST or gain.mean < LEAST_MEAN or gain.t < LEAST_T:
        return None
    return ClockShift(best.samples * problem.interval_s)


@dataclass(frozen=True)
class _Shifted:
    """The cheapest ``candidate`` (9,) with OP brought forward by ``samples``, and its losses by
    block."""

    samples: float
    candidate: Floats
    losses: Floats
    counts: Floats

    @property
    def total(self) -> float:
        return float(self.losses.sum())


def _about(candidate: Floats) -> Floats:
    """(m, 9) elements about a candidate: the delay and S stand for one another."""
    widths = np.linspace(0.6, 1.5, 19)
    ratios = np.linspace(-0.3, 0.3, 7)
    width, ratio = (one.ravel() for one in np.meshgrid(widths, ratios, indexing="ij"))
    about = np.tile(candidate, (width.size, 1))
    about[:, coordinate.S_PERCENT] *= width
    about[:, coordinate.RATIO] = np.maximum(about[:, coordinate.RATIO] + ratio, 0.0)
    return about


def _cheapest(evaluator: StickSlipEvaluator, candidates: Floats, samples: float) -> _Shifted:
    moved = replace(evaluator.problem, op=_brought_forward(evaluator.problem.op, samples))
    losses, counts = replace(evaluator, problem=moved).block_losses(candidates)
    best = int(np.argmin(losses.sum(axis=1)))
    return _Shifted(samples, candidates[best], losses[best], counts)


def by_one_clock(recording: Recording, shift: ClockShift | None) -> Recording:
    """``recording`` with OP brought forward; its last samples, which OP no longer covers, are left
    out."""
    if shift is None:
        return recording
    samples = shift.late_s / recording.interval_s
    op = recording.op
    values = _brought_forward(op.values, samples)
    ahead = np.minimum(
        np.arange(values.size) + np.array([[0], [1]]) + int(samples), values.size - 1
    )
    usable = op.usable[ahead].all(axis=0)
    usable[values.size - int(np.ceil(samples)) :] = False
    signals = {**recording.signals, Role.OP: replace(op, values=np.where(usable, values, np.nan))}
    return replace(recording, signals=signals)


def _brought_forward(values: Floats, samples: float) -> Floats:
    clock = np.arange(values.size, dtype=np.float64)
    return np.interp(clock + samples, clock, values)
