"""Zero shift: ``MV += zero``, free in every hypothesis. Neutral: ``zero = 0``.

For the element it is exactly the same as a bias of the force: an asymmetric S, a preload of the
spring, a mean flow force.

Signature: the same error in all phases and in both directions.
"""

from __future__ import annotations

from collections.abc import Mapping

from stemwatch.models.estimate import Estimate
from stemwatch.models.field_advice import TRANSMITTER_SETTING, FieldAdvice, FieldTest, check_steps
from stemwatch.models.mismatch.stem_model import stem as stem_number
from stemwatch.models.mismatch.stem_model.stem import Stem
from stemwatch.models.mismatch.term import Coordinate, RecordingSummary, Term, Words
from stemwatch.models.mismatch.terms._common import (
    CALIBRATE_FROM_PERCENT,
    CALIBRATE_LATER,
    ReadingTerm,
    about_value,
    either_sign,
    number,
    size,
)
from stemwatch.models.recording import Floats

MATERIAL_PERCENT = 0.4  # of travel; positioners are set to within a quarter of a percent or so


class ZeroShift(ReadingTerm):
    """A wrong zero of the reading: one coordinate in percent."""

    slug = "zero_shift"
    order = 80
    words = Words(
        of_record=True,
        plain="the position reading is off by a constant, or the bench set of the spring is",
        decide=(
            "Read MV with the valve on its seat or a mechanical stop: an error of the reading "
            "shows there, a bias of the force (spring, preload, flow, unequal friction) does "
            "not. A second process pressure shows a flow force."
        ),
        advice=FieldAdvice(
            title="position zero is off",
            steps=check_steps(
                (
                    "look: Compare the travel scale on the yoke with MV; check that the flow "
                    "goes through the body the way the arrow says."
                ),
                (
                    "air: With the valve on its seat, calibrate the zero of transmitter and "
                    "positioner."
                ),
                "air: Where both are right: check bench set, spring and stem coupling.",
            ),
            parts=(
                "none; a calibrator",
                "actuator spring, where the bench set cannot be reached",
            ),
            **TRANSMITTER_SETTING,
        ),
        no_work=CALIBRATE_LATER,
    )

    def coordinates(self, summary: RecordingSummary) -> tuple[Coordinate, ...]:
        """How far the reading lies above the stem, percent of travel, either sign."""
        return (Coordinate(name="zero_percent", low=-25.0, high=25.0),)

    def starts(self, summary: RecordingSummary) -> Floats:
        """From 0.5 to 5 % of travel, either way."""
        return either_sign(0.5, 1.5, 5.0)

    def fill(self, stem: Stem, values: Floats) -> None:
        """The shift onto the reading's zero."""
        stem.numbers[stem_number.ZERO] += values[0]

    def material(self, values: Floats, summary: RecordingSummary) -> bool:
        """More than a careful calibration leaves."""
        return bool(abs(values[0]) >= MATERIAL_PERCENT)

    def inherent(self, values: Floats, summary: RecordingSummary) -> bool:
        """Less than a stroke check finds fault with."""
        return bool(abs(values[0]) < CALIBRATE_FROM_PERCENT)

    def parameters(self, values: Floats) -> Mapping[str, tuple[float, str]]:
        """The shift at mid-travel, positive where the reading is high."""
        return {"zero": (float(values[0]), "%")}

    def sentence(self, parameters: Mapping[str, Estimate], rising: str, falling: str) -> str:
        direction = "low" if number(parameters["zero"]) < 0.0 else "high"
        return (
            f"The position reads {direction} by {size(parameters['zero'])} of travel at "
            "mid-travel: its zero is off, or the bench set of the spring is."
        )

    def field_test(self, parameters: Mapping[str, Estimate]) -> FieldTest:
        return FieldTest(
            do="Loop in manual: go to 50 % on the scale at the stem, and read the position.",
            fails=f"it reads about {about_value(size(parameters['zero']))} off",
            passes=f"within {MATERIAL_PERCENT} %",
        )


TERM: Term = ZeroShift()
