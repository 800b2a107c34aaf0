"""Growing stiction: ``fs`` and ``fd`` times ``1 + g t/T``. Neutral: ``g = 0``.

``T`` is the length of the record, so that S and J are those at its beginning.

Signature: the loop of MV over OP gets wider with time, and its middle stays where it is.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.field_advice import STICKING_PACKING, FieldAdvice, FieldTest, check_steps
from stemwatch.models.mismatch.stem_model import stem as stem_number
from stemwatch.models.mismatch.term import Coordinate, RecordingSummary, Term, Words
from stemwatch.models.mismatch.terms._common import OneNumberTerm, about_value, number, size
from stemwatch.models.recording import Floats

MATERIAL_SHARE = 0.2  # over the record; less is what warm packing does in a shift
MATERIAL_PERCENT = 0.2  # of span: smaller growth is too small to matter


class GrowingStiction(OneNumberTerm):
    """Friction that grows over the record: one coordinate, the share ``g`` of growth."""

    slug = "growing_stiction"
    fills = stem_number.GROWTH
    order = 20
    words = Words(
        plain="the friction changed while it was recorded",
        decide=(
            "Fit S in windows of an hour or a day, and repeat a slow ramp at one place: growth "
            "shows at the same travel, friction of a place only there, a temperature effect "
            "goes back with the temperature."
        ),
        advice=FieldAdvice(
            title="friction changed in record",
            steps=check_steps(
                (
                    "desk: Ask what happened in that window: packing tightened, tracing off, "
                    "solids, a change of product or temperature."
                ),
                "look: Feel for the bonnet's temperature; look for product on the stem.",
                "manual: Repeat a slow ramp at one place an hour apart and compare.",
                "line: Where it stays: renew the packing; clean stem and guide of deposits.",
            ),
            parts=(
                "packing set",
                "steam tracing or purge",
                "stem and guide bushing",
            ),
            **STICKING_PACKING,
        ),
    )

    def coordinates(self, summary: RecordingSummary) -> tuple[Coordinate, ...]:
        """Growth over the record as a share; -0.5 is halved, 2 is tripled."""
        return (Coordinate(name="growth", low=-0.5, high=2.0),)

    def starts(self, summary: RecordingSummary) -> Floats:
        """S and J that shrink by 0.3 of their size, or grow by up to 1.5 of it."""
        return np.array([[-0.3], [0.3], [0.6], [1.0], [1.5]])

    def material(self, values: Floats, summary: RecordingSummary) -> bool:
        """A fifth of S, and a fifth of a percent of span."""
        growth = abs(float(values[0]))
        return growth >= MATERIAL_SHARE and growth * summary.S >= MATERIAL_PERCENT

    def parameters(self, values: Floats) -> Mapping[str, tuple[float, str]]:
        """Percent of growth over the record."""
        return {"growth": (100.0 * float(values[0]), "%")}

    def sentence(self, parameters: Mapping[str, Estimate], rising: str, falling: str) -> str:
        verb = "shrank" if number(parameters["growth"]) < 0.0 else "grew"
        return (
            f"The friction {verb} by {size(parameters['growth'])} over the record; S and J are "
            "those at its beginning."
        )

    def field_test(self, parameters: Mapping[str, Estimate]) -> FieldTest:
        return FieldTest(
            do=(
                "Loop in manual: count steps of OP of 0.2 % from one move of the stem to the "
                "move back, "
                "at the beginning and at the end of a time as long as this recording."
            ),
            fails=f"the count changes by about {about_value(size(parameters['growth']))}",
            passes=f"alike to within {100.0 * MATERIAL_SHARE:g} %",
        )


TERM: Term = GrowingStiction()
