"""Where training starts from: weights that know nothing, or a fitted stick-slip element."""

from __future__ import annotations

import numpy as np

from stemwatch.models.narx.architecture import ELEMENT_UNITS, INPUTS, StickSlipStart
from stemwatch.models.narx.example import NarxSettings
from stemwatch.models.recording import Floats

_UP, _DOWN, _GOES_ON_UP, _GOES_ON_DOWN, _DIRECTION = range(ELEMENT_UNITS)
# Edges of the gate, as shares of fs: the wider, the more samples tell where it should lie; the
# narrower, the less it leaks. The seeds take them in turn.
_WIDTHS = (0.01, 0.05)
_LEAST_LEVEL = 0.02  # of se: an element without friction has no edge to start from
_GATE = 30.0  # a closed gate leaks exp(-30) per sample
_CONSENSUS = 12.0  # slope of the units that see command and stem go the same way


def random_starts(settings: NarxSettings, members: int) -> Floats:
    """(members, P): a half-open gate and hardly any movement.

    Hidden weights normal / sqrt(inputs) times 1.5, their biases normal, gate normal / sqrt(hidden),
    value small. Each seed has its own generator, so that more seeds leave the first ones as they
    are.
    """
    hidden = settings.hidden
    starts = []
    for member in range(members):
        draw = np.random.default_rng([settings.seed, member]).standard_normal
        rows = draw((hidden, INPUTS + 1))
        rows[:, :INPUTS] *= 1.5 / np.sqrt(INPUTS)
        gate = draw(hidden + 1) / np.sqrt(hidden)
        value = 0.1 * draw(hidden + INPUTS + 1)
        starts.append(np.concatenate([value, gate, rows.ravel()]))
    return np.stack(starts)


def fitted_starts(
    start: StickSlipStart, unit_percent: float, settings: NarxSettings, members: int
) -> Floats:
    """(members, P): the stick-slip element of ``start``, but for the edges of its gate.

    ``unit_percent`` is the network's unit ``se`` in percent of OP.
    """
    fs = max(0.5 * (start.S + start.J) / unit_percent, _LEAST_LEVEL)
    fd = 0.5 * (start.S - start.J) / unit_percent
    widths = [fs * _WIDTHS[member % len(_WIDTHS)] for member in range(members)]
    return np.stack([_element(fs, fd, w, start.goes_on, settings.hidden) for w in widths])


def _element(fs: float, fd: float, width: float, goes_on: bool, hidden: int) -> Floats:
    """(P,) weights of the element, levels in units of ``se``.

    One unit opens the gate where ``e > fs``, one where ``e < -fs``, two where command and stem
    both go on in one direction; the fifth is the direction d, and the value is ``e - d fd``.
    Between two directions ``e`` decides: whoever goes on upwards has ``e >= fd > -fs``, also where
    fd is negative (overshoot); whoever has less did not move, but was measured with noise.
    """
    rows = np.zeros((hidden, INPUTS + 1))
    rows[_UP, [0, -1]] = 1.0 / width, -fs / width
    rows[_DOWN, [0, -1]] = -1.0 / width, -fs / width
    slope = _CONSENSUS if goes_on else 0.0
    near = 0.125 * slope / max(fs - fd, 0.1 * fs)
    rows[_GOES_ON_UP, [0, 3, -1]] = near, slope, -0.75 * _CONSENSUS - near * fd
    rows[_GOES_ON_DOWN, [0, 3, -1]] = -near, -slope, -0.75 * _CONSENSUS - near * fd
    rows[_DIRECTION, [0, 3]] = 6.0 / fs, 6.0
    gate = np.zeros(hidden + 1)
    gate[: _GOES_ON_DOWN + 1], gate[-1] = _GATE, 3.0 * _GATE
    value = np.zeros(hidden + INPUTS + 1)
    value[_DIRECTION], value[hidden] = -fd, 1.0
    return np.concatenate([value, gate, rows.ravel()])
