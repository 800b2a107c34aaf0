"""The actuator in front of a network: dead time, lag and speed limit, applied to OP alone.

The network gets the filtered command, so that its two lags are enough also for a valve that answers
late. The filter does not use MV, so the network stays a static function of its lags.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from stemwatch.models.compiled import compiled
from stemwatch.models.narx.architecture import ACTUATOR
from stemwatch.models.recording import Floats
from stemwatch.models.signals.holes import held

_LEAST_LAG = 1e-3  # of the interval
_LEAST_SLOWNESS = 1e-3  # of the interval for a percent: a thousand percent a sample is no limit


def actuator_output(op: Floats, interval_s: float, actuator: Mapping[str, float]) -> Floats:
    """(n,) percent: ``op`` (n,) delayed, lagged and limited in speed; NaN stays NaN.

    ``actuator``: dead time and time constants in seconds, slowness (1 / the top speed) in seconds
    per percent, upwards and downwards; 0 switches each off. Across a gap the last command is held.
    """
    if not any(actuator[name] > 0 for name in ACTUATOR):
        return op
    dead_time, *lags, slow_up, slow_down = (actuator[name] for name in ACTUATOR)
    least_lag, least_slow = _LEAST_LAG * interval_s, _LEAST_SLOWNESS * interval_s
    up, down = (1.0 - np.exp(-interval_s / lag) if lag > least_lag else 1.0 for lag in lags)
    most_up, most_down = (
        interval_s / slow if slow > least_slow else np.inf for slow in (slow_up, slow_down)
    )
    out = np.full(op.size, np.nan)
    _drive(held(op, np.isfinite(op)), dead_time / interval_s, up, down, most_up, most_down, out)
    out[np.isnan(op)] = np.nan
    return out


@compiled()
def _drive(
    op: Floats, delay: float, up: float, down: float, most_up: float, most_down: float, out: Floats
) -> None:
    """``delay`` in samples, ``up`` and ``down`` the lag's share per sample, the most that it moves
    in a sample: percent."""
    whole_samples = int(delay)
    fraction = delay - whole_samples
    output = op[0] if op.size else 0.0
    for k in range(op.size):
        i = max(k - whole_samples, 0)
        command = op[i] + fraction * (op[max(i - 1, 0)] - op[i])
        error = command - output
        output += min(max(error * (up if error > 0.0 else down), -most_down), most_up)
        out[k] = output
