"""OP and position by one clock: how late the archive stored OP.

Two tags of one loop may come through two collectors, and OP may carry a time stamp that is seconds
late. Then the position moves before its command, which no valve can do; friction read against the
late command comes out too small, by twice what OP moves in that time. A position that is stored
late looks as a dead time does, and is named so.

The command is brought forward by whole samples and the cheapest stick-slip element is looked for
at each, then by parts of a sample. It is believed where the blocks of the record agree that it is
cheaper: a stem that only answers late is made dearer by it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stemwatch.models.forensics import repeat_share
from stemwatch.models.recording import Floats, Quality, Recording, Role
from stemwatch.models.stickslip import parameters as coordinate
from stemwatch.models.stickslip.fit import (
    Advantage,
    FirstLook,
    StickSlipEvaluator,
    advantage,
    sticking_grid,
)

# Samples by which OP is brought forward: where neither of the first makes it cheaper, none does.
LOOKED_AT, TRIED = (1, 3), (2, 5, 8, 12)
WITHIN = np.arange(-2.0, 2.01, 0.25)  # samples about the best of them
# Of the block-wise advantage (``stickslip.fit.advantage``). `stemwatch calibrate-archives` prints
# both of valves whose clocks agree, and of the same with OP stored late.
LEAST_MEAN, LEAST_T = 0.1, 1.5
STEPPED = 0.05  # share of repeats of OP from which it is moved by whole samples
LEAST = 0.5  # samples; less is within what sampling does


def find_op_late(recording: Recording, look: FirstLook | None = None) -> float:
    """How late OP was stored against the position, seconds of the recording's clock; 0 where it was
    not, or where nothing tells. ``look`` is a first look at it where there was one."""
    seen = late_evidence(recording, look)
    told = seen.samples >= LEAST and seen.gain.mean >= LEAST_MEAN and seen.gain.t >= LEAST_T
    return seen.samples * recording.interval_s if told else 0.0


def brought_forward(recording: Recording, late_s: float) -> Recording:
    """``recording`` with OP brought forward by ``late_s``; its last samples are then left out.

    An OP that keeps its values for a while moves by whole samples, so that it still does.
    """
    samples = late_s / recording.interval_s
    if samples == 0.0:
        return recording
    op, last = recording.op, len(recording) - 1
    samples = float(round(samples)) if repeat_share(op.values) >= STEPPED else samples
    at = np.arange(len(recording)) + int(samples)
    usable = op.usable[np.minimum(at, last)] & op.usable[np.minimum(at + (samples % 1 > 0), last)]
    usable &= np.arange(len(recording)) + samples <= last
    quality = np.where(
        usable, Quality.GOOD, np.maximum(op.quality[np.minimum(at, last)], Quality.BAD)
    )
    values = np.where(usable, _moved(op.values, samples), np.nan)
    signals = {**recording.signals, Role.OP: replace(op, values=values, quality=quality)}
    return replace(recording, signals=signals)


@dataclass(frozen=True)
class LateEvidence:
    """By how many ``samples`` OP is best brought forward, and what that gains; 0 samples and no
    gain where nothing tells."""

    samples: float
    gain: Advantage


_NOTHING = LateEvidence(0.0, Advantage(0.0, 0.0))


def late_evidence(recording: Recording, look: FirstLook | None = None) -> LateEvidence:
    """What speaks for an OP that was stored late."""
    look = look or FirstLook.at(recording)
    if look is None:
        return _NOTHING
    evaluator, base = look.evaluator, look.base
    grid = sticking_grid(evaluator, base)[1::4]  # the reading's own zero
    plain = _cheapest(evaluator, grid, 0.0)
    looked = [_cheapest(evaluator, grid, float(at)) for at in LOOKED_AT]
    if min(map(_total, looked)) >= _total(plain):
        return _NOTHING
    best = min(*looked, *(_cheapest(evaluator, grid, float(at)) for at in TRIED), key=_total)
    near, parts = _about(best.candidate), best.samples + WITHIN
    best = min((_cheapest(evaluator, near, float(at)) for at in parts[parts > 0.0]), key=_total)
    plain = _cheapest(evaluator, np.vstack((grid, _about(plain.candidate))), 0.0)
    gain = advantage(plain.losses, best.losses, best.counts, evaluator.delta)
    return LateEvidence(best.samples, gain)


@dataclass(frozen=True)
class _Shifted:
    """The cheapest ``candidate`` (9,) with OP brought forward by ``samples``, and its losses by
    block."""

    samples: float
    candidate: Floats
    losses: Floats
    counts: Floats


def _total(shifted: _Shifted) -> float:
    return float(shifted.losses.sum())


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
    moved = replace(evaluator.problem, op=_moved(evaluator.problem.op, samples))
    losses, counts = replace(evaluator, problem=moved).block_losses(candidates)
    best = int(np.argmin(losses.sum(axis=1)))
    return _Shifted(samples, candidates[best], losses[best], counts)


def _moved(values: Floats, samples: float) -> Floats:
    clock = np.arange(values.size, dtype=np.float64)
    return np.interp(clock + samples, clock, values)
