"""Free runs of a layered network in numba, and their derivatives by its weights.

A network is given by ``sizes`` (inputs, units of each layer), ``codes`` (each layer's transfer, see
``layers``), ``inputs`` (places in ``network_step.LAGS``) and ``scale`` = (reach, centre, share):
inputs are divided by reach, the answer is ``reach (s - centre) / share``. Weights (P,) are each
layer's rows ``[W, b]``, one after the other.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.compiled import compiled
from stemwatch.models.recording import Floats

LINEAR, TANGENT_SIGMOID, LOG_SIGMOID = 0, 1, 2

Indices = NDArray[np.int64]


@compiled()
def free_runs(
    weights: Floats,
    sizes: Indices,
    codes: Indices,
    inputs: Indices,
    scale: tuple[float, float, float],
    u: Floats,
    y: Floats,
    limit: float,
    out: Floats,
) -> None:
    """Fill ``out`` (T, R) with free runs over ``u`` (T, R), from the first two samples of ``y``.

    Values are clamped to ``-limit`` to ``limit``; NaN becomes ``limit``.
    """
    reach, centre, share = scale
    units, lags = np.zeros((len(sizes), sizes.max())), np.zeros(5)
    for run in range(u.shape[1]):
        out[0, run], out[1, run] = y[0, run], y[1, run]
        for t in range(2, u.shape[0]):
            _look_back(u, out, t, run, lags)
            for column in range(len(inputs)):
                units[0, column] = lags[inputs[column]] / reach
            answer = reach * (_forward(weights, sizes, codes, units) - centre) / share
            out[t, run] = _limited(answer, limit)


@compiled()
def jacobian(
    weights: Floats,
    sizes: Indices,
    codes: Indices,
    inputs: Indices,
    scale: tuple[float, float, float],
    u: Floats,
    y: Floats,
    limit: float,
    steepest: float,
    out: Floats,
) -> None:
    """Fill ``out`` (R (T - 2), P + 1): ``d y(t) / d w`` of each free run, and last its residual.

    ``s(t) = g(t) + d1 s(t-1) + d2 s(t-2)``, held within ``steepest``; ``y`` (T, R) is the target.
    With T = 3 nothing is fed back.
    """
    reach, centre, share = scale
    units, slopes = np.zeros((len(sizes), sizes.max())), np.zeros((len(sizes), sizes.max()))
    size, samples, lags = weights.shape[0], u.shape[0] - 2, np.zeros(5)
    answers = np.empty((u.shape[0], 1))
    for run in range(u.shape[1]):
        answers[0, 0], answers[1, 0] = y[0, run], y[1, run]
        for t in range(2, u.shape[0]):
            row = out[run * samples + t - 2]
            _look_back(u[:, run : run + 1], answers, t, 0, lags)
            for column in range(len(inputs)):
                units[0, column] = lags[inputs[column]] / reach
            answer = reach * (_forward(weights, sizes, codes, units) - centre) / share
            _backward(weights, sizes, codes, units, slopes, reach / share, row)
            answers[t, 0] = _limited(answer, limit)
            row[size] = answers[t, 0] - y[t, run]
            for column in range(len(inputs)):
                steps_back = inputs[column] - 2  # 1 and 2 are y(t-1) and y(t-2)
                if steps_back > 0 and t - steps_back >= 2:
                    _carry(row, slopes[0, column] / reach, out[run * samples + t - 2 - steps_back])
            for column in range(size):
                row[column] = min(max(row[column], -steepest), steepest)


@compiled()
def _look_back(u: Floats, y: Floats, t: int, run: int, lags: Floats) -> None:
    """``lags`` (5,) in the order of ``network_step.LAGS``."""
    lags[0], lags[1], lags[2] = u[t, run], u[t - 1, run], u[t - 2, run]
    lags[3], lags[4] = y[t - 1, run], y[t - 2, run]


@compiled()
def _limited(answer: float, limit: float) -> float:
    """``answer`` clamped to ``-limit`` to ``limit``; NaN becomes ``limit``."""
    if math.isnan(answer):
        return limit
    return min(max(answer, -limit), limit)


@compiled()
def _squash(code: int, total: float) -> float:
    """The transfer function ``code`` of a neuron: linear, tanh, or logistic."""
    if code == LINEAR:
        return total
    if code == TANGENT_SIGMOID:
        return math.tanh(total)
    return 0.5 * (1.0 + math.tanh(0.5 * total))


@compiled()
def _slope(code: int, answer: float) -> float:
    """Derivative of the transfer function where its value is ``answer``."""
    if code == LINEAR:
        return 1.0
    if code == TANGENT_SIGMOID:
        return 1.0 - answer * answer
    return answer * (1.0 - answer)


@compiled()
def _forward(weights: Floats, sizes: Indices, codes: Indices, units: Floats) -> float:
    """The last layer's answer; ``units`` (layers + 1, widest) holds the inputs in its first row."""
    offset = 0
    for layer in range(len(codes)):
        wide = sizes[layer]
        for unit in range(sizes[layer + 1]):
            total = weights[offset + wide]
            for index in range(wide):
                total += weights[offset + index] * units[layer, index]
            units[layer + 1, unit] = _squash(codes[layer], total)
            offset += wide + 1
    answer: float = units[len(codes), 0]
    return answer


@compiled()
def _backward(
    weights: Floats,
    sizes: Indices,
    codes: Indices,
    units: Floats,
    slopes: Floats,
    factor: float,
    row: Floats,
) -> None:
    """Derivatives of ``factor`` times the answer: by each weight into ``row``, by each unit into
    ``slopes``, whose first row is of the inputs."""
    last, offset = len(codes), weights.shape[0]
    slopes[last, 0] = factor * _slope(codes[last - 1], units[last, 0])
    for layers_back in range(last):
        layer = last - 1 - layers_back
        wide = sizes[layer]
        offset -= sizes[layer + 1] * (wide + 1)
        slopes[layer, :wide] = 0.0
        for unit in range(sizes[layer + 1]):
            at_unit, first = slopes[layer + 1, unit], offset + unit * (wide + 1)
            for index in range(wide):
                row[first + index] = at_unit * units[layer, index]
                slopes[layer, index] += at_unit * weights[first + index]
            row[first + wide] = at_unit
        if layer > 0:
            for index in range(wide):
                slopes[layer, index] *= _slope(codes[layer - 1], units[layer, index])


@compiled()
def _carry(row: Floats, by_lag: float, earlier: Floats) -> None:
    """Add an earlier position's derivatives times ``by_lag``, except in the residual's column."""
    for column in range(row.shape[0] - 1):
        row[column] += by_lag * earlier[column]
