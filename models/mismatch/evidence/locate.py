"""Where the residual is large, and the few sentences that say so to a maintenance engineer."""

from __future__ import annotations

from math import floor, log10

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.mismatch.evidence.conditioning import (
    PHASES,
    command_speed,
    direction,
    part_of_record,
    phase,
    rest_before,
    travel_band,
    travel_edges,
)
from stemwatch.models.mismatch.evidence.residual_map import Facet, block_sums, cells_of, clipped
from stemwatch.models.mismatch.findings import Cell, HotPlace, ResidualMap
from stemwatch.models.recording import Bools, Floats
from stemwatch.models.words import share

# A cell is hot where it holds half as much again as its size, or where its mean is off. Some
# thirty cells are looked at in two ways, so each needs a level of about one in 2,000.
HOT_Z, HOT_RATIO, BIAS_RATIO = 3.3, 1.5, 1.25
BIAS_Z, BIAS_SIGMAS = 3.5, 2.0
ABOVE_NOISE = 1.5  # times sigma that the rms of a hot cell must reach
LEAST_SHARE = 0.02  # of the squared residual; less is not worth a sentence
LEAST_SAMPLES = 20
MOST_HOT = 5
NEW_SHARE = 0.5  # of its squared residual that a further hot place must not have in common
ONE_SIDED = 0.5  # |mean| / rms from which a sentence gives the side
MOSTLY = 0.8  # and from which it need not say "on average"
LEAST_MOVE = 0.2  # percent in about 3 s, from which a noise-free simulated stem counts as moving
WHOLE = "whole"


def locate(
    op: Floats,
    mv: Floats,
    simulated: Floats,
    scored: Bools,
    block: NDArray[np.int64],
    interval_s: float,
    sigma: float,
    unit_s: float = 1.0,
    stem: Floats | None = None,
) -> ResidualMap:
    """The residual map of ``mv - simulated`` (n,), percent.

    ``scored`` (n,) marks the samples that count, ``block`` (n,) their blocks of time (negative:
    none), ``sigma`` is the noise of MV in percent; times in units of ``unit_s`` seconds. The
    residual is clipped at its 99.5th percentile. ``stem`` (n,), percent, is the run that gives
    place and motion of the stem, where that is not ``simulated``: maps of several models made with
    one ``stem`` have the same samples in each cell. Share, weight and the two z of each cell: see
    ``residual_map.scores``. An empty map where fewer than 100 samples are scored.
    """
    scored = scored & (block >= 0) & np.isfinite(mv) & np.isfinite(simulated)
    if np.count_nonzero(scored) < 100:
        return ResidualMap()
    mv = np.where(np.isfinite(mv), mv, simulated)
    residual = clipped(mv - simulated, scored)
    least = 0.0 if stem is None else LEAST_MOVE
    stem = simulated if stem is None else stem
    edges = travel_edges(stem, scored)
    facets: tuple[Facet, ...] = (
        phase(op, mv, stem, interval_s, sigma, unit_s),
        direction(mv, stem, interval_s, sigma, least),
        rest_before(stem, interval_s, unit_s),
        travel_band(stem, edges),
        command_speed(op, scored, interval_s, unit_s),
        part_of_record(op.size, interval_s, unit_s),
    )
    facets = tuple(facet for facet in facets if facet.labels)
    whole_facet = Facet(
        WHOLE, ("all the time",), np.zeros(op.size, dtype=np.int64), ("All the time",)
    )
    (overall,) = cells_of(whole_facet, block_sums(whole_facet, residual, block, scored))
    cells = [cells_of(facet, block_sums(facet, residual, block, scored)) for facet in facets]
    hot = _hot_places(overall, facets, cells, residual, block, scored, sigma)
    return ResidualMap(
        cells=tuple(cell for of_facet in cells for cell in of_facet),
        hot=hot,
        travel_edges=tuple(float(edge) for edge in edges),
        columns=PHASES,
        grid=_grid(residual, scored, facets, len(edges) - 1),
    )


def _hot_places(
    overall: Cell,
    facets: tuple[Facet, ...],
    cells: list[tuple[Cell, ...]],
    residual: Floats,
    block: NDArray[np.int64],
    scored: Bools,
    sigma: float,
) -> tuple[HotPlace, ...]:
    """The hot ones of the ``cells`` of each facet, strongest first, without those that repeat what
    stronger ones say.

    A constant offset would make every cell hot, so it is said once and subtracted first.
    """
    places = []
    if _biased(overall, sigma):
        places.append(_hot_place(overall, "All the time"))
        residual = np.where(scored, residual - overall.mean, residual)
        cells = [cells_of(facet, block_sums(facet, residual, block, scored)) for facet in facets]
    candidates = [
        (facet, cell)
        for facet, of_facet in zip(facets, cells, strict=True)
        for cell in of_facet
        if _hot(cell, sigma)
    ]
    candidates.sort(key=lambda candidate: -_strength(candidate[1]))
    already_said = np.zeros(residual.size, dtype=bool)
    energy = np.where(scored, residual**2, 0.0)
    for facet, cell in candidates:
        number = facet.labels.index(cell.label)
        in_cell = facet.code == number
        own_energy = float(energy[in_cell].sum())
        if float(energy[in_cell & ~already_said].sum()) < NEW_SHARE * own_energy:
            continue
        already_said |= in_cell
        places.append(_hot_place(cell, facet.phrases[number]))
        if len(places) == MOST_HOT:
            break
    return tuple(places)


def _biased(cell: Cell, sigma: float) -> bool:
    """True where the mean of a cell is off by more than noise and chance."""
    return abs(cell.mean) > BIAS_SIGMAS * sigma and abs(cell.bias_z) > BIAS_Z


def _hot(cell: Cell, sigma: float) -> bool:
    """True where a cell holds more than its size, or is off to one side."""
    if cell.samples < LEAST_SAMPLES or cell.share < LEAST_SHARE:
        return False
    loaded = (
        cell.z > HOT_Z and cell.share > HOT_RATIO * cell.weight and cell.rms > ABOVE_NOISE * sigma
    )
    # A mean that is off in a cell with little of the residual is not worth a look.
    return loaded or (_biased(cell, sigma) and cell.share > BIAS_RATIO * cell.weight)


def _strength(cell: Cell) -> float:
    """The order of hot places: the squared residual beyond the share that the cell's size would
    give.
    """
    return cell.share * (1.0 - min(cell.weight / max(cell.share, 1e-12), 1.0)) + 1e-3 * cell.share


def _hot_place(cell: Cell, phrase: str) -> HotPlace:
    """A hot cell as a sentence."""
    if abs(cell.mean) >= ONE_SIDED * cell.rms or cell.z <= HOT_Z:
        side = "above" if cell.mean > 0.0 else "below"
        usually = "" if abs(cell.mean) >= MOSTLY * cell.rms else " on average"
        difference = f"the position lies{usually} {_percent(abs(cell.mean))} {side} the model"
    else:
        difference = f"position and model differ by {_percent(cell.rms)}, to either side"
    share_clause = f" ({share(cell.share)} of the mismatch in {share(cell.weight)} of the time)"
    if cell.facet == WHOLE:
        share_clause = ""
    z = cell.bias_z if cell.facet == WHOLE or abs(cell.bias_z) > cell.z else cell.z
    return HotPlace(
        facet=cell.facet,
        label=cell.label,
        share=cell.share,
        z=abs(z),
        sentence=f"{phrase}, {difference}{share_clause}.",
    )


def _percent(value: float) -> str:
    """Two figures, no exponent: "1.2 %", "0.34 %", "12 %", "0.0020 %"."""
    digits = 0 if value >= 10.0 else 1 if value >= 1.0 else 2
    if 0.0 < value < 0.1:
        digits = 1 - floor(log10(value))
    return f"{value:.{digits}f} %"


def _grid(
    residual: Floats, scored: Bools, facets: tuple[Facet, ...], rows: int
) -> tuple[tuple[float | None, ...], ...]:
    """Rms in percent of span by travel (rows) and phase (columns); ``None`` where no sample is."""
    by_name = {facet.name: facet for facet in facets}
    cell_code = by_name["travel"].code * len(PHASES) + by_name["phase"].code
    size = rows * len(PHASES)
    count = np.bincount(cell_code[scored], minlength=size)
    square = np.bincount(cell_code[scored], residual[scored] ** 2, minlength=size)
    rms = np.sqrt(square / np.maximum(count, 1))
    values = [float(v) if c else None for v, c in zip(rms, count, strict=True)]
    return tuple(tuple(values[i : i + len(PHASES)]) for i in range(0, size, len(PHASES)))
