"""Whether PV is likelier with a stem that sticks than with a sound one, where the process is fitted
on the same record.

With y = PV, x = the stem and Z the means of a signal over stretches of its past (``_PAST``),

    y(k) = a . Z(y)(k) + b . Z(x)(k) + c + e t + s T       T of Student's distribution

``DEGREES`` of freedom let a spike be a spike. A particle filter follows x by what it predicts: so
a stem may slip when PV says that it did, which one element with one S and J cannot. Process and
stem are found in turn: the filter's paths of x give a, b, c, e and s by (weighted) least squares,
and these the next paths (a stochastic EM; Wei and Tanner 1990, doi:10.1080/01621459.1990.10474930).

A stem that sticks has S of 1 to 8 % of OP, a sound one up to 0.4 %; x = OP itself is tried too. OP
is in percent. S comes out coarsely, within a quarter on clean loops: J and the scatter of levels
can take its place.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.compiled import compiled
from stemwatch.models.recording import Floats
from stemwatch.models.without_position.hammerstein import block_means, element
from tests.benchmarks.stem_filter import move, resample, stems_at_rest

NAMES = (
    "likelier with a stem that sticks",
    "the same for each value",
    "likelier with an even element",
    "likelier with a sound stem than with none",
    "S that is followed",
    "values that were predicted",
)
MOST_VALUES = 1600
DEGREES = 5.0
PARTICLES = 100
SCATTER = 0.12  # of breakaway levels, as a share
STICKING, SOUND = (1.0, 8.0), (0.0, 0.4)  # S, percent of OP
_ROUNDS, _STARTS, _PATHS = 2, 2, 4
_SIZES, _RATIOS = np.geomspace(*STICKING, 12), (0.0, 0.5, 1.0)
# first and last of the past values whose mean counts
_PAST_PV = np.array([(1, 1), (2, 2), (3, 3), (4, 4), (5, 6), (7, 9), (10, 14), (15, 24)])
_PAST = np.array([(1, 1), (2, 2), (3, 3), (4, 5), (6, 8), (9, 13), (14, 24), (25, 48)])
_FIRST, _KEPT = 48, 64
FEWEST_VALUES = 2 * _FIRST
_RIDGE, _NOTHING = 1e-6, 1e-9
_SQUEEZED_FROM = 2.0  # nats: what is much more counts by its logarithm
_EACH_FROM = 1.0 / 30.0


@dataclass(frozen=True)
class _Fit:
    """A process by its ``weights`` (w,), of which the first are those of the stem, the ``size`` of
    its errors, and ln of the likelihood."""

    weights: Floats
    size: float
    log_likelihood: float


def followed_stem(op: Floats, pv: Floats) -> Floats:
    """(6,) the numbers of ``NAMES`` of OP in percent and PV (n,), without holes; zeros for a
    record of fewer than ``FEWEST_VALUES``."""
    if op.size < FEWEST_VALUES:
        return np.zeros(len(NAMES))
    block_length = -(-op.size // MOST_VALUES)
    scale = max(float(np.std(op)), _NOTHING)
    force = block_means(op - np.mean(op), block_length) / scale
    y = block_means(pv - np.mean(pv), block_length) / max(float(np.std(pv)), _NOTHING)
    target, rest = y[_FIRST:], _rest(y)
    linear = _student(np.concatenate([_past(force, _PAST), rest]), target)
    even = _even_elements(force, rest, target, scale)
    sound = _followed(force, rest, target, linear, scale, SOUND)[0]
    sticking, S = max(
        _followed(force, rest, target, start, scale, STICKING) for start in _apart(even)
    )
    gain = sticking - max(sound, linear.log_likelihood)
    return np.array(
        [
            np.arcsinh(gain / _SQUEEZED_FROM),
            np.arcsinh(gain / target.size / _EACH_FROM),
            np.arcsinh(
                (max(fit.log_likelihood for fit in even) - linear.log_likelihood) / _SQUEEZED_FROM
            ),
            np.arcsinh((sound - linear.log_likelihood) / _SQUEEZED_FROM),
            math.log(S),
            math.log(target.size),
        ]
    )


def _past(values: Floats, stretches: NDArray[np.int64]) -> Floats:
    """(stretches, n - _FIRST) means of ``values`` (n,) over stretches of their past."""
    sums = np.concatenate([[0.0], np.cumsum(values)])
    now = np.arange(_FIRST, values.size)
    return np.stack(
        [(sums[now - a + 1] - sums[now - b]) / (b - a + 1) for a, b in stretches.tolist()]
    )


def _rest(y: Floats) -> Floats:
    """(w, n - _FIRST) what a model holds beside the stem: past PV, 1 and t."""
    count = y.size - _FIRST
    return np.concatenate(
        [_past(y, _PAST_PV), np.ones((1, count)), np.linspace(-1.0, 1.0, count)[None]]
    )


def _student(columns: Floats, target: Floats, rounds: int = 6) -> _Fit:
    """The fit of ``columns`` (w, n) to ``target`` (n,) with errors of Student's distribution, by
    least squares with weights (Lange, Little and Taylor 1989,
    doi:10.1080/01621459.1989.10478852)."""
    counts: Floats = np.ones(target.size)
    weights: Floats = np.zeros(columns.shape[0])
    errors: Floats = target
    size = 1.0
    for _ in range(rounds):
        weighted = columns * counts
        gram = weighted @ columns.T
        gram += np.diag(_RIDGE * np.diag(gram) + _NOTHING)
        weights = np.asarray(np.linalg.solve(gram, weighted @ target), dtype=np.float64)
        errors = target - weights @ columns
        variance = float(np.mean(counts * errors**2)) + _NOTHING**2
        size = math.sqrt(variance)
        counts = (DEGREES + 1.0) / (DEGREES + errors**2 / variance)
    kernel = np.log1p((errors / size) ** 2 / DEGREES)
    log_likelihood = -0.5 * (DEGREES + 1.0) * float(kernel.sum()) - target.size * math.log(size)
    return _Fit(weights, size, log_likelihood)


def _even_elements(force: Floats, rest: Floats, target: Floats, scale: float) -> list[_Fit]:
    """For each of ``_SIZES`` the best fit with an element of one S and J, whatever J/S."""
    stem = np.empty(force.size)

    def fit(S: float, ratio: float) -> _Fit:
        element(force, S / scale, S * ratio / scale, stem)
        return _student(np.concatenate([_past(stem, _PAST), rest]), target, rounds=2)

    return [
        max((fit(S, ratio) for ratio in _RATIOS), key=lambda one: one.log_likelihood)
        for S in _SIZES
    ]


def _apart(fits: list[_Fit]) -> list[_Fit]:
    """The likeliest fits that are no neighbours."""
    chosen: list[int] = []
    for place in sorted(range(len(fits)), key=lambda k: -fits[k].log_likelihood):
        if all(abs(place - other) > 1 for other in chosen):
            chosen.append(place)
    return [fits[place] for place in chosen[:_STARTS]]


def _followed(
    force: Floats,
    rest: Floats,
    target: Floats,
    start: _Fit,
    scale: float,
    sizes: tuple[float, float],
) -> tuple[float, float]:
    """ln of the likelihood, averaged over stems of S within ``sizes``, percent, and the S that is
    followed; the best of ``_ROUNDS`` processes, the first that of ``start``."""
    rng = np.random.default_rng(1)
    ways = _ways(sizes, rng)
    ways[:, 0] /= scale
    within = sizes[0] / scale + _NOTHING, sizes[1] / scale
    normals, uniforms = rng.standard_normal(1 << 14), rng.random(1 << 12)
    fit, best, own = start, (-math.inf, 1.0), _PAST.shape[0]
    for turn in range(_ROUNDS):
        seen = target - fit.weights[own:] @ rest
        log_likelihood, log_S, paths = _filtered(
            force, seen, fit.weights[:own], fit.size, ways, within, normals, uniforms
        )
        best = max(best, (log_likelihood, math.exp(log_S) * scale))
        if turn < _ROUNDS - 1:
            columns = [np.concatenate([_past(path, _PAST), rest]) for path in paths]
            fit = _student(np.concatenate(columns, axis=1), np.tile(target, _PATHS), rounds=4)
    return best


def _ways(sizes: tuple[float, float], rng: np.random.Generator) -> Floats:
    """(PARTICLES, 2) S and J/S; sizes that begin at 0 are those of sound stems, without J."""
    low, high = sizes
    if low <= 0.0:
        return np.column_stack(
            [rng.permutation(np.linspace(low, high, PARTICLES)), np.zeros(PARTICLES)]
        )
    S = np.exp(rng.permutation(np.linspace(math.log(low), math.log(high), PARTICLES)))
    kinds = [np.zeros(PARTICLES), rng.uniform(0.1, 0.9, PARTICLES), rng.uniform(1, 1.2, PARTICLES)]
    return np.column_stack([S, np.choose(rng.integers(0, 3, PARTICLES), kinds)])


@compiled(error_model="numpy")
def _filtered(
    force: Floats,
    seen: Floats,
    gains: Floats,
    size: float,
    ways: Floats,
    sizes: tuple[float, float],
    normals: Floats,
    uniforms: Floats,
) -> tuple[float, float, Floats]:
    """ln of the likelihood of ``seen`` (n - _FIRST,), the part of PV that a stem has to explain;
    the mean of ln S at the end; and (_PATHS, n) paths of the stem."""
    n, count, used, total = force.size, ways.shape[0], 0, 0.0
    stems, sums = stems_at_rest(ways, force[0], uniforms), np.zeros((count, _KEPT))
    weights, errors = np.full(count, 1.0 / count), np.empty(count)
    places, parents = np.empty((n, count)), np.empty((n, count), np.int64)
    for k in range(n):
        for i in range(count):
            parents[k, i] = i
        if k >= _FIRST:
            _predict(sums, gains, k, errors)
            total += _weigh(weights, (seen[k - _FIRST] - errors) / size) - math.log(size)
            if 1.0 / np.sum(weights * weights) < 0.5 * count:
                used = (used + 3 * count + 1) % (normals.size - 4 * count)
                offset = uniforms[k % uniforms.size]
                own = normals[used:]
                chosen = resample(weights, stems, sums, sizes, SCATTER, own, offset)
                for i in range(count):
                    parents[k, i] = chosen[i]
        used = move(stems, SCATTER, force, k, normals, used)
        for i in range(count):
            places[k, i] = stems[i, 0]
            sums[i, k % _KEPT] = sums[i, (k - 1) % _KEPT] + stems[i, 0]
    log_S = float(np.sum(weights * np.log(stems[:, 4] + _NOTHING)))
    return total, log_S, _traced(places, parents, np.cumsum(weights))


@compiled(error_model="numpy")
def _predict(sums: Floats, gains: Floats, k: int, predicted: Floats) -> None:
    """Into ``predicted`` (particles,) what each stem does to PV, by the sums of its places."""
    predicted[:] = 0.0
    for j in range(gains.size):
        first, last = _PAST[j]
        gain = gains[j] / (last - first + 1)
        newer, older = (k - first) % _KEPT, (k - last - 1) % _KEPT
        for i in range(predicted.size):
            predicted[i] += gain * (sums[i, newer] - sums[i, older])


@compiled(error_model="numpy")
def _weigh(weights: Floats, errors: Floats) -> float:
    """Weigh by ``errors`` in sizes; ln of what the weights added up to."""
    most, total = -np.inf, 0.0
    for i in range(weights.size):
        weights[i] = np.log(weights[i] + 1e-300)
        weights[i] -= 0.5 * (DEGREES + 1.0) * np.log1p(errors[i] * errors[i] / DEGREES)
        most = max(most, weights[i])
    for i in range(weights.size):
        weights[i] = np.exp(weights[i] - most)
        total += weights[i]
    for i in range(weights.size):
        weights[i] /= total
    return float(math.log(total) + most)


@compiled()
def _traced(places: Floats, parents: NDArray[np.int64], reached: Floats) -> Floats:
    """(_PATHS, n) the way of stems that are drawn by their weights at the end."""
    n, count = places.shape
    paths = np.empty((_PATHS, n))
    for path in range(_PATHS):
        at = min(int(np.searchsorted(reached, (path + 0.5) / _PATHS)), count - 1)
        for k in range(n - 1, -1, -1):
            paths[path, k] = places[k, at]
            at = parents[k, at]
    return paths
