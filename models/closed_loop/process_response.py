"""How PV responds to the valve, from any recording with both: for predicting the upset by a test.

The process is that of the loop (``process_model``), which separates the valve's part of PV from the
disturbance and the controller. Here its gain gets an interval and its times are in seconds. Where
the valve explains less than ``LEAST_SHARE`` of PV the gain is unknown: a test that upsets PV by a
multiple of the predicted amount is worse than one whose sheet says that the upset is not known.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stemwatch.models.closed_loop import kernel
from stemwatch.models.closed_loop.process_model import ProcessModel, process_model
from stemwatch.models.estimate import Estimate
from stemwatch.models.recording import Floats, Recording, Role
from stemwatch.models.signals.holes import bridged, longest_stretch

BRIDGED = 20  # samples of a hole
FEWEST_SAMPLES = 120
MOST_SAMPLES = 6000  # the last ones of a longer recording
LEAST_SHARE = 0.4  # of PV's variance that the valve must explain
QUANTILE = 1.96  # of the normal distribution, for an interval of 95 %


@dataclass(frozen=True, kw_only=True)
class ProcessResponse:
    """``gain`` in units of PV for a percent of the valve, or for a percent and second where
    ``integrating``; lags and delay in seconds. ``pv_low`` and ``pv_high`` are where PV was in the
    recording, 1st and 99th percentile."""

    gain: Estimate
    lag_s: float = 0.0
    second_lag_s: float = 0.0
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
        """The largest change of PV that ``travel`` (n,), percent, causes from rest, with the end of
        the gain's interval that is farther from 0. ``None`` where the gain is not known.
        """
        ends = [end for end in (self.gain.low, self.gain.high, self.gain.value) if end is not None]
        if self.gain.value is None:
            return None
        lags = self.lag_s / interval_s, self.second_lag_s / interval_s, self.delay_s / interval_s
        moved = np.empty(travel.size + 1)
        kernel.process_answer(np.append(travel, travel[-1]), *lags, self.integrating, moved)
        in_step = interval_s if self.integrating else 1.0
        return float(np.max(np.abs(moved)) * in_step * max(abs(end) for end in ends))


def process_response(recording: Recording) -> ProcessResponse:
    """The response of PV to the position, or to OP where there is none; never raises."""
    pv = recording.get(Role.PV)
    if pv is None:
        return _unknown("no PV was recorded with this valve")
    valve = recording.mv if recording.mv is not None else recording.op
    known = np.isfinite(pv.values) & np.isfinite(valve.values)
    first, last = longest_stretch(known, BRIDGED)
    first = max(first, last - MOST_SAMPLES)
    if last - first < FEWEST_SAMPLES:
        return _unknown("PV and valve were recorded together for too short a time", pv.unit)
    x, y = (bridged(values[first:last], known[first:last]) for values in (valve.values, pv.values))
    low, high = (float(value) for value in np.percentile(pv.values[known], (1.0, 99.0)))
    # A process that is faster than the interval responds in the same sample; in ``process_model``
    # it does so in the next.
    process = process_model(x[1:], y[:-1])
    if isinstance(process, str):
        gain = Estimate.unknown(process, pv.unit)
        return ProcessResponse(gain=gain, unit=pv.unit, pv_low=low, pv_high=high)
    step_s = recording.interval_s * (recording.own_unit_s or 1.0)
    return ProcessResponse(
        gain=_gain(process, y[:-1], step_s, pv.unit),
        lag_s=process.lag * step_s,
        second_lag_s=process.second_lag * step_s,
        delay_s=process.delay * step_s,
        integrating=process.integrates,
        unit=pv.unit,
        pv_low=low,
        pv_high=high,
    )


def _gain(process: ProcessModel, pv: Floats, step_s: float, unit: str) -> Estimate:
    """The gain, of an integral for a second, with its 95 % interval."""
    share = _explained(process, pv)
    if share < LEAST_SHARE:
        reason = f"the valve explains only {100.0 * share:.0f} % of what PV did"
        return Estimate.unknown(reason, unit)
    in_step = step_s if process.integrates else 1.0
    half = QUANTILE * float(np.sqrt(process.spread[3, 3])) / in_step
    gain = process.gain / in_step
    return Estimate(value=gain, low=gain - half, high=gain + half)


def _explained(process: ProcessModel, pv: Floats) -> float:
    """The share of PV's variance that the answer explains, beside a drift where it integrates."""
    columns = [np.ones(pv.size), pv - process.disturbance]
    if process.integrates:
        columns.append(np.linspace(-1.0, 1.0, pv.size))
    basis = np.stack(columns, axis=1)
    left = pv - basis @ np.linalg.lstsq(basis, pv, rcond=None)[0]
    return max(1.0 - float(np.var(left)) / float(np.var(pv)), 0.0)


def _unknown(reason: str, unit: str = "") -> ProcessResponse:
    return ProcessResponse(gain=Estimate.unknown(reason, unit), unit=unit)
