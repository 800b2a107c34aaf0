"""The networks of a run: what each starts from, and their training together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stemwatch.models.narx.architecture import StickSlipStart
from stemwatch.models.narx.example import NarxExample, NarxFit, NarxSettings
from stemwatch.models.stickslip import kernel
from stemwatch.models.stickslip.fit import StickSlipFit
from stemwatch.models.stickslip.parameters import to_kernel
from stemwatch.models.stickslip.stroke_curve import StrokeCurve


def train_each(examples: Sequence[NarxExample], settings: NarxSettings) -> list[NarxFit]:
    """All fits together; where that fails, each alone, so that a bad record loses only its own."""
    from stemwatch.models.narx.training import train  # torch takes two seconds to import

    try:
        return train(examples, settings)
    except Exception as error:  # one valve must not end a plant's run
        if len(examples) > 1:
            return [fit for example in examples for fit in train_each([example], settings)]
        reason = f"the training broke down ({type(error).__name__}: {error})"
        return [NarxFit(valve=examples[0].valve, reason=reason)]


def network_start(fit: StickSlipFit, curve: StrokeCurve | None) -> StickSlipStart | None:
    """The element as it was fitted to the training part, for the network to start from.

    The network gets OP as it was recorded, so that it can be compared with one of another window;
    it starts from the chord of ``curve`` and learns the curvature.
    """
    q = to_kernel(fit.trained, fit.evaluator.restick)[0]
    if q[kernel.GAIN] == 0.0:
        return None
    names = ("dead_time_s", "lag_up_s", "lag_down_s")
    actuator = {name: float(q[row]) for row, name in enumerate(names, start=kernel.DEAD_TIME_S)}
    actuator["slow_up_s_per_percent"] = float(1.0 / q[kernel.RATE_UP])
    actuator["slow_down_s_per_percent"] = float(1.0 / q[kernel.RATE_DOWN])
    slope, shift = (1.0, 0.0) if curve is None else (curve.slope, curve.zero)
    for name in ("slow_up_s_per_percent", "slow_down_s_per_percent"):
        actuator[name] *= abs(slope)
    return StickSlipStart(
        S=float(q[kernel.S]) / abs(slope),
        J=float(q[kernel.J]) / abs(slope),
        zero=float(q[kernel.ZERO]) + float(q[kernel.GAIN]) * shift,
        gain=float(q[kernel.GAIN]) * slope,
        actuator=actuator,
        goes_on=bool(np.isfinite(q[kernel.RESTICK])),
    )
