"""Lost motion: play ``b`` between stem and position sensor. Neutral: ``b = 0``.

``z = min(max(z, x - b/2), x + b/2)``, after the stick-slip.

Signature: after a restart in the same direction the reading jumps by J, after a reversal by
``J - b``. Over full reversals alone it is exactly a smaller J, and where ``b >= J`` a wider S.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.field_advice import FieldAdvice, FieldTest, check_steps
from stemwatch.models.mismatch.stem_model import stem as stem_number
from stemwatch.models.mismatch.term import Coordinate, RecordingSummary, Term, Words
from stemwatch.models.mismatch.terms._common import OneNumberTerm, about_value
from stemwatch.models.recording import Floats

MATERIAL_PERCENT = 0.3  # of travel; good linkages have a tenth


class LostMotion(OneNumberTerm):
    """Play between stem and position sensor: one coordinate, its width ``b`` in percent."""

    slug = "lost_motion"
    fills = stem_number.PLAY
    order = 60
    words = Words(
        plain="there is play between the stem and its position sensor",
        decide=(
            "Step OP upwards in a staircase with holds, then downwards, with a dial gauge on "
            "the stem: with play the reading loses some motion after each reversal only, with a "
            "smaller J it loses none on the gauge."
        ),
        advice=FieldAdvice(
            title="play in the linkage",
            steps=check_steps(
                "look: Watch stem and feedback arm at a reversal: does the arm start later?",
                (
                    "manual: Move the feedback arm by hand and feel for play: pin and slot, "
                    "clamp, cam and follower, the spring that takes up backlash, the "
                    "transmitter's shaft or magnet."
                ),
                (
                    "manual: Step OP up in a staircase with holds, then down, with a dial gauge "
                    "on the stem."
                ),
                (
                    "air: Renew pins and bushings, tighten the clamp; calibrate zero and span "
                    "afterwards."
                ),
            ),
            parts=(
                "pins and bushings of the feedback linkage",
                "take-off arm",
                "coupling clamp",
                "spring that takes up backlash",
            ),
            damage="AIR",
            cause="1.5",
            part="linkage",
        ),
    )

    def coordinates(self, summary: RecordingSummary) -> tuple[Coordinate, ...]:
        """b, the play in percent of travel, 0 for none."""
        return (Coordinate(name="b_percent", low=0.0, high=8.0),)

    def starts(self, summary: RecordingSummary) -> Floats:
        """From 0.4 to 4 % of travel."""
        return np.array([[0.4], [0.8], [1.3], [1.8], [2.4], [3.2], [4.5]])

    def material(self, values: Floats, summary: RecordingSummary) -> bool:
        """More than a good linkage has."""
        return bool(values[0] >= MATERIAL_PERCENT)

    def parameters(self, values: Floats) -> Mapping[str, tuple[float, str]]:
        """b, the play in percent of travel."""
        return {"b": (float(values[0]), "%")}

    def sentence(self, parameters: Mapping[str, Estimate], rising: str, falling: str) -> str:
        return (
            f"Between the stem and its position reading there is a play of {parameters['b']} of "
            "travel, in the linkage or the feedback arm."
        )

    def field_test(self, parameters: Mapping[str, Estimate]) -> FieldTest:
        return FieldTest(
            do=(
                "Loop in manual, a dial gauge at the stem: step OP by 0.2 % one way until the "
                "stem moves, "
                "then back, and read how far the stem goes before the position reading follows."
            ),
            fails=f"about {about_value(parameters['b'])} of travel",
            passes=f"less than {MATERIAL_PERCENT} %",
        )


TERM: Term = LostMotion()
