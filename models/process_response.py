"""How PV answers the valve: static gain, lag and delay, from the recording of the loop.

``PV = c + K F(MV)``, F a dead time and a first-order lag, or an integral where PV has no rest of
its own, as a level. K is told by least squares for each lag and delay of a grid; the pair that
leaves least is taken. Its interval is that of a bootstrap over blocks of time
(``block_bootstrap``). Loads move PV too: where the valve explains less than ``LEAST_SHARE`` of
PV, or the interval holds 0, the gain is unknown, and the reason says so.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stemwatch.models.block_bootstrap import COVERAGE, block_weights
from stemwatch.models.estimate import Estimate
from stemwatch.models.recording import Floats, Recording, Role

LAGS_S = (0.0, 2.0, 5.0, 12.0, 30.0, 80.0)
DELAYS_S = (0.0, 2.0, 5.0, 10.0, 20.0)
LEAST_SHARE = 0.4  # of PV's variance that the valve must explain
FEWEST_SAMPLES = 120
MOST_SAMPLES = 1500  # a longer recording is thinned
BLOCKS, REPLICATES = 24, 200
CLEARLY = 0.9  # of the other's residual, from which a process that integrates is one


@dataclass(frozen=True, kw_only=True)
class ProcessResponse:
    """``gain`` in units of PV for a percent of the valve, or for a percent and second where
    ``integrating``; ``lag_s`` and ``delay_s`` in seconds. ``pv_low`` and ``pv_high`` are where PV
    was in the recording, 1st and 99th percentile."""

    gain: Estimate
    lag_s: float = 0.0
    delay_s: float = 0.0
    integrating: bool = False
    unit: str = ""
    pv_low: float | None = None
    pv_high: float | None = None

    @property
    def usual_range(self) -> float | None:
        """How far PV moved in the recording itself, 1st to 99th percentile."""
        if self.pv_low is None or self.pv_high is None:
            return None
        return self.pv_high - self.pv_low

    def upset(self, travel: Floats, interval_s: float) -> float | None:
        """The largest change of PV that ``travel`` (n,), percent, makes from rest; by the end of
        the gain's interval that is farther from 0. ``None`` where the gain is not known."""
        ends = [end for end in (self.gain.low, self.gain.high, self.gain.value) if end is not None]
        if self.gain.value is None:
            return None
        moved = _answer(travel - travel[0], interval_s, self.lag_s, self.delay_s, self.integrating)
        return float(np.max(np.abs(moved)) * max(abs(end) for end in ends))


def process_response(recording: Recording) -> ProcessResponse:
    """The response of PV to the position, or to OP where there is none; never raises."""
    pv = recording.get(Role.PV)
    if pv is None:
        return _unknown("no PV was recorded with this valve")
    valve = recording.mv if recording.mv is not None else recording.op
    both_finite = np.isfinite(pv.values) & np.isfinite(valve.values)
    if np.count_nonzero(both_finite) < FEWEST_SAMPLES:
        return _unknown("PV and valve were recorded together for too short a time", pv.unit)
    step_s = recording.interval_s * (recording.own_unit_s or 1.0)
    stride = max(len(recording) // MOST_SAMPLES, 1)
    sample_index = np.arange(len(recording))
    y = np.interp(sample_index, sample_index[both_finite], pv.values[both_finite])[::stride]
    x = np.interp(sample_index, sample_index[both_finite], valve.values[both_finite])[::stride]
    low, high = (float(value) for value in np.percentile(y, (1.0, 99.0)))
    response = _fitted(x, y, step_s * stride)
    seen = {"unit": pv.unit, "pv_low": low, "pv_high": high}
    if isinstance(response, str):
        return ProcessResponse(gain=Estimate.unknown(response, pv.unit), **seen)  # type: ignore[arg-type]
    gain, lag_s, delay_s, integrating = response
    return ProcessResponse(
        gain=gain,
        lag_s=lag_s,
        delay_s=delay_s,
        integrating=integrating,
        unit=pv.unit,
        pv_low=low,
        pv_high=high,
    )


def _unknown(reason: str, unit: str = "") -> ProcessResponse:
    return ProcessResponse(gain=Estimate.unknown(reason, unit), unit=unit)


def _answer(x: Floats, step_s: float, lag_s: float, delay_s: float, integrating: bool) -> Floats:
    """(n,) ``x`` behind a delay and a lag, or its integral."""
    late = round(delay_s / step_s)
    delayed = np.concatenate((np.full(min(late, x.size), x[0]), x[: max(x.size - late, 0)]))
    if integrating:
        return np.asarray(np.cumsum(delayed) * step_s)
    if lag_s <= 0.0:
        return np.asarray(delayed)
    share = 1.0 - float(np.exp(-step_s / lag_s))
    out = np.empty(x.size)
    level = float(delayed[0])
    for k, value in enumerate(delayed.tolist()):
        level += share * (value - level)
        out[k] = level
    return out


def _fitted(x: Floats, y: Floats, step_s: float) -> tuple[Estimate, float, float, bool] | str:
    """Gain, lag, delay, and whether it integrates; or why there is none."""
    if float(np.ptp(x)) == 0.0 or float(np.ptp(y)) == 0.0:
        return "the valve or PV did not move in the recording"
    options = [
        (lag_s, delay_s, integrating)
        for integrating in (False, True)
        for lag_s in ((0.0,) if integrating else LAGS_S)
        for delay_s in DELAYS_S
    ]
    best: dict[bool, tuple[float, float, float]] = {}
    for lag_s, delay_s, integrating in options:
        columns = _columns(x, step_s, lag_s, delay_s, integrating)
        residual = y - columns @ np.linalg.lstsq(columns, y, rcond=None)[0]
        cost = float(residual @ residual)
        if integrating not in best or cost < best[integrating][0]:
            best[integrating] = (cost, lag_s, delay_s)
    integrating = best[True][0] < CLEARLY * best[False][0]
    cost, lag_s, delay_s = best[integrating]
    share = 1.0 - cost / float(np.sum((y - y.mean()) ** 2))
    if share < LEAST_SHARE:
        return f"the valve explains only {100.0 * max(share, 0.0):.0f} % of what PV did"
    columns = _columns(x, step_s, lag_s, delay_s, integrating)
    coefficients = _draw_coefficients(columns, y)
    low, high = (float(end) for end in np.percentile(coefficients, COVERAGE))
    gain = float(np.linalg.lstsq(columns, y, rcond=None)[0][-1])
    if low <= 0.0 <= high:
        return "which way PV answers the valve cannot be told from the recording"
    return (
        Estimate(value=gain, low=min(low, gain), high=max(high, gain)),
        lag_s,
        delay_s,
        integrating,
    )


def _columns(x: Floats, step_s: float, lag_s: float, delay_s: float, integrating: bool) -> Floats:
    """(n, 2 or 3) a constant, for an integrating process the time, and what PV follows."""
    answer = _answer(x - x.mean(), step_s, lag_s, delay_s, integrating)
    ones = np.ones(x.size)
    if integrating:
        return np.column_stack((ones, np.linspace(-1.0, 1.0, x.size), answer))
    return np.column_stack((ones, answer))


def _draw_coefficients(columns: Floats, y: Floats) -> Floats:
    """(REPLICATES,) gains by the bootstrap over blocks of time. Seeded."""
    blocks = min(BLOCKS, max(y.size // 10, 2))
    block = np.arange(y.size) * blocks // y.size
    counts = np.bincount(block, minlength=blocks)
    weights = block_weights(counts, REPLICATES, np.random.default_rng(23))
    products = np.array([columns[block == b].T @ columns[block == b] for b in range(blocks)])
    sides = np.array([columns[block == b].T @ y[block == b] for b in range(blocks)])
    normal = np.einsum("rb,bij->rij", weights, products)
    side = weights @ sides
    ridge = 1e-9 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(columns.shape[1])
    return np.asarray(np.linalg.solve(normal + ridge, side[:, :, None])[:, -1, 0])
