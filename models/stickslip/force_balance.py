"""The force balance of a drive, read off a recording that resolves its motion.

Where a position is recorded many times while it gathers speed, speed and acceleration can be taken
from it, and the balance of a drive of finite gain is linear in what is sought:

    OP - x = zero + a z + b z^2 + c z^3 + S/2 sign(v) + tau v + tau tau_r dv/dt,   z = (x - 50)/50

This is how the dynamics of robots are identified (Gautier 1997, doi:10.1109/ROBOT.1997.606824:
inverse model, low-pass differentiation, least squares). Here the least squares are robust, and the
low pass is a parabola over twice the run-up ``tau_r``, which is found with it. The balance decides
whether the recording shows a drive, and where the fits of ``explain`` then begin: for a valve that
slips between two samples no such balance holds.

Two things are asked besides. Where the voltage meets its limit, ``OP - x`` counts up to an error
``m`` only, which is searched. In gears friction grows with the load that they carry, by
``k |zero + load(x)| sign(v)``; S is then the mean over the samples.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

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
GROWTH_ROUNDS = 3
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
# Where next to nothing is left, no inertia need show. Of 170 simulated valves of which those with
# a lag are taken for 20 times as fast as they are, none that lags by as much leaves less than
# 0.12; drives with hardly any inertia leave 0.01 to 0.04 (`bench_other_motors.py`, seeds 1 to 3).
NEXT_TO_NOTHING, LEAST_LAG_OF_CLEAR = 0.065, 1.5
# A voltage that meets its limit is believed where the mean error that the balance leaves, as a
# share of what it explains, is at most half of what it is without a limit, and little. In between
# the limit may be there, and S of neither balance is known. Simulated motors (seeds 1 to 3) whose S
# is right behind a limit leave 0.01 to 0.06, others 0.07 to 0.1; the recorded servo, whose S is
# near the law without one, leaves 0.13 and more.
MOST_OF_UNLIMITED, LEFT_BEHIND_LIMIT, LEFT_BEHIND_DOUBTFUL_LIMIT = 0.5, 0.065, 0.11
LIMITS = (99.0, 98.0, 97.0, 95.0, 92.0, 89.0, 86.0, 83.0, 80.0, 75.0, 70.0, 65.0, 60.0, 50.0, 40.0)
NEAR_A_LIMIT = np.linspace(0.85, 1.15, 13)
# Friction that grows with the load is believed where it takes so much of what is left, and is no
# more than half of the load; where it may be there, the interval of S must hold both.
GROWS, MAY_GROW, MOST_GROWTH = 0.65, 0.9, 0.5
# Standard error of S as a share of the limit, of a motor that gives way to its load: it then falls
# and swings, and one (of a test) has S off by 0.065 of the limit.
NEAR_THE_LIMIT, OF_THE_LIMIT = 0.8, 0.05
NOT_AS_A_WHOLE = (
    "parts of the recording are those of a motor drive, but no model of one follows the whole of "
    "it; record it with smaller or slower moves, or for longer"
)
AT_LIMIT = (
    "the motor meets the limit of its voltage or cannot hold its load, so that what OP asks for "
    "does not tell the force; record it with smaller or slower moves, or with less load"
)
MOST_LOAD = 60.0  # percent: each coefficient of a load, either way
FEWEST = 300  # samples
LOADS = slice(1, 4)
FRICTION, SPEED, INERTIA, GROWTH = 4, 5, 6, 7  # among the coefficients; growth may lack
REPLICATES = 240
SLOW = 0.1  # of the median speed, below which the sign of motion is uncertain


@dataclass(frozen=True)
class ForceBalance:
    """The fitted force balance, in percent and units of the recording's clock.

    ``load`` (3,) are a, b and c; ``left`` is the robust spread of what remains, percent.
    ``S_replicates`` (REPLICATES,) are the values of S from the block bootstrap, ``rival_S`` that of
    friction which grows with the load, where it is not excluded. ``most_error`` is the error at
    which the voltage meets its limit, or infinite. ``least_error`` is the standard error that S has
    at least because the motor cannot hold its load, percent.
    """

    S: float
    S_replicates: Floats
    rival_S: float | None
    least_error: float
    zero: float
    load: Floats
    lag_s: float
    run_up_s: float
    top_speed: float  # percent a unit: the fastest motion that was seen
    most_error: float
    left: float
    is_quick: bool  # as no valve is that air moves


def force_balance(problem: FitProblem) -> ForceBalance | str | None:
    """The balance of the drive; ``None`` where the recording shows none, and a reason where there
    is one but its friction cannot be told."""
    seen = _resolved(problem, RUN_UPS_TO_SEE, FIRST_WINDOW)
    if seen is None:
        return None
    shown = seen.tells()
    if not (shown or (seen.is_quick and seen.limit_is_doubtful)):
        return None
    resolved = _resolved(problem, RUN_UPS, SHORTEST)
    if resolved is None:
        return None
    tells = shown and seen.load_is_credible
    if not resolved.load_is_credible or not (tells or np.isfinite(resolved.most_error)):
        return AT_LIMIT if seen.is_quick else None
    return _balance(problem, seen, resolved)


def moves_as_a_motor(problem: FitProblem) -> bool:
    """Whether the recording shows a drive that is quicker than a valve moved by air: its lag is no
    sign that OP was stored late, and what a load pulls no curve from OP to stroke."""
    balance = force_balance(problem)
    return balance.is_quick if isinstance(balance, ForceBalance) else balance is not None


def balance_of_part(problem: FitProblem) -> ForceBalance | None:
    """The balance of a part of the recording of what is known to be a drive; ``None`` where it
    hardly moves in it."""
    seen = _resolved(problem, RUN_UPS_TO_SEE, FIRST_WINDOW)
    resolved = _resolved(problem, RUN_UPS, SHORTEST)
    return None if seen is None or resolved is None else _balance(problem, seen, resolved)


def _balance(problem: FitProblem, seen: _Regression, resolved: _Regression) -> ForceBalance:
    growing = resolved.with_growth()
    rival_S = None
    if growing is not None and growing.left <= GROWS * resolved.left:
        resolved = growing
    elif growing is not None:
        rival_S = max(2.0 * float(growing.coefficients[FRICTION]), 0.0)
    dt = problem.interval_s
    zero, *load, friction, lag, _ = resolved.coefficients[:GROWTH].tolist()
    return ForceBalance(
        S=max(2.0 * float(friction), 0.0),
        S_replicates=np.maximum(2.0 * resolved.bootstrapped()[:, FRICTION], 0.0),
        rival_S=rival_S,
        least_error=OF_THE_LIMIT * resolved.most_error if resolved.gives_way else 0.0,
        zero=-float(zero),
        load=np.array(load),
        lag_s=max(float(lag), SHORT_RUN_UP) * dt,
        run_up_s=max(seen.run_up, resolved.run_up, SHORT_RUN_UP) * dt,
        top_speed=resolved.top_speed / dt,
        most_error=resolved.most_error,
        left=resolved.left,
        is_quick=seen.is_quick,
    )


def _resolved(problem: FitProblem, run_ups: float, shortest: int) -> _Regression | None:
    """The regression by a low pass over so many run-ups, which it finds itself, of ``shortest``
    samples at least; ``None`` where the stem hardly moves, or is slow without inertia."""
    window, regression = FIRST_WINDOW, None
    for _ in range(ROUNDS):
        regression = _Regression.of(problem, window)
        if regression is None or not (regression.run_up > 0.0 or _may_be_quick(problem)):
            return None
        wanted = run_ups * max(regression.run_up, 0.0)
        wanted_window = int(np.clip(round(wanted), shortest, LONGEST)) | 1
        if abs(wanted_window - window) <= 2:
            break
        window = wanted_window
    return regression


def _may_be_quick(problem: FitProblem) -> bool:
    """True where a lag as short as that of a motor takes several samples."""
    return LEAST_LAG * problem.interval_s * problem.unit_s <= LONGEST_LAG_S


@dataclass(frozen=True)
class _Regression:
    """Coefficients (7,) in samples, or (8,) with friction that grows, and the robust spreads: of
    the force, which is OP - MV up to ``most_error``, and of what is left of it.

    ``rows`` (m, 7 or 8), ``force`` (m,), their weights and blocks; ``sample_s`` from sample to
    sample.
    """

    coefficients: Floats
    spread: float
    left: float
    top_speed: float
    rows: Floats
    force: Floats
    weight: Floats
    block: NDArray[np.int64]
    sample_s: float
    most_error: float = np.inf
    limit_is_doubtful: bool = False

    @classmethod
    def of(cls, problem: FitProblem, window: int) -> _Regression | None:
        """By a low pass of ``window`` samples; ``None`` for too little motion."""
        rows, off, block = _rows(problem, window)
        if off.size < FEWEST:
            return None
        speeds = np.abs(rows[:, SPEED])
        typical = float(np.median(speeds))
        if typical <= 0.0:
            return None
        rows[:, FRICTION] = np.tanh(rows[:, SPEED] / (SLOW * typical))
        most_error, doubtful = _limit(rows, off) if _may_be_quick(problem) else (np.inf, False)
        force = np.clip(off, -most_error, most_error)
        coefficients, weight, spread_left = _robust(rows, force)
        return cls(
            coefficients,
            _spread(force - np.median(force)),
            spread_left,
            float(np.percentile(speeds, 99.5)),
            rows,
            force,
            weight,
            block,
            problem.interval_s * problem.unit_s,
            most_error,
            doubtful,
        )

    def with_growth(self) -> _Regression | None:
        """The same with friction that grows with the load; ``None`` where it does not."""
        coefficients, weight, spread_left, rows = (
            self.coefficients,
            self.weight,
            self.left,
            self.rows,
        )
        for _ in range(GROWTH_ROUNDS):
            load = np.abs(self.rows[:, :FRICTION] @ coefficients[:FRICTION])
            growth = self.rows[:, FRICTION] * (load - load.mean())
            rows = np.column_stack((self.rows, growth))
            coefficients, weight, spread_left = _robust(rows, self.force)
        if not 0.0 < coefficients[GROWTH] <= MOST_GROWTH or spread_left > MAY_GROW * self.left:
            return None
        return replace(self, coefficients=coefficients, weight=weight, left=spread_left, rows=rows)

    @property
    def run_up(self) -> float:
        """The run-up in samples: inertia over lag."""
        return float(self.coefficients[INERTIA] / max(self.coefficients[SPEED], 1e-9))

    @property
    def gives_way(self) -> bool:
        """Whether the load comes near what the motor can hold at the limit of its voltage; it does
        not go much further, since the motor then gives way."""
        loads = np.abs(self.rows[:, :FRICTION] @ self.coefficients[:FRICTION])
        return bool(float(np.percentile(loads, 98.0)) > NEAR_THE_LIMIT * self.most_error)

    @property
    def is_quick(self) -> bool:
        """True where the lag is as short as a motor's, and some samples long."""
        lag = self.coefficients[SPEED]
        return bool(LEAST_LAG_OF_CLEAR <= lag <= LONGEST_LAG_S / self.sample_s)

    @property
    def load_is_credible(self) -> bool:
        """Whether it is one that is looked for; a motor that gives way to its load seems to have
        one without end."""
        return bool(np.abs(self.coefficients[LOADS]).max() <= MOST_LOAD)

    def _left_of_massless(self) -> float:
        """What is left as a share of what would be without inertia, where inertia shows best."""
        massless = self.rows[:, :INERTIA]
        without_inertia = np.abs(self.force - massless @ _robust(massless, self.force)[0])
        left = np.abs(self.force - self.rows @ self.coefficients)
        sizes = np.percentile((left, without_inertia), OF_THE_RESIDUALS, axis=1)
        return float((sizes[:, 0] / np.maximum(sizes[:, 1], 1e-9)).min())

    def tells(self) -> bool:
        """True where this is a drive whose motion the samples resolve."""
        share_left = self.left / max(self.spread, 1e-9)
        lag = self.coefficients[SPEED]
        if self.is_quick and share_left <= NEXT_TO_NOTHING:
            return True
        if lag * max(self.run_up, LEAST_LAG) < LEAST_LAG**2 or self.run_up < SHORT_RUN_UP:
            return False
        of_massless = self._left_of_massless()
        if self.run_up >= LEAST_RUN_UP:
            return share_left <= MOST_LEFT and of_massless <= MOST_OF_MASSLESS
        return bool(
            self.is_quick and share_left <= LITTLE_LEFT and of_massless <= LITTLE_OF_MASSLESS
        )

    def bootstrapped(self) -> Floats:
        """(REPLICATES, 7 or 8) the coefficients from a block bootstrap. Seeded."""
        numbers, block_index = np.unique(self.block, return_inverse=True)
        counts = np.bincount(block_index).astype(np.float64)
        size = self.rows.shape[1]
        squares, sums = np.empty((numbers.size, size, size)), np.empty((numbers.size, size))
        for i in range(numbers.size):
            rows, weighted = self.rows[block_index == i], self.weight[block_index == i]
            squares[i] = (rows * weighted[:, None]).T @ rows
            sums[i] = (rows * weighted[:, None]).T @ self.force[block_index == i]
        times = block_weights(counts, REPLICATES, np.random.default_rng(13))
        ridge = 1e-9 * np.einsum("bii->i", squares) * np.eye(size)
        normal_matrices = np.einsum("rb,bij->rij", times, squares) + ridge
        return np.linalg.solve(normal_matrices, (times @ sums)[:, :, None])[:, :, 0]


def _limit(rows: Floats, off: Floats) -> tuple[float, bool]:
    """The error at which the voltage meets its limit, infinite where none shows, and whether one
    shows that leaves too much to be believed."""
    unlimited = _share_left(rows, off, np.inf)
    sizes = np.abs(off)
    tried = [float(np.percentile(sizes, percent)) for percent in LIMITS]
    limit = min(tried, key=lambda most: _share_left(rows, off, most))
    limit = min((limit * NEAR_A_LIMIT).tolist(), key=lambda most: _share_left(rows, off, most))
    left = _share_left(rows, off, limit)
    if left > min(MOST_OF_UNLIMITED * unlimited, LEFT_BEHIND_DOUBTFUL_LIMIT):
        return np.inf, False
    return (limit, False) if left <= LEFT_BEHIND_LIMIT else (np.inf, True)


def _share_left(rows: Floats, off: Floats, most_error: float) -> float:
    """The mean size of what the balance leaves of the force, as a share of the force's own.

    Means, because what a limit changes are the few largest errors.
    """
    force = np.clip(off, -most_error, most_error)
    left = np.abs(force - rows @ _robust(rows, force)[0])
    return float(left.mean() / max(float(np.abs(force - np.median(force)).mean()), 1e-9))


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
