"""Cells of a residual: how much of it each holds, with a significance from blocks of time.

Neighbouring residuals depend on one another, so the unit of chance is the block of time, not the
sample. Every statistic of a cell is a ratio of sums over blocks; its scatter comes from resampling
the blocks, and is read on Student's t with as many degrees of freedom as blocks fill the cell.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtr

from stemwatch.models.mismatch.findings import Cell
from stemwatch.models.recording import Bools, Floats
from stemwatch.models.statistics.block_bootstrap import block_weights

REPLICATES = 400
_SEED = 40_021
CLIP_PERCENTILE = 99.5  # of |residual|: one missed slip must not be the whole map
MOST_Z = 8.0  # beyond this a bootstrap of a few hundred draws cannot distinguish significances
LEAST_BLOCKS = 4.0  # filled blocks, from which a cell's scatter can be estimated
MOST_MEMORY = 0.6
_NO_SCATTER = 1e-12


@dataclass(frozen=True)
class Facet:
    """One way to cut a record into cells: ``code`` (n,) is the number of the label, or -1."""

    name: str
    labels: tuple[str, ...]
    code: NDArray[np.int64]
    phrases: tuple[str, ...] = ()  # how a sentence about each cell begins


@dataclass(frozen=True)
class BlockSums:
    """Sums per block and cell, each (b, c): samples, residual, squared residual.

    ``all_samples``, ``all_residual`` and ``all_energy`` (b,) are those of the whole block, cell or
    not.
    """

    samples: Floats
    residual: Floats
    energy: Floats
    all_samples: Floats
    all_residual: Floats
    all_energy: Floats


@lru_cache(maxsize=8)
def _draws(blocks: int) -> Floats:
    """(REPLICATES, b) how often each block is drawn in each replicate."""
    rng = np.random.default_rng([_SEED, blocks])
    return block_weights(np.ones(blocks), REPLICATES, rng)


def clipped(residual: Floats, scored: Bools) -> Floats:
    """(n,) the residual, no larger in size than its 99.5th percentile over the scored samples."""
    largest = float(np.percentile(np.abs(residual[scored]), CLIP_PERCENTILE))
    return np.asarray(np.clip(residual, -largest, largest))


def block_sums(
    facet: Facet, residual: Floats, block: NDArray[np.int64], scored: Bools
) -> BlockSums:
    """Sums of a facet's cells over the blocks of time; ``block`` (n,) is -1 where not scored."""
    cells = len(facet.labels)
    blocks = int(block.max()) + 1
    in_block = scored & (block >= 0)
    block_index, r = block[in_block], residual[in_block]
    code = facet.code[in_block]
    in_cell = code >= 0
    cell_index = block_index[in_cell] * cells + code[in_cell]

    def total(values: Floats | None) -> Floats:
        sums = np.bincount(cell_index, values, minlength=blocks * cells)
        return sums.astype(np.float64).reshape(blocks, cells)

    return BlockSums(
        samples=total(None),
        residual=total(r[in_cell]),
        energy=total(r[in_cell] ** 2),
        all_samples=np.bincount(block_index, minlength=blocks).astype(np.float64),
        all_residual=np.bincount(block_index, r, minlength=blocks).astype(np.float64),
        all_energy=np.bincount(block_index, r**2, minlength=blocks).astype(np.float64),
    )


def _normal_score(t: Floats, freedom: Floats) -> Floats:
    """The value of a normal deviate that is as improbable as ``t`` with few degrees of freedom."""
    score = -ndtri(stdtr(freedom, -np.abs(t)))
    return np.asarray(np.sign(t) * np.minimum(score, MOST_Z))


def _filled(samples: Floats) -> Floats:
    """(c,) effective number of blocks that fill each cell, ``(sum N)^2 / sum N^2``."""
    return np.asarray(samples.sum(axis=0) ** 2 / np.maximum((samples**2).sum(axis=0), 1.0))


def _scatter(replicates: Floats, usual: Floats) -> Floats:
    """(c,) standard deviation about ``usual`` over the replicates in which the cell was drawn."""
    finite = np.isfinite(replicates)
    square = np.where(finite, (replicates - usual) ** 2, 0.0).sum(axis=0)
    return np.asarray(np.sqrt(square / np.maximum(finite.sum(axis=0), 1)))


def _memory(sums: BlockSums) -> float:
    """By what factor the correlation of neighbouring blocks widens the scatter of a mean, at least
    1.

    ``sqrt((1 + rho)/(1 - rho))`` with the correlation ``rho`` of the means of neighbouring blocks,
    limited to 0.6: a residual that wanders for minutes is a finding of its own.
    """
    filled = sums.all_samples > 0
    means = sums.all_residual[filled] / sums.all_samples[filled]
    means = means - means.mean()
    power = float(means @ means)
    if power <= 0.0:
        return 1.0
    rho = float(np.clip(means[1:] @ means[:-1] / power, 0.0, MOST_MEMORY))
    return float(np.sqrt((1.0 + rho) / (1.0 - rho)))


def scores(sums: BlockSums) -> tuple[Floats, Floats]:
    """(c,) z of each cell's share against its weight, and z of its mean against zero.

    Of ``log(share / weight)`` and of the mean, by a block bootstrap with 400 multinomial draws,
    on Student's t with (filled blocks - 1) degrees of freedom; 0 where fewer than four blocks
    fill a cell.
    """
    draws = _draws(sums.samples.shape[0])
    filled = _filled(sums.samples)
    with np.errstate(divide="ignore", invalid="ignore"):
        level = np.log(sums.energy.sum(axis=0) / sums.samples.sum(axis=0))
        level -= np.log(sums.all_energy.sum() / sums.all_samples.sum())
        samples = draws @ sums.samples
        overall = np.log((draws @ sums.all_energy) / (draws @ sums.all_samples))
        levels = np.log((draws @ sums.energy) / samples) - overall[:, None]
        mean = sums.residual.sum(axis=0) / sums.samples.sum(axis=0)
        means = (draws @ sums.residual) / samples
    enough_blocks = filled >= LEAST_BLOCKS
    freedom = np.maximum(filled - 1.0, 1.0)
    # The bootstrap of few blocks, and of correlated blocks, is too narrow by this factor.
    widen = np.sqrt(filled / freedom) * _memory(sums)

    def score(value: Floats, replicates: Floats) -> Floats:
        usable = enough_blocks & np.isfinite(value)
        value = np.where(usable, value, 0.0)
        spread = np.maximum(_scatter(replicates, value) * widen, _NO_SCATTER)
        return np.where(usable, _normal_score(value / spread, freedom), 0.0)

    return score(level, levels), score(mean, means)


def cells_of(facet: Facet, sums: BlockSums) -> tuple[Cell, ...]:
    """The cells of a facet that hold samples, with shares, means and significance."""
    z, bias_z = scores(sums)
    energy = max(float(sums.all_energy.sum()), 1e-300)
    total = float(sums.all_samples.sum())
    cells = []
    for i, label in enumerate(facet.labels):
        count = float(sums.samples[:, i].sum())
        if count == 0.0:
            continue
        square = float(sums.energy[:, i].sum())
        cells.append(
            Cell(
                facet=facet.name,
                label=label,
                samples=int(count),
                weight=count / total,
                share=square / energy,
                mean=float(sums.residual[:, i].sum()) / count,
                rms=float(np.sqrt(square / count)),
                z=float(z[i]),
                bias_z=float(bias_z[i]),
            )
        )
    return tuple(cells)
