"""Sensor drift: ``MV += D (t/T - 1/2) + sum a_j sin(j pi t/T)``, j = 1 to 3. Neutral: all 0.

``D`` and the ``a_j`` in percent of travel over the record of length ``T``: a reading that wanders
does not do so along a straight line, and a few slow waves follow it.

Signature: the residual climbs or falls with time, at rest and in motion, at every travel alike.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.field_advice import FieldAdvice, FieldTest, check_steps
from stemwatch.models.mismatch.stem_model import stem as stem_number
from stemwatch.models.mismatch.stem_model.stem import Stem
from stemwatch.models.mismatch.term import Coordinate, RecordingSummary, Term, Words
from stemwatch.models.mismatch.terms._common import (
    CALIBRATE_FROM_PERCENT,
    CALIBRATE_LATER,
    StemTerm,
    about_value,
    either_sign,
    number,
    size,
)
from stemwatch.models.recording import Floats

WAVES = (1, 2, 3)
STRAIGHT = 0.5  # of the range that lies between beginning and end; less is a wander
MATERIAL_PERCENT = 0.5  # over the record; what a calibration would find and correct


class SensorDrift(StemTerm):
    """A reading that wanders: a straight drift and three slow waves, percent."""

    slug = "sensor_drift"
    order = 70
    may_swing = False
    words = Words(
        of_record=True,
        no_work=CALIBRATE_LATER,
        plain="the position reading wanders slowly over the record",
        decide=(
            "Read MV with the valve on its seat or against a stop at the beginning and at the "
            "end of a shift: a drift shows there, a creeping stem or growing friction does not."
        ),
        advice=FieldAdvice(
            title="position reading drifts",
            steps=check_steps(
                "desk: Compare MV at the same OP at the beginning and the end of a shift.",
                (
                    "look: Look at clamp, arm or magnet bracket, the supply voltage and a worn "
                    "potentiometer; at moisture in the terminals; at heat from the bonnet or "
                    "the sun."
                ),
                "manual: Read MV against a mechanical stop, then again some hours later.",
                (
                    "air: Calibrate at both ends of travel; exchange the transmitter where it "
                    "drifts again."
                ),
            ),
            parts=(
                "position transmitter",
                "clamp or magnet bracket",
                "terminals and cable glands",
            ),
            damage="AIR",
            cause="3.3",
            part="position transmitter",
        ),
    )

    def coordinates(self, summary: RecordingSummary) -> tuple[Coordinate, ...]:
        """The drift over the record, and the slow waves on it."""
        waves = (Coordinate(name=f"wave_{j}_percent", low=-5.0, high=5.0) for j in WAVES)
        return (Coordinate(name="D_percent", low=-10.0, high=10.0), *waves)

    def starts(self, summary: RecordingSummary) -> Floats:
        """From 0.6 to 4 % over the record, either way, and a bend to either side."""
        straight = either_sign(0.6, 1.5, 4.0)
        starts = np.zeros((straight.shape[0] + 2, 1 + len(WAVES)))
        starts[: straight.shape[0], 0] = straight[:, 0]
        starts[-2:, 1] = (-0.7, 0.7)
        return starts

    def fill(self, stem: Stem, values: Floats) -> None:
        """The drift of the reading."""
        stem.numbers[stem_number.DRIFT] = values[0]
        if values[1:].any():
            stem.wander += values[1:] @ _waves(stem.wander.size)
            stem.numbers[stem_number.BY_TIME] = 1.0

    def material(self, values: Floats, summary: RecordingSummary) -> bool:
        """The reading wanders by half a percent over the record."""
        return bool(np.ptp(course(values)) >= MATERIAL_PERCENT)

    def inherent(self, values: Floats, summary: RecordingSummary) -> bool:
        """It goes up and down by less than a stroke check finds fault with; what drifts one way
        goes on."""
        over = float(np.ptp(course(values)))
        return over < CALIBRATE_FROM_PERCENT and abs(float(values[0])) < STRAIGHT * over

    def parameters(self, values: Floats) -> Mapping[str, tuple[float, str]]:
        """From the first to the last reading, positive upwards, and from lowest to highest."""
        return {"D": (float(values[0]), "%"), "range": (float(np.ptp(course(values))), "%")}

    def sentence(self, parameters: Mapping[str, Estimate], rising: str, falling: str) -> str:
        if abs(number(parameters["D"])) < STRAIGHT * number(parameters["range"]):
            return (
                f"The position reading wanders over {parameters['range']} of travel during the "
                "record, up and down."
            )
        direction = "downwards" if number(parameters["D"]) < 0.0 else "upwards"
        return (
            f"The position reading drifts {direction} by {size(parameters['D'])} of travel over "
            "the record."
        )

    def field_test(self, parameters: Mapping[str, Estimate]) -> FieldTest:
        return FieldTest(
            do=(
                "Loop in manual: mark the stem, note its reading, and bring it back to the mark "
                "after a "
                "time as long as this recording."
            ),
            fails=f"readings apart by up to {about_value(parameters['range'])}",
            passes=f"within {MATERIAL_PERCENT} %",
        )


@cache
def _waves(samples: int) -> Floats:
    """(3, samples) the slow waves over a record."""
    time = np.linspace(0.0, 1.0, samples)
    return np.asarray(np.sin(np.pi * np.outer(WAVES, time)))


def course(values: Floats) -> Floats:
    """(101,) how a reading that drifts by ``values`` (4,) goes over the record, percent."""
    return np.asarray(values[0] * np.linspace(-0.5, 0.5, 101) + values[1:] @ _waves(101))


TERM: Term = SensorDrift()
