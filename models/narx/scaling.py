"""The scales of one valve's network, from its training part, and its signals in these scales."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from stemwatch.models.narx.architecture import StickSlipStart
from stemwatch.models.recording import Bools, Floats

# A run is clamped this share of the range outside it: no extrapolation far beyond the training
# data, yet a slightly larger swing is not flattened. The error has hardly any margin: slips begin
# at its extremes, and a run beyond them may stay stuck for ever.
_MARGIN = {"mv": 0.5, "error": 0.05, "change": 0.25, "drift": 0.25}
_STRETCH = {"error": 0.5, "drift": 0.25}
# The change scale is at least this share of the error scale; a quantised OP would make it tiny.
_LEAST_CHANGE = 0.1
# No reading is this large, and the square of a larger number overflows.
_LARGEST = 1e15


@dataclass(frozen=True, kw_only=True)
class ScaledSignals:
    """(n,) each: ``level`` and ``position`` in units of ``se``, ``move`` in units of ``sd``."""

    level: Floats
    move: Floats
    position: Floats


def believable(op: Floats, mv: Floats, usable: Bools) -> Bools:
    """(n,) the ``usable`` samples at which OP and MV are numbers below 1e15 in size."""
    with np.errstate(invalid="ignore"):
        return np.asarray(usable & (np.abs(op) < _LARGEST) & (np.abs(mv) < _LARGEST))


def fit_scaling(
    op: Floats, mv: Floats, usable: Bools, start: StickSlipStart | None = None
) -> dict[str, float]:
    """``NarxNetwork.scaling`` from the usable samples of a training part.

    A valve's position in percent follows a command in percent one to one, so ``gain`` is 1 where
    the spreads are within a factor of two; elsewhere MV has another unit (a flow, millimetres), or
    runs the other way, and ``gain`` is the ratio of the spreads with the correlation's sign. A
    ``start`` gives gain and centres itself. ``error_scale = std(e)``, ``change_scale = max(std(dv),
    0.1 error_scale)``.
    """
    u, y = op[usable], mv[usable]
    scaling = {"op_centre": float(np.mean(u)), "mv_centre": float(np.mean(y))}
    scaling["gain"] = _gain(u - scaling["op_centre"], y - scaling["mv_centre"])
    if start is not None:
        scaling["gain"] = start.gain
        scaling["mv_centre"] = start.zero + start.gain * scaling["op_centre"]
    pairs = usable[1:] & usable[:-1]
    error = command_error(op, mv, scaling)[1:][pairs]
    change = scaling["gain"] * np.diff(op)[pairs]
    scaling["error_scale"] = max(float(np.std(error)), 1e-6 * float(np.std(y)))
    scaling["change_scale"] = max(float(np.std(change)), _LEAST_CHANGE * scaling["error_scale"])
    return scaling


def fit_ranges(
    op: Floats, mv: Floats, usable: Bools, scaling: Mapping[str, float]
) -> dict[str, tuple[float, float]]:
    """``NarxNetwork.ranges`` from the usable samples of a training part."""
    pairs = np.concatenate([[False], usable[1:] & usable[:-1]])
    signals = {
        "op": op[usable],
        "mv": mv[usable],
        "error": command_error(op, mv, scaling)[pairs],
        "change": scaling["gain"] * np.diff(op, prepend=np.nan)[pairs],
        "drift": np.diff(mv, prepend=np.nan)[pairs],
    }
    return {name: (float(x.min()), float(x.max())) for name, x in signals.items()}


def element_ranges(ranges: Mapping[str, tuple[float, float]]) -> dict[str, tuple[float, float]]:
    """Wider ranges of error and drift, for a network that starts from a stick-slip element: the
    element holds beyond what the training part shows."""
    wide = dict(ranges)
    for name, share in _STRETCH.items():
        low, high = ranges[name]
        wide[name] = low - share * (high - low), high + share * (high - low)
    return wide


def command_error(op: Floats, mv: Floats, scaling: Mapping[str, float]) -> Floats:
    """(n,) ``e = v(t) - y(t-1)`` in MV's unit; NaN at the first sample."""
    v = scaling["mv_centre"] + scaling["gain"] * (op - scaling["op_centre"])
    return np.concatenate([[np.nan], v[1:] - mv[:-1]])


def scale(
    op: Floats,
    mv: Floats,
    scaling: Mapping[str, float],
    ranges: Mapping[str, tuple[float, float]],
) -> ScaledSignals:
    """The signals a network sees, the command's change clamped; NaN stays NaN."""
    v = scaling["gain"] * (op - scaling["op_centre"])
    change = np.clip(np.diff(v, prepend=np.nan), *_widened(ranges, "change"))
    return ScaledSignals(
        level=v / scaling["error_scale"],
        move=change / scaling["change_scale"],
        position=(mv - scaling["mv_centre"]) / scaling["error_scale"],
    )


def limits(
    ranges: Mapping[str, tuple[float, float]], scaling: Mapping[str, float]
) -> tuple[float, float, float, float, float, float]:
    """Where a run is clamped, in units of ``se``: lowest and highest error, increment, position."""
    se, centre = scaling["error_scale"], scaling["mv_centre"]
    error_low, error_high = _widened(ranges, "error")
    slowest, fastest = _widened(ranges, "drift")
    low, high = _widened(ranges, "mv")
    return (
        *(error_low / se, error_high / se, slowest / se, fastest / se),
        *((low - centre) / se, (high - centre) / se),
    )


def _gain(u: Floats, y: Floats) -> float:
    spread = float(np.std(y) / np.std(u))
    sign = -1.0 if float(np.dot(u, y)) < 0 else 1.0
    return sign if 0.5 <= spread <= 2.0 else sign * spread


def _widened(ranges: Mapping[str, tuple[float, float]], name: str) -> tuple[float, float]:
    low, high = ranges[name]
    margin = _MARGIN[name] * (high - low)
    return low - margin, high + margin
