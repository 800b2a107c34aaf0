"""The likelihood of a loop's PV where all is known but the stem.

OP drives the stem of ``models.studies.loops.kernel``, whose S, J and breakaway levels are drawn;
behind it all is linear and Gaussian: process, wandering load, noise. So a particle is a stem and
the mean that a Kalman filter has behind it, and all share one covariance (Rao-Blackwellised
particle filter; Chen and Liu 2000, doi:10.1111/1467-9868.00246).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag, solve_discrete_lyapunov

from stemwatch.models.compiled import compiled
from stemwatch.models.recording import Floats
from stemwatch.models.studies.loops.draws import LoopScans
from stemwatch.models.studies.loops.kernel import LoopNumbers

WAYS_TO_STICK, WAYS_TO_BE_SOUND = 1200, 400  # particles
_JITTER = 0.01  # of S and J/S at each resampling, so that they do not die out
WAVE_ORDER = 6
_LEAST_DAMPED = 1.0 - 1e-7
_PROCESS = 3  # states of the process: both lags and the sensor's
_UNKNOWN_START = 20.0  # percent of travel: what the process may stand at


@dataclass(frozen=True, kw_only=True)
class Wave:
    """A signal by its spectrum: ``past`` (p,) weighs its past values, newest first, and what is new
    has this ``variance``."""

    past: Floats
    variance: float

    @property
    def step(self) -> Floats:
        """(p, p) one scan on."""
        shifted: Floats = np.eye(self.past.size, k=-1)
        shifted[:1] = self.past
        return shifted

    def start(self) -> Floats:
        """(p, p) the covariance of its past values."""
        new = np.zeros((self.past.size, self.past.size))
        new[:1, :1] = self.variance
        return np.asarray(solve_discrete_lyapunov(self.step, new)) if new.size else new


NO_WAVE = Wave(past=np.empty(0), variance=0.0)


def wave_of(values: Floats) -> Wave:
    """The spectrum of ``values`` (n,) by Burg's method (Burg 1975), whose past values never
    explode."""
    ahead = values - values.mean()
    if np.ptp(ahead) <= 0.0:
        return NO_WAVE
    behind, weights, variance = ahead.copy(), np.ones(1), float(np.mean(ahead**2))
    for _ in range(WAVE_ORDER):
        ahead, behind = ahead[1:], behind[:-1]
        reflected = -2.0 * float(ahead @ behind) / float(ahead @ ahead + behind @ behind + 1e-12)
        reflected = float(np.clip(reflected, -_LEAST_DAMPED, _LEAST_DAMPED))
        ahead, behind = ahead + reflected * behind, behind + reflected * ahead
        padded = np.append(weights, 0.0)
        weights = padded + reflected * padded[::-1]
        variance *= 1.0 - reflected**2
    return Wave(past=-weights[1:], variance=variance)


@dataclass(frozen=True, kw_only=True)
class KnownLoop:
    """What the filter is told, at every scan of a record (n,).

    ``air`` is the force on the stem, the process' delay ago; ``seen`` PV less what is known of it,
    and ``rounding`` its variance beside the noise; ``shaped`` the known part of the load, and
    ``waves`` the spectra of what is not known of the load's and of PV's own steps and waves.
    """

    numbers: LoopNumbers
    air: Floats
    seen: Floats
    rounding: float
    shaped: Floats
    wandering: Floats  # (m, 2) standard deviation and pole
    where: Floats  # (m, n) what each is multiplied by
    noise: tuple[float, float]  # standard deviation, pole
    waves: tuple[Wave, Wave]


@dataclass(frozen=True, kw_only=True)
class StemLikelihood:
    """ln of the likelihood, and the mean of S at the end."""

    log_likelihood: float
    S: float


def stem_likelihood(loop: KnownLoop, sticks: bool, rng: np.random.Generator) -> StemLikelihood:
    """The likelihood averaged over all ways to stick, or all ways to be sound, as loops are
    drawn."""
    linear = _linear_part(loop)
    log_likelihood, S = _follow(
        sticking_ways(rng) if sticks else sound_ways(rng),
        loop.numbers,
        loop.air,
        loop.seen,
        loop.shaped,
        linear,
        *_gains(linear, loop.rounding),
        rng.standard_normal(1 << 16),
        rng.random(1 << 16),
    )
    return StemLikelihood(log_likelihood=log_likelihood, S=S)


class _Linear(NamedTuple):
    """What is linear. States: process (3), wandering load (m), noise, waves of the load and of PV
    (p, q).

    ``step`` (d, d) without the load's part, ``enters`` (d,) what a load of 1 does, ``load`` (n, d)
    the load by the state, ``sees`` (d,) PV by the state, ``added`` (d, d) and ``start`` (d, d)
    covariances. ``waves`` is the first place of both waves and the place behind them.
    """

    step: Floats
    enters: Floats
    load: Floats
    sees: Floats
    added: Floats
    start: Floats
    waves: tuple[int, int, int]


def sticking_ways(rng: np.random.Generator) -> Floats:
    """(particles, 2) S and J/S as ``draws`` draws them."""
    S = np.exp(rng.permutation(np.linspace(0.0, np.log(8.0), WAYS_TO_STICK)))
    middle = rng.uniform(0.1, 0.9, WAYS_TO_STICK)
    strong = rng.uniform(1.0, 1.2, WAYS_TO_STICK)
    kind = rng.integers(0, 4, WAYS_TO_STICK)
    return np.column_stack([S, np.choose(kind, [0.0 * S, middle, 1.0 + 0.0 * S, strong])])


def sound_ways(rng: np.random.Generator) -> Floats:
    """(particles, 2) S and J/S of sound stems."""
    S = rng.permutation(np.linspace(0.0, 0.4, WAYS_TO_BE_SOUND))
    return np.column_stack([S, np.zeros(S.size)])


def pole_of(time: float) -> float:
    """Of noise with this correlation time in scans, as ``draws.coloured`` has it."""
    return math.exp(-1.0 / max(time, 0.05))


def behind_air(scans: LoopScans, first: int) -> Floats:
    """(n - first,) the force on the stem that OP makes, the process' delay ago."""
    numbers, op = scans.numbers, scans.op
    follows = 1.0 - math.exp(-1.0 / numbers.air_lag) if numbers.air_lag > 0.05 else 1.0
    air, force = np.empty(op.size), op[0]
    for k in range(op.size):
        force += follows * (op[k] - force)
        air[k] = force
    places = np.maximum(np.arange(first, op.size) - numbers.delay, 0)
    return air[places]


def _linear_part(loop: KnownLoop) -> _Linear:
    m, (of_load, of_pv) = loop.wandering.shape[0], loop.waves
    process, enters = _process(loop.numbers)
    scalars = np.vstack([loop.wandering, loop.noise])
    of_process = (_UNKNOWN_START * loop.numbers.process_gain) ** 2
    step = block_diag(process, np.diag(scalars[:, 1]), of_load.step, of_pv.step)
    start = block_diag(
        of_process * (0.999 + 0.001 * np.eye(_PROCESS)),
        np.diag(scalars[:, 0] ** 2),
        of_load.start(),
        of_pv.start(),
    )
    enters = np.pad(enters, (0, step.shape[0] - _PROCESS))
    added = np.zeros_like(step)
    diagonal = np.arange(_PROCESS, _PROCESS + m + 1)
    added[diagonal, diagonal] = scalars[:, 0] ** 2 * (1.0 - scalars[:, 1] ** 2)
    first = _PROCESS + m + 1
    second = first + of_load.past.size
    end = second + of_pv.past.size
    sees, load = np.zeros(step.shape[0]), np.zeros((loop.seen.size, step.shape[0]))
    sees[[2, first - 1]] = 1.0
    load[:, _PROCESS : _PROCESS + m] = loop.where.T
    if second > first:
        load[:, first], added[first, first] = 1.0, of_load.variance
    if end > second:
        sees[second], added[second, second] = 1.0, of_pv.variance
    return _Linear(step, enters, load, sees, added, start, (first, second, end))


def _process(numbers: LoopNumbers) -> tuple[Floats, Floats]:
    """(3, 3) one scan of both lags and the sensor's, and (3,) what enters them."""
    step, enters = np.zeros((_PROCESS, _PROCESS)), np.zeros(_PROCESS)

    def follows(lag: float) -> float:
        return 1.0 - math.exp(-1.0 / lag) if lag > 0.05 else 1.0

    if numbers.integrating:
        step[0, 0], enters[0] = 1.0, numbers.process_gain / numbers.lag
    else:
        share = 1.0 - math.exp(-1.0 / numbers.lag)
        step[0, 0], enters[0] = 1.0 - share, share * numbers.process_gain
    for row, lag in ((1, numbers.second_lag), (2, numbers.sensor_lag)):
        step[row] = follows(lag) * step[row - 1]
        step[row, row] += 1.0 - follows(lag)
        enters[row] = follows(lag) * enters[row - 1]
    return step, enters


@compiled()
def _gains(linear: _Linear, rounding: float) -> tuple[Floats, Floats]:
    """(n, d) what an error corrects, and (n,) its variance; by them every particle is filtered."""
    n, size = linear.load.shape
    gains, variances = np.empty((n, size)), np.empty(n)
    covariance, step = linear.start.copy(), np.empty((size, size))
    for k in range(n):
        column = covariance @ linear.sees
        variances[k] = linear.sees @ column + rounding
        for i in range(size):
            gains[k, i] = column[i] / variances[k]
            for j in range(size):
                covariance[i, j] -= column[i] * column[j] / variances[k]
                step[i, j] = linear.step[i, j] + linear.enters[i] * linear.load[k, j]
        moved = step @ covariance @ step.T
        for i in range(size):
            for j in range(i + 1):
                both = moved[i, j] + linear.added[i, j] + (moved[j, i] + linear.added[j, i])
                covariance[i, j] = covariance[j, i] = 0.5 * both
    return gains, variances


@compiled()
def _follow(
    ways: Floats,
    numbers: LoopNumbers,
    air: Floats,
    seen: Floats,
    shaped: Floats,
    linear: _Linear,
    gains: Floats,
    variances: Floats,
    normals: Floats,
    uniforms: Floats,
) -> tuple[float, float]:
    """ln of the likelihood, and the mean of S at the end."""
    count, (n, size) = ways.shape[0], gains.shape
    stems, states = stems_at_rest(ways, air[0], uniforms), np.zeros((count, size))
    weights, errors = np.full(count, 1.0 / count), np.empty(count)
    total, used, sizes = 0.0, 0, (ways[:, 0].min(), ways[:, 0].max())
    for k in range(n):
        for i in range(count):
            errors[i] = seen[k] - _pv(states[i], linear.waves)
            for row in range(size):
                states[i, row] += gains[k, row] * errors[i]
        total += _weigh(weights, errors, variances[k])
        if 1.0 / np.sum(weights * weights) < 0.5 * count:
            used = (used + 3 * count + 1) % (normals.size - 4 * count)
            shaken = normals[used:]
            resample(weights, stems, states, sizes, numbers.scatter, shaken, uniforms[used])
        used = move(stems, numbers.scatter, air, k, normals, used)
        for i in range(count):
            deviation = stems[i, 0] - numbers.output
            entering = deviation * max(1.0 + 0.1 * numbers.bend * deviation, 0.2) + shaped[k]
            _pass(states[i], entering, linear, k)
    return total, float(np.sum(weights * stems[:, 4]))


@compiled()
def stems_at_rest(ways: Floats, force: float, uniforms: Floats) -> Floats:
    """(particles, 7) place, moving, side, breakaway level, S, J/S, and the greatest force since
    they stopped, of stems that stand somewhere about ``force``."""
    stems = np.zeros((ways.shape[0], 7))
    for i in range(ways.shape[0]):
        S, ratio = ways[i]
        level = 0.5 * S * (1.0 + ratio)
        stems[i, 0] = force + level * (2.0 * uniforms[-1 - i] - 1.0)
        stems[i, 2], stems[i, 3], stems[i, 4], stems[i, 5] = 1.0, level, S, ratio
    return stems


@compiled()
def _weigh(weights: Floats, errors: Floats, variance: float) -> float:
    """Weigh by ``errors``; ln of what the weights added up to."""
    most, total = -np.inf, 0.0
    for i in range(weights.size):
        weights[i] = np.log(weights[i]) - 0.5 * errors[i] * errors[i] / variance
        most = max(most, weights[i])
    for i in range(weights.size):
        weights[i] = np.exp(weights[i] - most)
        total += weights[i]
    for i in range(weights.size):
        weights[i] /= total
    return float(math.log(total) + most - 0.5 * math.log(2.0 * math.pi * variance))


@compiled()
def resample(
    weights: Floats,
    stems: Floats,
    states: Floats,
    sizes: tuple[float, float],
    scatter: float,
    normals: Floats,
    offset: float,
) -> NDArray[np.int64]:
    """Draw particles by their weights (systematically), shake S (within ``sizes``) and J/S a
    little, and draw anew the breakaway levels that are not known yet, so that copies of a stem do
    not all slip at once. (particles,) the places that they were drawn from."""
    count, place, reached = weights.size, 0, weights[0]
    chosen, stood, known = np.empty(count, np.int64), stems.copy(), states.copy()
    for i in range(count):
        while reached < (i + offset) / count and place < count - 1:
            place += 1
            reached += weights[place]
        chosen[i] = place
    # Numbers one by one, here and in what follows: whole arrays take seconds to compile.
    for i in range(count):
        for j in range(stems.shape[1]):
            stems[i, j] = stood[chosen[i], j]
        for j in range(states.shape[1]):
            states[i, j] = known[chosen[i], j]
        stem = stems[i]
        stem[4] = min(max(stem[4] * math.exp(_JITTER * normals[i]), sizes[0]), sizes[1])
        stem[5] *= math.exp(_JITTER * normals[count + i])
        level = _breakaway(stem, scatter, normals[2 * count + i])
        if stem[1] == 0.0 and level > stem[6]:
            stem[3] = level
    weights[:] = 1.0 / count
    return chosen


@compiled()
def _breakaway(stem: Floats, scatter: float, normal: float) -> float:
    """The level at which a stem breaks away after a stop."""
    drawn = max(1.0 + scatter * normal, 0.2)
    S, ratio = stem[4], stem[5]
    return float(max(0.5 * S * (1.0 + ratio) * drawn, 0.5 * S * (1.0 - ratio)))


@compiled()
def move(stems: Floats, scatter: float, air: Floats, k: int, normals: Floats, used: int) -> int:
    """One scan of every stem, as the kernel moves it; how many normal numbers are used."""
    force = air[k]
    forward = force - air[k - 1] if k > 0 else 0.0
    for i in range(stems.shape[0]):
        stem = stems[i]
        low = 0.5 * stem[4] * (1.0 - stem[5])
        if stem[1] > 0.0 and stem[2] * forward <= 1e-9:
            stem[1], stem[6] = 0.0, 0.0
            stem[3] = _breakaway(stem, scatter, normals[used % normals.size])
            used += 1
        if stem[1] == 0.0 and abs(force - stem[0]) > stem[3]:
            stem[1] = 1.0
            stem[2] = 1.0 if force > stem[0] else -1.0
        stem[6] = max(stem[6], abs(force - stem[0]))
        if stem[1] > 0.0:
            stem[0] = force - stem[2] * low
    return used


@compiled()
def _pv(state: Floats, waves: tuple[int, int, int]) -> float:
    """What is seen of a state."""
    wave = state[waves[1]] if waves[2] > waves[1] else 0.0
    return float(state[2] + state[waves[0] - 1] + wave)


@compiled()
def _pass(state: Floats, entering: float, linear: _Linear, k: int) -> None:
    """The mean of what is behind a stem, one scan on."""
    first, second, end = linear.waves
    for j in range(3, first + 1 if second > first else first):
        entering += linear.load[k, j] * state[j]
    for row in range(2, -1, -1):
        moved = linear.enters[row] * entering
        for column in range(row + 1):
            moved += linear.step[row, column] * state[column]
        state[row] = moved
    for j in range(3, first):
        state[j] *= linear.step[j, j]
    for begin, behind in ((first, second), (second, end)):
        newest = 0.0
        for j in range(behind - 1, begin - 1, -1):
            newest += linear.step[begin, j] * state[j]
            state[j] = state[j - 1] if j > begin else newest
