"""Bowed linkage: ``MV = z + B s(z)``, ``s(z) = sqrt(27)/2 (w - w^3)``, ``w = (z - 50)/50``.
Neutral: B = 0.

The arm between stem and transmitter turns while the stem goes straight: set right at both ends and
in the middle, the reading is off between them, by ``B`` percent of span at most, above on one half
of the stroke and below on the other. For the element it is the same as a force that depends on
position, and is run as such (``stem.force``); beyond 0 and 100 % it is 0.

Over a part of the stroke the shape is nearly a straight line, and then the same as a span error:
the two are one class until the range moved is wide enough (``reading_rivals``).

Signature: an error that follows the travel, S-shaped, the same in both directions.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import sqrt

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.field_advice import TRANSMITTER_SETTING, FieldAdvice, FieldTest, check_steps
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

MATERIAL_PERCENT = 0.3  # of travel, over the travel seen
HIGHEST_AT = 50.0 * (1.0 - 1.0 / sqrt(3.0)), 50.0 * (1.0 + 1.0 / sqrt(3.0))  # percent of travel
TO_HEIGHT = 0.5 * sqrt(27.0)  # times w - w^3 is at most 1


def shape(z: Floats) -> Floats:
    """(n,) the bow at places ``z`` (n,), percent of travel: -1 to 1, 0 at both ends and in the
    middle."""
    w = np.clip(z / 50.0 - 1.0, -1.0, 1.0)
    return np.asarray(TO_HEIGHT * (w - w**3))


_TABLE = shape(stem_number.places())


class BowedLinkage(StemTerm):
    """A bent reading of the position: one coordinate, the height of the bow in percent of span."""

    slug = "bowed_linkage"
    order = 14
    alike: tuple[str, ...] = ("flow_force",)
    may_swing = False
    words = Words(
        of_record=True,
        plain="the position reading is bent over the stroke: right at its ends, off between them",
        decide=(
            "Stroke the valve in steps of 10 % from stop to stop and compare MV with the travel "
            "scale: a bow is right at both ends and in the middle and off between them, an error "
            "of the span grows towards an end; a flow force goes without flow."
        ),
        advice=FieldAdvice(
            title="position reading is bent",
            steps=check_steps(
                (
                    "desk: Check whether a characteristic or a linearisation is set for MV or OP "
                    "in positioner, control system or historian."
                ),
                "look: At mid-travel the feedback arm must stand at a right angle to the stem.",
                (
                    "air: Stroke in steps of 10 %; correct pin, arm length and lever range, or set "
                    "the linearisation of the positioner, and calibrate again."
                ),
            ),
            parts=(
                "none; a calibrator",
                "feedback arm, pin or roller, where it is bent or the wrong one",
            ),
            **TRANSMITTER_SETTING,
        ),
        no_work=CALIBRATE_LATER,
    )

    def coordinates(self, summary: RecordingSummary) -> tuple[Coordinate, ...]:
        """The height of the bow, positive where the upper half of the stroke reads too high."""
        return (Coordinate(name="bow_percent", low=-6.0, high=6.0),)

    def starts(self, summary: RecordingSummary) -> Floats:
        """From 0.7 to 2 % of span, either way."""
        return either_sign(0.7, 2.0)

    def fill(self, stem: Stem, values: Floats) -> None:
        """The shape onto the table of force: what pushes up reads high."""
        if values[0] != 0.0:
            table = stem.force
            table -= values[0] * _TABLE
            stem.numbers[stem_number.BY_PLACE] = 1.0

    def material(self, values: Floats, summary: RecordingSummary) -> bool:
        """It moves the reading somewhere in the travel seen."""
        seen = shape(np.linspace(summary.mv_low, summary.mv_high, 21))
        return bool(abs(values[0]) * np.abs(seen).max() >= MATERIAL_PERCENT)

    def inherent(self, values: Floats, summary: RecordingSummary) -> bool:
        """Less than a stroke check finds fault with."""
        return bool(abs(values[0]) < CALIBRATE_FROM_PERCENT)

    def parameters(self, values: Floats) -> Mapping[str, tuple[float, str]]:
        """The height, positive where the upper half of the stroke reads too high."""
        return {"bow": (float(values[0]), "%")}

    def sentence(self, parameters: Mapping[str, Estimate], rising: str, falling: str) -> str:
        above, below = HIGHEST_AT if number(parameters["bow"]) < 0.0 else HIGHEST_AT[::-1]
        return (
            "The position reading is bent over the stroke: right at both ends and in the middle, "
            f"{size(parameters['bow'])} of span too high at {above:.0f} % of travel and too low at "
            f"{below:.0f} %."
        )

    def field_test(self, parameters: Mapping[str, Estimate]) -> FieldTest:
        low, high = HIGHEST_AT
        return FieldTest(
            do=(
                f"Loop in manual: go to 0, {low:.0f}, 50, {high:.0f} and 100 % on the scale at the "
                "stem, each from below, and read MV less the scale."
            ),
            fails=(
                f"{about_value(size(parameters['bow']))} at {low:.0f} and {high:.0f} %, one way at "
                "the one and the other way at the other, and little at 0, 50 and 100 %"
            ),
            passes=f"within {MATERIAL_PERCENT} % at all five",
        )


TERM: Term = BowedLinkage()
