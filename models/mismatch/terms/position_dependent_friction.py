"""Friction that depends on place: a bump of friction in one band of travel. Neutral: ``A = 0``.

``fs`` and ``fd`` both gain ``A exp(-((x - c)/w)^2)``; ``A`` in percent of span, place ``c`` and
width ``w`` in percent of travel.

Signature: residual in one band of travel, in both directions, with opposite signs.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from stemwatch.models.compiled import compiled
from stemwatch.models.estimate import Estimate
from stemwatch.models.field_advice import FieldAdvice, FieldTest, check_steps
from stemwatch.models.mismatch.stem_model import stem as stem_number
from stemwatch.models.mismatch.stem_model.stem import Stem
from stemwatch.models.mismatch.term import Coordinate, RecordingSummary, Term, Words
from stemwatch.models.mismatch.terms._common import StemTerm, about_value, number
from stemwatch.models.recording import Floats

MATERIAL_PERCENT = 0.4  # of S/2; the tight spots that fitters find are half a percent and more
_PLACES = stem_number.places()


@compiled()
def add_bump(places: Floats, height: float, centre: float, width: float, table: Floats) -> None:
    """Add ``height exp(-((x - centre)/width)^2)`` over ``places`` (m,) to ``table`` (m,)."""
    for i in range(places.size):
        offset = (places[i] - centre) / width
        if abs(offset) < 6.0:
            table[i] += height * np.exp(-offset * offset)


class PositionDependentFriction(StemTerm):
    """A tight spot: three coordinates, height, place and width of it in percent."""

    slug = "position_dependent_friction"
    order = 20
    words = Words(
        plain="the stem drags in one part of its stroke",
        decide=(
            "Ramp OP slowly through the place twice, an hour apart: friction that returns at "
            "the same travel belongs to the place, friction that is higher everywhere the "
            "second time grows with time."
        ),
        advice=FieldAdvice(
            title="drags at one place",
            steps=check_steps(
                "look: Look at linkage and coupling at that opening: does something rub?",
                "manual: Ramp OP slowly through the place and back, twice, an hour apart.",
                "air: With the handwheel, or by hand, feel for the tight place.",
                "line: Look at stem, guide, plug and cage for scores, galling and deposits.",
            ),
            parts=(
                "stem and guide bushing",
                "packing set",
                "plug and cage",
            ),
            damage="FTR",
            cause="1.3",
            part="stem",
        ),
    )

    def coordinates(self, summary: RecordingSummary) -> tuple[Coordinate, ...]:
        """Height, place within the travel seen, and width."""
        return (
            Coordinate(name="height_percent", low=0.0, high=10.0),
            Coordinate(name="place_percent", low=summary.mv_low, high=summary.mv_high),
            Coordinate(name="width_percent", low=2.0, high=12.0),
        )

    def starts(self, summary: RecordingSummary) -> Floats:
        """Six places, a narrow and a wide bump each."""
        part = (np.arange(6) + 0.5) / 6.0
        places = summary.mv_low + part * (summary.mv_high - summary.mv_low)
        low, wide = np.full(6, 1.5), np.full(6, 3.0)
        return np.concatenate(
            [np.stack([low, places, wide], axis=1), np.stack([low, places, 2.3 * wide], axis=1)]
        )

    def fill(self, stem: Stem, values: Floats) -> None:
        """The bump onto the table of friction."""
        height, centre, width = float(values[0]), float(values[1]), float(values[2])
        if height != 0.0:
            add_bump(_PLACES, height, centre, width, stem.friction)
            stem.numbers[stem_number.BY_PLACE] = 1.0

    def material(self, values: Floats, summary: RecordingSummary) -> bool:
        """A bump of at least ``MATERIAL_PERCENT`` of span in S/2."""
        return bool(values[0] >= MATERIAL_PERCENT)

    def parameters(self, values: Floats) -> Mapping[str, tuple[float, str]]:
        """Height, place and width of the bump."""
        return {
            "A": (float(values[0]), "%"),
            "place": (float(values[1]), "%"),
            "width": (float(values[2]), "%"),
        }

    def sentence(self, parameters: Mapping[str, Estimate], rising: str, falling: str) -> str:
        """With the band in which the bump is over a third of its height."""
        centre, width = number(parameters["place"]), number(parameters["width"])
        return (
            f"Between {centre - width:.0f} and {centre + width:.0f} % of travel the stem drags: "
            f"friction is higher by {parameters['A']} of span at {parameters['place']} of travel."
        )

    def field_test(self, parameters: Mapping[str, Estimate]) -> FieldTest:
        centre, factor = parameters["place"], 2.0
        return FieldTest(
            do=(
                f"Loop in manual: at {about_value(centre)} of travel step OP by 0.2 % from one "
                "move of the stem "
                "to the move back, and count; the same well away from there."
            ),
            fails=f"about {about_value(parameters['A'], factor)} of OP more there",
            passes=f"no more than {factor * MATERIAL_PERCENT:g} % more",
        )


TERM: Term = PositionDependentFriction()
