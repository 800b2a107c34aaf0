"""The loop around a screened valve, and what the repair of one that sticks would change in it."""

from __future__ import annotations

from stemwatch.models.closed_loop.fitted_loop import FittedLoop, FittedValve, fit_loop
from stemwatch.models.closed_loop.what_if import REPAIRED, predict
from stemwatch.models.health_indicators import indicators
from stemwatch.models.recording import Recording
from stemwatch.models.screening_result import Screening
from stemwatch.models.verdict import Verdict


def loop_of(recording: Recording, screening: Screening) -> FittedLoop | str:
    """The loop of a ``recording`` with the valve that its ``screening`` found; or why there is
    none."""
    numbers = {name: indicator.value for name, indicator in screening.indicators.items()}
    curve = screening.stroke_curve
    slope = 1.0 if curve is None else curve.slope
    valve = FittedValve.of(screening.S, screening.J, numbers, slope)
    return valve if isinstance(valve, str) else fit_loop(recording, valve)


def with_repair(screening: Screening, recording: Recording, target_band: float | None) -> Screening:
    """``screening`` of a sticking valve with the predicted effect of its repair on the loop, where
    the loop can be simulated; PV is on target within ``target_band`` of SP, in its unit.
    """
    if screening.verdict not in (Verdict.STICKY, Verdict.WATCH):
        return screening
    loop = loop_of(recording, screening)
    if isinstance(loop, str):
        return screening
    repaired = indicators.of_repair(predict(loop, REPAIRED, target_band))
    return screening.with_indicators(repaired)
