"""The force balance of a drive, read off a recording that resolves its motion.

Where a position is recorded many times while it gathers speed, speed and acceleration can be taken
from it, and the balance of a drive of finite gain is linear in what is sought:

    OP - x = zero + a z + b z^2 + c z^3 + S/2 sign(v) + tau v + tau tau_r dv/dt,   z = (x - 50)/50

This is how the dynamics of robots are identified (Gautier 1997, doi:10.1109/ROBOT.1997.606824:
inverse model, low-pass differentiation, least squares). Here the least squares are robust, and the
low pass is a parabola over twice the run-up ``tau_r``, which is found with it. The balance decides
whether the recording shows a drive, and where the fits of ``explain`` then begin: for a valve that
slips between two samples no such balance holds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.recording import Floats
from stemwatch.models.statistics.block_bootstrap import block_weights
from stemwatch.models.stickslip.kernel import START
from stemwatch.models.stickslip.problem import FitProblem

FIRST_WINDOW, SHORTEST, LONGEST = 15, 7, 241  # samples of the low pass
# Run-ups in a window: a long one, of fifteen samples at least, shows best whether there is inertia,
# through the steps of a coarse encoder too; a short one blurs friction less where the stem
# reverses. With two, S of simulated drives is within 3 % of the truth.
RUN_UPS_TO_SEE, RUN_UPS = 3.0, 2.0
ROUNDS = 4  # of window and run-up
REWEIGHTS = 12
SPIKES = 5  # samples of the running median that takes single wrong readings out
# Signs of a drive whose motion is resolved: lag and run-up in samples, what the balance leaves as a
# share of the spread of OP - MV, and as a share of what a balance without inertia leaves. Servo
# drives recorded at 100 Hz: 6 and more, 3.5, at most 0.13 and 0.75. Of 142 simulated valves at 1 s
# none. A motor that is hardly damped has a short lag and a long run-up; then its swing must be
# resolved, whose period is 2 pi times the root of their product.
LEAST_LAG, LEAST_RUN_UP, MOST_LEFT, MOST_OF_MASSLESS = 3.0, 1.5, 0.22, 0.85
# A run-up of half a sample shows where the balance leaves less and inertia explains more. A valve
# that air moves behind a lag of some samples looks nearly so: of 130 of `draw_cases(400, 4090)`, at
# 1 s, two leave 0.72 and 0.78 of the massless. A motor is faster besides.
SHORT_RUN_UP, LITTLE_LEFT, LITTLE_OF_MASSLESS, LONGEST_LAG_S = 0.5, 0.1, 0.65, 1.0
# Inertia shows in the fast parts of a recording, which may be half of it or a tenth.
OF_THE_RESIDUALS = (50.0, 75.0, 90.0)  # percentiles of their size
FEWEST = 300  # samples
FRICTION, SPEED, INERTIA = 4, 5, 6  # among the coefficients
REPLICATES = 240
SLOW = 0.1  # of the median speed, below which the sign of motion is uncertain


@dataclass(frozen=True)
class ForceBalance:
    """The fitted force balance, in percent and units of the recording's clock.

    ``load`` (3,) are a, b and c; ``left`` is the robust spread of what remains, percent.
    ``S_replicates`` (REPLICATES,) are the values of S from the block bootstrap.
    """

    S: float
    S_replicates: Floats
    zero: float
    load: Floats
    lag_s: float
    run_up_s: float
    top_speed: float  # percent a unit: the fastest motion that was seen
    left: float


def force_balance(problem: FitProblem) -> ForceBalance | None:
    """The balance of the drive, or ``None`` where the recording shows none."""
    seen = _resolved(problem, RUN_UPS_TO_SEE, FIRST_WINDOW)
    if seen is None or not seen.tells():
        return None
    resolved = _resolved(problem, RUN_UPS, SHORTEST)
    if resolved is None:
        return None
    dt = problem.interval_s
    zero, *load, friction, lag, _ = resolved.coefficients.tolist()
    return ForceBalance(
        S=max(2.0 * float(friction), 0.0),
        S_replicates=np.maximum(2.0 * resolved.bootstrapped()[:, FRICTION], 0.0),
        zero=-float(zero),
        load=np.array(load),
        lag_s=float(lag) * dt,
        run_up_s=max(seen.run_up, resolved.run_up) * dt,
        top_speed=resolved.top_speed / dt,
        left=resolved.left,
    )


def _resolved(problem: FitProblem, run_ups: float, shortest: int) -> _Regression | None:
    """The regression by a low pass over so many run-ups, which it finds itself, of ``shortest``
    samples at least; ``None`` where the stem hardly moves, or shows no inertia."""
    window, regression = FIRST_WINDOW, None
    for _ in range(ROUNDS):
        regression = _Regression.of(problem, window)
        if regression is None or not regression.run_up > 0.0:
            return None
        wanted_window = int(np.clip(round(run_ups * regression.run_up), shortest, LONGEST)) | 1
        if abs(wanted_window - window) <= 2:
            break
        window = wanted_window
    return regression


@dataclass(frozen=True)
class _Regression:
    """Coefficients (7,) in samples, and the robust spreads: of OP - MV, and of what is left.
    ``rows`` (m, 7), ``off`` (m,), their weights and blocks; ``sample_s`` from sample to sample."""

    coefficients: Floats
    spread: float
    left: float
    top_speed: float
    rows: Floats
    off: Floats
    weight: Floats
    block: NDArray[np.int64]
    sample_s: float

    @classmethod
    def of(cls, problem: FitProblem, window: int) -> _Regression | None:
        """By a low pass of ``window`` samples; ``None`` for too little motion."""
        rows, residuals, block = _rows(problem, window)
        if residuals.size < FEWEST:
            return None
        speeds = np.abs(rows[:, SPEED])
        typical = float(np.median(speeds))
        if typical <= 0.0:
            return None
        rows[:, FRICTION] = np.tanh(rows[:, SPEED] / (SLOW * typical))
        coefficients, weight, spread_left = _robust(rows, residuals)
        spread, top_speed = (
            _spread(residuals - np.median(residuals)),
            float(np.percentile(speeds, 99.5)),
        )
        return cls(
            coefficients,
            spread,
            spread_left,
            top_speed,
            rows,
            residuals,
            weight,
            block,
            problem.interval_s * problem.unit_s,
        )

    @property
    def run_up(self) -> float:
        """The run-up in samples: inertia over lag."""
        return float(self.coefficients[INERTIA] / max(self.coefficients[SPEED], 1e-9))

    def _left_of_massless(self) -> float:
        """What is left as a share of what would be without inertia, where inertia shows best."""
        massless = self.rows[:, :INERTIA]
        without_inertia = np.abs(self.off - massless @ _robust(massless, self.off)[0])
        left = np.abs(self.off - self.rows @ self.coefficients)
        sizes = np.percentile((left, without_inertia), OF_THE_RESIDUALS, axis=1)
        return float((sizes[:, 0] / np.maximum(sizes[:, 1], 1e-9)).min())

    def tells(self) -> bool:
        """True where this is a drive whose motion the samples resolve."""
        share_left = self.left / max(self.spread, 1e-9)
        of_massless = self._left_of_massless()
        if self.coefficients[SPEED] * max(self.run_up, LEAST_LAG) < LEAST_LAG**2:
            return False
        if self.run_up >= LEAST_RUN_UP:
            return share_left <= MOST_LEFT and of_massless <= MOST_OF_MASSLESS
        return bool(
            self.run_up >= SHORT_RUN_UP
            and share_left <= LITTLE_LEFT
            and of_massless <= LITTLE_OF_MASSLESS
            and self.coefficients[SPEED] * self.sample_s <= LONGEST_LAG_S
        )

    def bootstrapped(self) -> Floats:
        """(REPLICATES, 7) the coefficients from a block bootstrap. Seeded."""
        numbers, block_index = np.unique(self.block, return_inverse=True)
        counts = np.bincount(block_index).astype(np.float64)
        squares, sums = np.empty((numbers.size, 7, 7)), np.empty((numbers.size, 7))
        for i in range(numbers.size):
            rows, weighted = self.rows[block_index == i], self.weight[block_index == i]
            squares[i] = (rows * weighted[:, None]).T @ rows
            sums[i] = (rows * weighted[:, None]).T @ self.off[block_index == i]
        times = block_weights(counts, REPLICATES, np.random.default_rng(13))
        ridge = 1e-9 * np.einsum("bii->i", squares) * np.eye(7)
        normal_matrices = np.einsum("rb,bij->rij", times, squares) + ridge
        return np.linalg.solve(normal_matrices, (times @ sums)[:, :, None])[:, :, 0]


def _rows(problem: FitProblem, window: int) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """(m, 7) the regressors at scored samples, the sign of motion still 0, (m,) OP - MV, and the
    blocks of time (m,)."""
    from scipy.ndimage import median_filter

    begins = np.flatnonzero(problem.start == START)
    ends = np.append(begins[1:], problem.op.size)
    rows, off_values, block = [np.empty((0, 7))], [np.empty(0)], [np.empty(0, dtype=np.int64)]
    for begin, end in zip(begins, ends, strict=True):
        if end - begin < 2 * window:
            continue
        mv = median_filter(problem.mv[begin:end], SPIKES)
        x, v, a = parabolas(mv, window)
        z = np.clip(x / 50.0 - 1.0, -1.0, 1.0)
        table = np.stack((np.ones_like(x), z, z**2, z**3, np.zeros_like(x), v, a), axis=1)
        scored = problem.scored[begin:end]
        rows.append(table[scored])
        off_values.append((problem.op[begin:end] - x)[scored])
        block.append(problem.block[begin:end][scored])
    return np.vstack(rows), np.concatenate(off_values), np.concatenate(block)


def parabolas(values: Floats, window: int) -> Floats:
    """(3, n) value, slope and curvature a sample, by the parabola fitted to the ``window`` samples
    around each of ``values`` (n,); ``window`` is odd. Near an end, the parabola of the first or
    last ``window`` samples.

    The filter of Savitzky and Golay (1964, doi:10.1021/ac60214a047), the same to the bit as
    ``scipy.signal.savgol_filter``, whose package takes half a second to import.
    """
    from scipy.ndimage import convolve1d

    half, sample_times = window // 2, np.arange(float(window))
    powers = (half - sample_times) ** np.arange(3.0)[:, None]
    tolerance = np.finfo(np.float64).eps * window
    passed = np.empty((3, values.size))
    first, last = (
        np.polyfit(sample_times, ends, 2) for ends in (values[:window], values[-window:])
    )
    for order, wanted_moments in enumerate(np.diag((1.0, 1.0, 2.0))):
        weights = np.linalg.lstsq(powers, wanted_moments, rcond=tolerance)[0]
        passed[order] = convolve1d(values, weights, mode="constant")
        passed[order, :half] = np.polyval(first, sample_times[:half])
        passed[order, -half:] = np.polyval(last, sample_times[-half:])
        first, last = np.polyder(first), np.polyder(last)
    return passed


def _robust(rows: Floats, targets: Floats) -> tuple[Floats, Floats, float]:
    """Least squares with the weights of Cauchy's loss: coefficients (k,), weights, and the spread
    that is left."""
    weight: Floats = np.ones(targets.size)
    coefficients: Floats = np.zeros(rows.shape[1])
    spread_left = 0.0
    for _ in range(REWEIGHTS):
        weighted = rows * weight[:, None]
        solved = np.linalg.lstsq(weighted.T @ rows, weighted.T @ targets, rcond=None)[0]
        coefficients = np.asarray(solved, dtype=np.float64)
        residual = targets - rows @ coefficients
        spread_left = max(_spread(residual), 1e-6)
        weight = np.asarray(1.0 / (1.0 + (residual / (2.0 * spread_left)) ** 2))
    return coefficients, weight, spread_left


def _spread(residual: Floats) -> float:
    """A standard deviation that outliers do not move."""
    return 1.4826 * float(np.median(np.abs(residual)))
