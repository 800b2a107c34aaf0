"""Does the stem rest while OP turns round? Asked of the steps from sample to sample, not of a run.

A slow actuator without friction moves wherever it is not where OP is: its step over ``m`` samples
is linear in where OP and stem were, whatever the order of its lag. A stem that friction holds does
not move until OP is half a dead band h away, and follows beyond that:

    step = linear + g p,  p = max(d - z - h, 0) + min(d - z + h, 0),  d = OP - MV before the step

with ``g`` above zero. A lag, a drag, a limit of speed and weak air fall back the more, the further
OP is away: their g is zero or below. Both models are fitted by least squares to every other of
twenty blocks of time and compared on the rest. The linear one has slopes of its own for either
direction as well, and both a reading that is bent over travel.

OP that moves to and fro between two samples shakes a stem loose a little, so that the band that is
seen is smaller than that of the valve, and its edge is rounded.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stemwatch.models.recording import Bools, Floats

STEPS = (1, 2, 4, 8)  # samples
HALVES = np.concatenate((np.arange(0.2, 2.0, 0.1), np.arange(2.0, 6.01, 0.25)))  # percent
MIDDLES = (40.0, 45.0, 50.0, 55.0, 60.0)  # percentiles of d among which its zero z is looked for
BLOCKS = 20
FEWEST = 200  # steps
LEAST_GAIN = 0.15  # g, below which the step beyond the band is not the stem's way to its command
FLOOR = 1e-4  # percent^2, which is no residual worth a comparison
MOST = 1.0  # log ratio that one block may count


@dataclass(frozen=True)
class DeadBand:
    """A band within which the stem rests.

    ``percent`` is its width 2 h, in the unit of OP; ``gain`` the share g of what OP is beyond the
    band by which the stem follows in a step; ``inside`` that by which it follows within the band
    (the sum of the linear part over OP); ``t`` the mean advantage over a linear actuator on blocks
    that were not fitted, over its standard error + 0.01.
    """

    percent: float
    gain: float
    inside: float
    t: float


@dataclass(frozen=True)
class _Steps:
    """Steps of the stem and what they may depend on: ``linear`` (n, 8) of either model,
    ``one_way`` (n, 2) of a linear actuator that is slower one way."""

    way: Floats  # (n,)
    linear: Floats
    one_way: Floats
    apart: Floats  # (n,) d at the end of a step
    highest: Floats  # (n,) d within a step
    lowest: Floats


def find_dead_bands(op: Floats, mv: Floats, usable: Bools) -> tuple[DeadBand, ...]:
    """The dead bands that OP and position (n,), in the same percent, show over steps of 1 to 8
    samples, however unlikely; none where the stem follows beyond none of them, or the steps are too
    few. Samples that are not ``usable`` (n,) are left out.
    """
    found = [_over(op, mv, usable, samples) for samples in STEPS]
    return tuple(one for one in found if one is not None and one.gain > LEAST_GAIN)


def _over(op: Floats, mv: Floats, usable: Bools, samples: int) -> DeadBand | None:
    """The dead band that steps over so many ``samples`` show, however unlikely it is."""
    steps = _steps(op, mv, usable, samples)
    if steps is None:
        return None
    halves = HALVES[0.5 * float(np.ptp(np.percentile(steps.apart, (0.5, 99.5)))) > HALVES]
    if not halves.size:
        return None
    block = np.arange(steps.way.size) * BLOCKS // steps.way.size
    by_line, by_band = np.empty_like(steps.way), np.empty_like(steps.way)
    fitted = []
    for fold in (0, 1):
        train = block % 2 != fold
        lines = np.column_stack((steps.linear, steps.one_way))
        by_line[~train] = _left(lines, steps.way, train)[0][~train]
        half, middle = _likeliest(steps, halves, train)
        band = np.column_stack((steps.linear, _beyond(steps, half, middle)[:, 0]))
        left, slopes = _left(band, steps.way, train)
        by_band[~train] = left[~train]
        fitted.append((2.0 * float(half[0]), float(slopes[-1]), float(slopes[4:7].sum())))
    line, band_loss = (
        np.bincount(block, left**2, BLOCKS) / np.bincount(block, minlength=BLOCKS)
        for left in (by_line, by_band)
    )
    gains = np.clip(np.log((line + FLOOR) / (band_loss + FLOOR)), -MOST, MOST)
    t = float(gains.mean() / (gains.std(ddof=1) / np.sqrt(BLOCKS) + 0.01))
    percent, gain, _ = np.min(fitted, axis=0)
    return DeadBand(float(percent), float(gain), float(np.mean([one[2] for one in fitted])), t)


def _steps(op: Floats, mv: Floats, usable: Bools, samples: int) -> _Steps | None:
    """The steps over so many ``samples`` with two such steps before, all of them usable."""
    missing = np.concatenate(([0], np.cumsum(~usable)))
    at = np.arange(2 * samples, op.size - samples)
    at = at[missing[at + samples + 1] == missing[at - 2 * samples]]
    if at.size < FEWEST:
        return None
    stem = mv[at]
    place = (stem - stem.mean()) / max(float(stem.std()), 1e-9)
    ends, begins, before = op[at + samples] - stem, op[at] - stem, op[at - samples] - stem
    moved = stem - mv[at - samples]
    linear = (np.ones_like(stem), place, place**2, place**3, ends, begins, before, moved)
    return _Steps(
        way=mv[at + samples] - stem,
        linear=np.column_stack(linear),
        one_way=np.column_stack((np.abs(ends - np.median(ends)), np.abs(moved))),
        apart=ends,
        highest=np.maximum(ends, begins),
        lowest=np.minimum(ends, begins),
    )


def _beyond(steps: _Steps, half: Floats, middle: Floats) -> Floats:
    """(n, m) p of each step for each of m bands."""
    above = np.maximum(steps.highest[:, None] - middle - half, 0.0)
    return np.asarray(above + np.minimum(steps.lowest[:, None] - middle + half, 0.0))


def _likeliest(steps: _Steps, halves: Floats, train: Bools) -> tuple[Floats, Floats]:
    """(1,) half and (1,) middle of the band that leaves least of the steps to ``train`` on."""
    middles = np.percentile(steps.apart[train], MIDDLES)
    half, middle = (axis.ravel() for axis in np.meshgrid(halves, middles))
    basis, _ = np.linalg.qr(steps.linear[train])
    way = steps.way[train] - basis @ (basis.T @ steps.way[train])
    beyond = _beyond(steps, half, middle)[train]
    beyond -= basis @ (basis.T @ beyond)
    along, size = beyond.T @ way, np.maximum(np.sum(beyond**2, axis=0), 1e-9)
    best = int(np.argmax(np.where(along > 0.0, along**2 / size, -1.0)))
    return half[best : best + 1], middle[best : best + 1]


def _left(columns: Floats, way: Floats, train: Bools) -> tuple[Floats, Floats]:
    """What a least-squares fit to ``train`` leaves of each step (n,), and its slopes."""
    slopes = np.linalg.lstsq(columns[train], way[train], rcond=None)[0]
    return way - columns @ slopes, np.asarray(slopes, dtype=np.float64)
