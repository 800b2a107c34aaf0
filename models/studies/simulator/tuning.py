"""Controller settings for a simulated loop: sound ones, and ones at the edge of stability."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stemwatch.models.studies.simulator.loop import Process
from stemwatch.models.studies.simulator.valve import Actuator


@dataclass(frozen=True, kw_only=True)
class ControllerSettings:
    """Gain in percent of OP per percent of PV, reset in seconds."""

    gain: float
    reset_s: float


def delay_s(process: Process, actuator: Actuator, scan_s: float) -> float:
    """The effective dead time of the loop: dead times, half a scan, and the small lags."""
    true = process.dead_time_s + actuator.dead_time_s + 0.5 * scan_s
    return true + actuator.air_lag_s + actuator.viscous_s + 0.5 * process.second_lag_s


def sound_settings(process: Process, delay: float, slowness: float = 1.5) -> ControllerSettings:
    """SIMC rules with a closed-loop time constant of ``slowness`` delays.

    Self-regulating: ``Kc = lag/(K (Tc + delay))``, ``Ti = min(lag, 4 (Tc + delay))``; integrating:
    ``Kc = 1/(K (Tc + delay))``, ``Ti = 4 (Tc + delay)``. Skogestad (2003),
    doi:10.1016/S0959-1524(02)00062-8.
    """
    answer = (1.0 + slowness) * delay
    if process.integrating:
        return ControllerSettings(gain=1.0 / (process.gain * answer), reset_s=4.0 * answer)
    lag = process.lag_s + 0.5 * process.second_lag_s
    return ControllerSettings(gain=lag / (process.gain * answer), reset_s=min(lag, 4.0 * answer))


def ultimate_gain(process: Process, actuator: Actuator, scan_s: float, reset_s: float) -> float:
    """The controller gain at which the linear loop with this reset time oscillates for ever.

    ``1/|L(jw)|`` for unit controller gain where the phase of L first falls through -180 degrees (an
    integrating loop starts there and rises first); the scan counts as half a scan of dead time.
    """
    s = 1j * np.geomspace(1e-4, 100.0, 20_000)
    dead = process.dead_time_s + actuator.dead_time_s + 0.5 * scan_s
    first = 1.0 / s if process.integrating else 1.0 / (process.lag_s * s + 1.0)
    lags = (process.second_lag_s * s + 1.0) * (actuator.air_lag_s * s + 1.0)
    valve = 1.0 / (actuator.viscous_s * s + 1.0)
    loop = process.gain * first * valve / lags * (1.0 + 1.0 / (reset_s * s)) * np.exp(-dead * s)
    phase = np.unwrap(np.angle(loop))
    falls = np.flatnonzero((phase[:-1] > -np.pi) & (phase[1:] <= -np.pi))
    return float(1.0 / np.abs(loop[falls[0]]))
