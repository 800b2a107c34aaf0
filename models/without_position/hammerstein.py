"""Whether a stick-slip element between OP and PV predicts unseen PV better than the linear loop
alone.

With y = PV, u = OP, x = the element driven by OP, d a delay and t the time, all as means over
blocks of samples, three models are fitted by least squares:

    linear    y(k) = sum a_i y(k-i) + sum b_i u(k-d-i) + c + e t           i = 1..3
    sticking  the same with x in place of u
    both      the linear one, and sum g_i x(k-d-i) beside it

Each of ``FOLDS`` contiguous stretches is predicted by a fit to the others. The element runs at the
full rate of the record; only then is everything averaged, so that one low-order model fits fast
and slow loops. The element is that of Choudhury, Thornhill and Shah (2005),
doi:10.1016/j.conengprac.2004.05.005, in the form with two force levels (S + J)/2 and (S - J)/2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.compiled import compiled
from stemwatch.models.recording import Floats
from stemwatch.models.statistics.positive_definite import solve

FOLDS = 6
PAST = 3  # past values of each signal in a model
RATIOS = np.array([0.0, 0.3, 0.6, 0.9, 1.0])  # J over S
DELAYS = 5
# Columns of the products: past x, past y, past u, 1, t, and y itself.
_WIDE = 3 * PAST + 3
_LINEAR, _BOTH = np.arange(PAST, _WIDE - 1), np.arange(_WIDE - 1)
_STICKING = np.array([0, 1, 2, 3, 4, 5, 9, 10])
_RIDGE, _NOTHING = 1e-9, 1e-12


@dataclass(frozen=True, kw_only=True)
class HeldOut:
    """Held-out mean squares of the three models, and the element that each prefers.

    ``gain_of_sticking = ln(linear/sticking)``, ``gain_of_both = ln(linear/both)``; ``shares`` are
    the shares of folds in which the sticking model, and both, predict better. ``S`` and ``J``
    (percent of OP) are the sticking model's, ``S_of_both`` that of the third.
    """

    gain_of_sticking: float
    gain_of_both: float
    shares: tuple[float, float]
    S: float
    J: float
    S_of_both: float
    linear_fit: float  # ln(variance of y / linear held-out mean square)
    # (n_S,) ln(linear/sticking), and ln(linear/both), of each S, with its best ratio and delay
    curve: Floats
    curve_of_both: Floats


@compiled()
def element(op: Floats, S: float, J: float, x: Floats) -> None:
    """The stem ``x`` (n,) that follows ``op`` (n,) by the element, from rest at ``op[0]``."""
    fs, fd = 0.5 * (S + J), 0.5 * (S - J)
    stem, side, moving = op[0], 1.0, False
    x[0] = stem
    for k in range(1, op.size):
        step = op[k] - op[k - 1]
        if moving and side * step <= 0.0:
            moving = False
        force = op[k] - stem
        if not moving and abs(force) > fs:
            moving = True
            side = 1.0 if force > 0.0 else -1.0
        if moving:
            stem = op[k] - side * fd
        x[k] = stem


@compiled(error_model="numpy")
def _stem_means(op: Floats, levels: Floats, block_length: int) -> Floats:
    """(c, n // block_length) ``block_means`` of the stems of S and J, ``levels`` (c, 2)."""
    count, stem = op.size // block_length, np.empty(op.size)
    means = np.empty((levels.shape[0], count))
    for candidate in range(levels.shape[0]):
        element(op, levels[candidate, 0], levels[candidate, 1], stem)
        for block in range(count):
            total = 0.0
            for k in range(block * block_length, (block + 1) * block_length):
                total += stem[k]
            means[candidate, block] = total / block_length
    return means


def block_means(values: Floats, block_length: int) -> Floats:
    """(n // block_length,) means over blocks of ``block_length`` samples."""
    count = values.size // block_length
    return np.asarray(values[: count * block_length].reshape(count, block_length).mean(axis=-1))


def past_values(values: Floats, first: int, delay: int) -> Floats:
    """(PAST, n) the values 1 to 3 blocks before ``delay`` blocks ago, from ``first`` on."""
    n = values.size - first
    starts = [first - 1 - delay - past for past in range(PAST)]
    return np.stack([values[start : start + n] for start in starts])


def _fixed_columns(u: Floats, y: Floats, delays: int) -> Floats:
    """(delays, w, n) what the models hold beside the element, for each delay: past y, past u, 1, t,
    and y itself.
    """
    first = PAST + delays
    n = y.size - first
    own_past, time = past_values(y, first, 0), [np.ones(n), np.linspace(-1.0, 1.0, n), y[first:]]
    return np.stack([[*own_past, *past_values(u, first, d), *time] for d in range(delays)])


@compiled(error_model="numpy", fastmath={"reassoc", "contract"})
def _product(a: Floats, b: Floats) -> float:
    """The product of two columns (n,), summed in the order that suits the processor."""
    total = 0.0
    for k in range(a.size):
        total += a[k] * b[k]
    return total


@compiled(error_model="numpy")
def _fold_losses(gram: Floats, columns: NDArray[np.int64], losses: Floats) -> None:
    """Into ``losses`` (FOLDS,) the squared error on each fold of a fit to the others.

    ``gram`` (FOLDS, w, w) are the products of all columns within each fold, y last. A small ridge
    keeps redundant columns solvable.
    """
    size, last = columns.size, gram.shape[1] - 1
    total, a, weights = gram[0].copy(), np.empty((size, size)), np.empty(size)
    for fold in range(1, losses.size):  # by hand: a sum over an axis takes seconds to compile
        for i in range(last + 1):
            for j in range(last + 1):
                total[i, j] += gram[fold, i, j]
    for fold in range(losses.size):
        own = gram[fold]
        for i in range(size):
            row = columns[i]
            for j in range(size):
                a[i, j] = total[row, columns[j]] - own[row, columns[j]]
            a[i, i] += _RIDGE * a[i, i] + _NOTHING
            weights[i] = total[row, last] - own[row, last]
        solve(a, weights)
        error = own[last, last]
        for i in range(size):
            row, fitted = columns[i], 0.0
            for j in range(size):
                fitted += own[row, columns[j]] * weights[j]
            error += weights[i] * (fitted - 2.0 * own[row, last])
        losses[fold] = max(error, _NOTHING)


@compiled(error_model="numpy")
def _fill_losses(
    stems: Floats, fixed: Floats, linear: Floats, sticking: Floats, both: Floats
) -> None:
    """The losses of ``_losses`` into the last three; ``fixed`` as of ``_fixed_columns``."""
    delays, wide, n = fixed.shape
    first, gram = PAST + delays, np.empty((FOLDS, _WIDE, _WIDE))
    for delay in range(delays):
        for candidate in range(stems.shape[0]):
            for fold in range(FOLDS):
                begin, end, own = fold * n // FOLDS, (fold + 1) * n // FOLDS, gram[fold]
                for i in range(wide if candidate == 0 else 0):
                    for j in range(i + 1):
                        product = _product(fixed[delay, i, begin:end], fixed[delay, j, begin:end])
                        own[PAST + i, PAST + j] = own[PAST + j, PAST + i] = product
                for i in range(PAST):
                    at = first - 1 - delay - i
                    moved = stems[candidate, at + begin : at + end]
                    for j in range(wide):
                        product = _product(moved, fixed[delay, j, begin:end])
                        own[i, PAST + j] = own[PAST + j, i] = product
                    for j in range(i + 1):
                        at = first - 1 - delay - j
                        product = _product(moved, stems[candidate, at + begin : at + end])
                        own[i, j] = own[j, i] = product
            if candidate == 0:
                _fold_losses(gram, _LINEAR, linear[delay])
            _fold_losses(gram, _STICKING, sticking[delay, candidate])
            _fold_losses(gram, _BOTH, both[delay, candidate])


def _losses(u: Floats, y: Floats, stems: Floats, delays: int) -> tuple[Floats, Floats, Floats]:
    """Held-out squared errors: linear (delays, FOLDS); sticking, both (delays, c, FOLDS).

    ``u``, ``y`` (m,) and ``stems`` (c, m) are block means.
    """
    shape = delays, stems.shape[0], FOLDS
    linear, sticking, both = np.empty((delays, FOLDS)), np.empty(shape), np.empty(shape)
    _fill_losses(stems, _fixed_columns(u, y, delays), linear, sticking, both)
    return linear, sticking, both


def held_out(
    op: Floats,
    pv: Floats,
    block_length: int,
    sizes: Floats,
    ratios: Floats = RATIOS,
    delays: int = DELAYS,
) -> HeldOut:
    """Compare the three models on ``op`` and ``pv`` (n,), without holes, by blocks of
    ``block_length``.

    ``sizes`` are the values of S that are tried, percent of OP.
    """
    scale_u, scale_y = max(float(np.std(op)), 1e-9), max(float(np.std(pv)), 1e-9)
    command = (op - float(np.mean(op))) / scale_u
    candidates = [(S, S * ratio) for S in sizes for ratio in ratios]
    y = block_means((pv - np.mean(pv)) / scale_y, block_length)
    stems = _stem_means(command, np.array(candidates) / scale_u, block_length)
    linear, sticking, both_losses = _losses(block_means(command, block_length), y, stems, delays)
    base = linear[int(np.argmin(linear.sum(axis=1)))]
    sums, sums_both = sticking.sum(axis=2), both_losses.sum(axis=2)
    delay, best = np.unravel_index(int(np.argmin(sums)), sums.shape)
    delay_both, best_both = np.unravel_index(int(np.argmin(sums_both)), sums_both.shape)
    total = float(base.sum())
    of_size, of_size_both = (
        losses.min(axis=0).reshape(sizes.size, ratios.size).min(axis=1)
        for losses in (sums, sums_both)
    )
    return HeldOut(
        gain_of_sticking=float(np.log(total / sums[delay, best])),
        gain_of_both=float(np.log(total / sums_both[delay_both, best_both])),
        shares=(
            float(np.mean(sticking[delay, best] < base)),
            float(np.mean(both_losses[delay_both, best_both] < base)),
        ),
        S=float(candidates[best][0]),
        J=float(candidates[best][1]),
        S_of_both=float(candidates[best_both][0]),
        linear_fit=float(np.log(max(float(np.sum((y - y.mean()) ** 2)), 1e-12) / total)),
        curve=np.log(total / of_size),
        curve_of_both=np.log(total / of_size_both),
    )
