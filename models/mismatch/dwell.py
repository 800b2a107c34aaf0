"""Whether breakaways come later the longer the stem has rested, decided from the breakaways alone.

A trajectory is the wrong evidence for this: one unusual breakaway hides what a hundred of them show
together. Each assimilated breakaway gives how far the force was from its level, and the recording
gives how long the stem had rested. A breakaway that comes late by chance has rested a little longer
for it, so that a small slope is found on valves without dwell too: the limit is high.

Bristles let go later the slower the force on them grows, and a slow force means a long rest: such a
packing looks as if it had dwell. So the slope must remain significant beside two more regressors,
the command's speed and its logarithm.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtri, stdtr

from stemwatch.models.mismatch import evaluator as base_coordinate
from stemwatch.models.mismatch.batched_search import conclude
from stemwatch.models.mismatch.crossfit import CAREFUL, Fitted, refit, scored
from stemwatch.models.mismatch.evaluator import Evaluator
from stemwatch.models.mismatch.terms.dwell_dependent_breakaway import T0_S
from stemwatch.models.recording import Floats
from stemwatch.models.stickslip.parameters import Bounds

SLUG = "dwell_dependent_breakaway"
FEWEST_EVENTS = 10
# Largest of 170 simulated valves without dwell, 12 % scatter among them: 4.2.
LEAST_Z = 5.2
# Beside the command's speed: four simulated valves with dwell that pass the first limit have 4.8
# and more (draw_effect, seeds 4021 and 6161); a LuGre packing without dwell that does has 3.7
# (`draw_valves`, seed 8181; 6.7 beside the logarithm alone).
LEAST_Z_BESIDE_SPEED, SLOWEST_PERCENT = 4.2, 0.01
LEAST_RISE, MOST_RISE = 0.1, 1.0  # percent of span per e-fold of rest
ROUNDS, WIDE = 12, 2.0  # of reweighting; scales from which an event counts less than half
MOST_Z = 8.0
_SMALLEST = 1e-6


@dataclass(frozen=True)
class Dwelling:
    """``rise`` of the breakaway, percent of span per e-fold of ``1 + rest/t0``, with its standard
    ``error`` and normal score ``z``, ``z_beside_speed`` the score with the command's speed beside
    it; ``usual`` is the mean of ``ln(1 + rest/t0)``, ``events`` the number of breakaways.
    """

    rise: float
    error: float
    z: float
    usual: float
    events: int
    z_beside_speed: float

    @property
    def convincing(self) -> bool:
        """True where the slope is beyond what valves without dwell show, and not more than dwell
        can make.
        """
        if self.z_beside_speed < LEAST_Z_BESIDE_SPEED:
            return False
        return self.z >= LEAST_Z and LEAST_RISE <= self.rise <= MOST_RISE


def dwelling(evaluator: Evaluator, fitted: Fitted) -> Dwelling | None:
    """The slope of how late breakaways come over the logarithm of the rest before.

    Robust regression (Cauchy's weights) with one level for each direction, on the breakaways that
    the model assimilates; Student's t read as a normal score. ``None`` with fewer than ten, and
    where an archive drew lines, so that the time of a breakaway is not known well enough.
    """
    if evaluator.slack.any():
        return None
    candidate = fitted.candidates.mean(axis=0)
    _, early_late = evaluator.assimilated(fitted.layout, candidate)
    seen = early_late != 0.0
    late = early_late[seen]
    if late.size < FEWEST_EVENTS:
        return None
    rested = evaluator.onsets.rested[seen] * evaluator.problem.interval_s
    side = evaluator.onsets.side[seen]
    onset_samples = evaluator.onsets.at[seen]
    op_speed = np.abs(evaluator.problem.op[onset_samples] - evaluator.problem.op[onset_samples - 1])
    speed = np.log(np.maximum(op_speed, SLOWEST_PERCENT))
    columns = np.column_stack((side > 0.0, side < 0.0, np.log1p(rested / T0_S))).astype(np.float64)
    columns = columns[:, columns.any(axis=0)]
    slope, error, z = _score(columns, late)
    beside_speed = np.column_stack((op_speed, speed, columns))
    usual_dwell = float(np.mean(columns[:, -1]))
    return Dwelling(slope, error, z, usual_dwell, int(late.size), _score(beside_speed, late)[2])


def _score(columns: Floats, late: Floats) -> tuple[float, float, float]:
    """The last coefficient, its standard error, and Student's t of it as a normal score."""
    slope, error = _slope(columns, late)
    t = slope / max(error, _SMALLEST)
    z = float(-ndtri(stdtr(late.size - columns.shape[1], -abs(t))) * np.sign(t))
    return slope, error, float(np.clip(z, -MOST_Z, MOST_Z))


def refit_with_rise(evaluator: Evaluator, neutral_fit: Fitted, seen: Dwelling) -> Fitted:
    """``neutral_fit``, a fit with the term of dwell at neutral, refitted with the rise that was
    ``seen``.

    The rise is held within two standard errors of that value: trajectories are hardly sensitive to
    it, and the fit would trade it for a larger S and J.
    """
    coordinate_slice = neutral_fit.layout.places[SLUG]
    low, high = neutral_fit.layout.bounds.low.copy(), neutral_fit.layout.bounds.high.copy()
    low[coordinate_slice] = max(seen.rise - 2.0 * seen.error, LEAST_RISE)
    high[coordinate_slice] = min(seen.rise + 2.0 * seen.error, MOST_RISE)
    layout = replace(neutral_fit.layout, bounds=Bounds(low, high))
    candidates = neutral_fit.candidates.copy()
    S, J = (
        candidates[:, base_coordinate.S_PERCENT],
        candidates[:, base_coordinate.S_PERCENT] * candidates[:, base_coordinate.RATIO],
    )
    # Dwell raises the breakaway only, so S and J were both fitted too large by the usual rise.
    lower_by = np.minimum(seen.rise * seen.usual, 0.9 * J)
    candidates[:, base_coordinate.S_PERCENT] = S - lower_by
    candidates[:, base_coordinate.RATIO] = (J - lower_by) / np.maximum(S - lower_by, _SMALLEST)
    candidates[:, coordinate_slice] = seen.rise
    first = conclude(evaluator, scored(layout, layout.bounds.clip(candidates)))
    return conclude(evaluator, refit(evaluator, first, CAREFUL))


def _slope(columns: Floats, values: Floats) -> tuple[float, float]:
    """The last coefficient of a robust regression and its standard error."""
    weight = np.ones(values.size)
    residual = values
    for _ in range(ROUNDS):
        weighted = columns * weight[:, None]
        normal = weighted.T @ columns
        coefficients = np.linalg.lstsq(normal, weighted.T @ values, rcond=None)[0]
        residual = values - columns @ coefficients
        scale = WIDE * 1.4826 * float(np.median(np.abs(residual))) + _SMALLEST
        weight = 1.0 / (1.0 + (residual / scale) ** 2)
    freedom = max(values.size - columns.shape[1], 1)
    variance = float(weight @ residual**2) / freedom * values.size / float(weight.sum())
    spread = np.linalg.pinv((columns * weight[:, None]).T @ columns) * variance
    return float(coefficients[-1]), float(np.sqrt(max(spread[-1, -1], 0.0)))
