"""The stick-slip model's run over any stretch of a valve, from the numbers that were stored."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from stemwatch.models.recording import Floats, Recording

_NEUTRAL = {
    "dead_time_s": 0.0,
    "lag_rising_s": 0.0,
    "lag_falling_s": 0.0,
    "speed_rising_percent_per_s": np.inf,
    "speed_falling_percent_per_s": np.inf,
    "position_zero_percent": 0.0,
}


def fitted_run(recording: Recording, indicators: Mapping[str, float]) -> Floats | None:
    """(n,) free run of MV in percent, NaN where OP or MV is not known; ``None`` where S, J or MV is
    missing, or MV is not in percent.

    The element is that of ``models.stickslip.kernel`` in its canonical form, with the stored S, J,
    dead time, lags, speed limits and zero; it starts from the measurement and after each hole.
    """
    mv = recording.mv
    S, J = indicators.get("S_percent"), indicators.get("J_percent")
    if mv is None or S is None or J is None or mv.unit != recording.op.unit:
        return None
    usable = recording.usable
    if usable.sum() < 2:
        return None
    from stemwatch.models.stickslip.problem import make_problem  # compiled: loaded when asked for

    known = {name: indicators.get(name, default) for name, default in _NEUTRAL.items()}
    q = np.array([S, J, *known.values(), 1.0, 0.0])
    return np.where(usable, make_problem(recording).simulate(q), np.nan)
