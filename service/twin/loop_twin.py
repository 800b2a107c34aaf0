"""Twins of loops, kept, and the changes that a control engineer would try first."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from threading import Lock

from stemwatch.models.closed_loop.fitted_loop import FittedLoop, Knocker
from stemwatch.models.closed_loop.what_if import REPAIRED, LoopChange, Prediction, predict
from stemwatch.models.estimate import Estimate
from stemwatch.models.recording import Recording
from stemwatch.models.screening.repair import loop_of
from stemwatch.models.screening_result import Screening
from stemwatch.service.presenter.wording import figure

# Hagglund's knocker as the literature sets it: a pulse of about S, two control intervals wide.
KNOCK_OF_S, KNOCK_EVERY_S, KNOCK_FOR_S = 1.0, 10.0, 2.0
MOST_KEPT = 8  # twins for pages whose sliders are moved; each holds a few signals of an hour


@dataclass(frozen=True, kw_only=True)
class WhatIf:
    """A change in words, and what the loop would have done with it."""

    name: str
    change: LoopChange
    prediction: Prediction


class TwinCache:
    """Twins by the screening that they are of; those that were asked for last are kept."""

    def __init__(self) -> None:
        self._kept: OrderedDict[tuple[int, int], FittedLoop | str] = OrderedDict()
        self._guard = Lock()

    def twin(
        self, store: int, number: int, screening: Screening, read: Callable[[], Recording | str]
    ) -> FittedLoop | str:
        """The twin of screening ``number`` of a ``store``, or why there is none. ``read`` gives the
        samples of its window, or why not; it is called only where the twin is not kept."""
        key = (store, number)
        with self._guard:
            if key in self._kept:
                self._kept.move_to_end(key)
                return self._kept[key]
        recording = read()
        if isinstance(recording, str):
            return recording  # not kept, since the source may answer the next time
        twin = loop_of(recording, screening)
        with self._guard:
            self._kept[key] = twin
            while len(self._kept) > MOST_KEPT:
                self._kept.popitem(last=False)
        return twin


def usual_changes(loop: FittedLoop) -> list[tuple[str, LoopChange]]:
    """Repair, packing of half the friction, two other tunings, and a knocker."""
    S, J = loop.valve.S, loop.valve.J
    knocker = Knocker(height=KNOCK_OF_S * S, every_s=KNOCK_EVERY_S, for_s=KNOCK_FOR_S)
    return [
        ("repaired: S = J = 0", REPAIRED),
        (
            f"half the friction: S {figure(S / 2, 2)} %",
            LoopChange(S=S / 2.0, J=J / 2.0),
        ),
        ("controller gain halved", LoopChange(gain_times=0.5)),
        ("reset time doubled", LoopChange(reset_times=2.0)),
        (
            f"knocker {figure(knocker.height, 2)} %, {knocker.for_s:g} of {knocker.every_s:g} s",
            LoopChange(knocker=knocker),
        ),
    ]


def what_ifs(loop: FittedLoop, changes: list[tuple[str, LoopChange]]) -> list[WhatIf]:
    """Each change with its prediction."""
    return [
        WhatIf(name=name, change=change, prediction=predict(loop, change))
        for name, change in changes
    ]


def settings_in_words(loop: FittedLoop) -> str:
    """Controller and process as they were found, in one sentence."""
    law, process, step_s = loop.law, loop.process, loop.recorded.interval_s
    reset = law.reset_s(step_s)
    controller = f"gain {figure(law.gain, 2)} % of OP for {_unit(loop)}"
    if reset is not None:
        controller += f", reset time {figure(reset, 2)} s"
    if process.integrates:
        kind = f"integrates, {figure(process.gain / step_s, 2)} {loop.unit} a second for 1 %"
    else:
        kind = (
            f"gain {figure(process.gain, 2)} {loop.unit} for 1 %, lag "
            f"{figure(process.lag * step_s, 2)} s"
        )
    return (
        f"Controller: {controller}. Process: {kind}, delay {figure(process.delay * step_s, 2)} s."
    )


def _unit(loop: FittedLoop) -> str:
    return "1 % of PV" if loop.unit == "%" else f"1 {loop.unit}"


def to_object(loop: FittedLoop, rows: list[WhatIf]) -> dict[str, object]:
    """The twin as plain types, for JSON."""
    return {
        "controller": {
            "gain": loop.law.gain,
            "reset_s": loop.law.reset_s(loop.recorded.interval_s),
            "explained": loop.law.explained,
        },
        "process": {
            "gain": loop.process.gain,
            "integrates": loop.process.integrates,
            "lag_s": loop.process.lag * loop.recorded.interval_s,
            "second_lag_s": loop.process.second_lag * loop.recorded.interval_s,
            "delay_s": loop.process.delay * loop.recorded.interval_s,
        },
        "pv_unit": loop.unit,
        "valve": {"S": loop.valve.S, "J": loop.valve.J},
        "what_if": [
            {
                "name": row.name,
                "predicted": {
                    name: _estimate(estimate) for name, estimate in row.prediction.predicted.items()
                },
                "variance_fall_percent": _estimate(row.prediction.fall("error_std", squared=True)),
            }
            for row in rows
        ],
        "recorded": None if not rows else vars(rows[0].prediction.recorded),
        "run_as_it_is": None if not rows else vars(rows[0].prediction.as_it_is),
    }


def _estimate(estimate: Estimate) -> dict[str, object]:
    return {
        "value": estimate.value,
        "low": estimate.low,
        "high": estimate.high,
        "unit": estimate.unit,
        "reason": estimate.reason,
    }
