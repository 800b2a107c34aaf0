"""``ShownStretch``: the samples, free runs and delay that the pictures of named effects share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.mismatch.evidence.effect_signature import later
from stemwatch.models.mismatch.findings import Effect, FreeRuns, Mismatch
from stemwatch.models.preparation.own_clock import duration
from stemwatch.models.recording import Floats, Recording
from stemwatch.models.stickslip.stroke_curve import in_travel
from stemwatch.service.report.charts.valve_charts import FLOW

NAIVE, EXTENDED = "S and J alone", "with what was left out"


@dataclass(frozen=True)
class ShownStretch:
    """What all pictures of a recording are drawn from, the stretch that its effects were named on:
    signals (n,) in percent, times in seconds."""

    op: Floats
    mv: Floats
    runs: FreeRuns
    interval_s: float
    late_s: float
    late_digits: str  # as many as the sentence about it has
    recording: Recording
    position: str  # what is drawn as the position

    @classmethod
    def of(cls, recording: Recording, runs: FreeRuns, mismatch: Mismatch) -> ShownStretch:
        """The stretch of ``recording`` that has the ``runs``; in percent of travel where OP has a
        curve to it."""
        first, last = runs.stretch
        recording, runs = recording.part(first, last), runs.part(first, last)
        recording = runs.followed(recording)
        if mismatch.stroke_curve is not None:
            recording = in_travel(recording, mismatch.stroke_curve)
        assert recording.mv is not None
        dead_time_named = any(effect.slug == "dead_time" for effect in mismatch.effects)
        return cls(
            op=recording.op.values,
            mv=recording.mv.values,
            runs=runs,
            interval_s=recording.interval_s,
            late_s=_late_s(mismatch),
            late_digits=".3g" if dead_time_named else ".1f",
            recording=recording,
            position="MV" if runs.position is None else FLOW,
        )

    @property
    def command(self) -> Floats:
        """OP as the stem had it: later by what MV follows by, earlier where OP is stored late."""
        return later(self.op, self.late_s, self.interval_s) if self.late_s else self.op

    @property
    def command_name(self) -> str:
        """What ``command`` is called beside a picture."""
        if not self.late_s:
            return "OP"
        unit_s = self.recording.unit_s
        size = duration(abs(self.late_s) / unit_s, unit_s, self.late_digits)
        return f"OP, {size} {'later' if self.late_s > 0.0 else 'earlier'}"


def _late_s(mismatch: Mismatch) -> float:
    """How much later than in the record the stem had OP, seconds: a dead time that was named, a
    delay too small to be one, less what the record stores OP late."""
    named = sum(value_of(one, "theta") for one in mismatch.effects if one.slug == "dead_time")
    of_record = (one.parameters for one in mismatch.record_effects)
    return named + sum(one.get("delay_s", 0.0) - one.get("late_s", 0.0) for one in of_record)


def value_of(effect: Effect, name: str) -> float:
    """A parameter of a named effect; 0 where it has none or none was found."""
    estimate = effect.parameters.get(name)
    return 0.0 if estimate is None or estimate.value is None else float(estimate.value)


def seconds_from(sample_index: NDArray[np.int64], first: int, interval_s: float) -> Floats:
    """Seconds from sample ``first``."""
    return np.asarray((sample_index - first) * interval_s, dtype=np.float64)
