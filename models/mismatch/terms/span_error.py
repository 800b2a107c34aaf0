"""Span error: ``MV = gain (z - 50) + 50 + zero``, free in every hypothesis. Neutral: gain 1.

The coordinate is ``gain - 1``. For the element a gain is exactly the same as a flow force that is
linear in travel, or a wrong spring rate.

Signature: an error that is linear in travel, the same in both directions.
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
)
from stemwatch.models.recording import Floats

MATERIAL_PERCENT = 0.3  # of travel, at the end of the travel seen against its middle


# A quarter turn in degrees for 100 %; and by how much the best gain may be off that.
OF_DEGREES, NEAR_DEGREES = 0.9, 0.02


class SpanError(ReadingTerm):
    """A wrong span of the reading: one coordinate, its gain less 1."""

    slug = "span_error"
    order = 80
    contains: tuple[str, ...] = ("zero_shift",)
    words = Words(
        of_record=True,
        plain="the position reading is stretched or compressed over the stroke",
        decide=(
            "Stroke the valve without flow from stop to stop and compare MV with the travel "
            "scale: an error of the span shows there; a flow force goes without flow, and "
            "differs at a second pressure; a wrong spring shows on the pressure gauge."
        ),
        advice=FieldAdvice(
            title="position span is off",
            steps=check_steps(
                (
                    "desk: Check range and split-range settings of OP and MV in control system "
                    "and historian."
                ),
                "look: Compare the travel scale on the yoke with MV.",
                (
                    "air: Stroke from stop to stop, and calibrate zero and span of transmitter "
                    "and positioner; check arm length, pin hole and cam, and the rate of the "
                    "spring."
                ),
            ),
            parts=(
                "none; a calibrator",
                "feedback arm or cam, where it is the wrong one",
            ),
            **TRANSMITTER_SETTING,
        ),
        no_work=CALIBRATE_LATER,
    )

    def coordinates(self, summary: RecordingSummary) -> tuple[Coordinate, ...]:
        """The gain less 1."""
        return (Coordinate(name="gain_error", low=-0.4, high=0.4),)

    def starts(self, summary: RecordingSummary) -> Floats:
        """From 3 to 20 %, either way."""
        return either_sign(0.03, 0.08, 0.2)

    def fill(self, stem: Stem, values: Floats) -> None:
        """The error onto the reading's gain."""
        stem.numbers[stem_number.GAIN] += values[0]

    def material(self, values: Floats, summary: RecordingSummary) -> bool:
        """It moves the reading over half the travel seen."""
        return bool(abs(values[0]) * 0.5 * (summary.mv_high - summary.mv_low) >= MATERIAL_PERCENT)

    def inherent(self, values: Floats, summary: RecordingSummary) -> bool:
        """At the ends of the stroke less than a stroke check finds fault with."""
        return bool(abs(values[0]) * 50.0 < CALIBRATE_FROM_PERCENT)

    def parameters(self, values: Floats) -> Mapping[str, tuple[float, str]]:
        """Percent of reading per percent of travel."""
        return {"gain": (1.0 + float(values[0]), "")}

    def sentence(self, parameters: Mapping[str, Estimate], rising: str, falling: str) -> str:
        change = "compressed" if number(parameters["gain"]) < 1.0 else "stretched"
        return (
            f"The position reading is {change} over the stroke: it moves by {parameters['gain']} % "
            f"for each percent of travel.{_perhaps_degrees(parameters['gain'])}"
        )

    def field_test(self, parameters: Mapping[str, Estimate]) -> FieldTest:
        return FieldTest(
            do=(
                "Loop in manual: go to 20 % and to 80 % on the scale at the stem, and take the "
                "difference "
                "of the two readings."
            ),
            fails=f"about {about_value(parameters['gain'], 60.0)} %",
            passes=f"60 %, to within {MATERIAL_PERCENT} %",
        )


def _perhaps_degrees(gain: Estimate) -> str:
    """A sentence, with a leading blank, where the gain is that of a quarter turn in degrees."""
    if not abs(number(gain) - OF_DEGREES) <= NEAR_DEGREES:
        return ""
    return (
        " So does a position in degrees, 0 to 90, that is taken as percent: see its unit before "
        "anything is calibrated, and if it is degrees, give low = 0, high = 90 in the plant file."
    )


TERM: Term = SpanError()
