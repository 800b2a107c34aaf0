"""How well a simulated position follows the measured one: RMSE, fit and direction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stemwatch.models.recording import Bools, Floats

LEAST_SCORED = 20


@dataclass(frozen=True, kw_only=True)
class FitScore:
    """A free run against ``samples`` measured positions.

    ``rmse`` in percent of travel. ``fit_percent`` = 100 (1 - rmse / std(MV)): 0 is no better than a
    constant. ``direction_percent``, correct directional change: the share of steps in which the
    simulated and the measured stem both rise, both fall or both stay, where a step smaller than the
    resolution of the measurement counts as staying. The formula that Zabiri, Samyudia and Zainudin
    use is in a source that is not available; this one is the product's own.
    """

    rmse: float
    fit_percent: float
    direction_percent: float
    samples: int


def score(simulated: Floats, mv: Floats, is_scored: Bools, resolution: float) -> FitScore | None:
    """Score where ``is_scored`` (n,), or ``None`` with fewer than 20 samples or a constant MV.

    ``resolution`` in percent: a step of MV up to this is noise.
    """
    is_scored = is_scored & np.isfinite(simulated)
    if is_scored.sum() < LEAST_SCORED or np.ptp(mv[is_scored]) == 0.0:
        return None
    rmse = float(np.sqrt(np.mean((simulated[is_scored] - mv[is_scored]) ** 2)))
    return FitScore(
        rmse=rmse,
        fit_percent=100.0 * (1.0 - rmse / float(np.std(mv[is_scored]))),
        direction_percent=_directions(simulated, mv, is_scored, resolution),
        samples=int(is_scored.sum()),
    )


def _directions(simulated: Floats, mv: Floats, is_scored: Bools, resolution: float) -> float:
    pairs = is_scored[1:] & is_scored[:-1]
    if not pairs.any():
        return float("nan")
    directions = [_directions_of(np.diff(signal)[pairs], resolution) for signal in (simulated, mv)]
    return 100.0 * float(np.mean(directions[0] == directions[1]))


def _directions_of(steps: Floats, resolution: float) -> Floats:
    return np.where(np.abs(steps) <= resolution, 0.0, np.sign(steps))
