"""Travel stop: ``x = min(max(x, low), high)``. Neutral: no stops.

The coordinates are how far each stop lies inside the stroke of 0 to 100 %, 0 being no stop: the
low stop stands at ``inside_low``, the high one at ``100 - inside_high`` percent.

Signature: at one end of the range MV is flat while OP goes on.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.field_advice import FORCE_ON_ACTUATOR, FieldAdvice, FieldTest, check_steps
from stemwatch.models.mismatch.stem_model import stem as stem_number
from stemwatch.models.mismatch.stem_model.stem import Stem
from stemwatch.models.mismatch.term import Coordinate, RecordingSummary, Term, Words
from stemwatch.models.mismatch.terms._common import StemTerm, about_value, number
from stemwatch.models.recording import Floats

MATERIAL_BEYOND = 0.5  # percent of travel by which OP goes beyond the stop
MATERIAL_INSIDE = 1.0  # percent; a stop at the very end of the stroke is the seat
SOME = 0.1  # percent; the nearest to an end at which a start puts a stop


class TravelStop(StemTerm):
    """Stops inside the stroke: two coordinates, how far inside each stands, percent."""

    slug = "travel_stop"
    order = 50
    words = Words(
        plain="the stem stands on a stop while the command goes on",
        decide=(
            "Drive the valve in manual slowly beyond the place and back: a stop stands at the "
            "same travel and ends when OP comes back, a tight spot is overcome with more OP; "
            "and look at the stem: if it goes on while MV stands, the transmitter is saturated."
        ),
        advice=FieldAdvice(
            title="stem stands on a stop",
            steps=check_steps(
                (
                    "desk: Look for travel limits and cut-off in the settings of positioner and "
                    "controller."
                ),
                "look: Look for a handwheel or a limit stop left on.",
                (
                    "look: Look at the stem itself: if it goes on while MV stands, the "
                    "transmitter is saturated."
                ),
                "manual: Drive the valve slowly beyond the place and back; read its air pressure.",
                "air: Check coupling, bench set and supply pressure for full stroke.",
                "line: Look for a foreign body or deposits on the seat.",
            ),
            parts=(
                "none before it is found",
                "seat and plug, where a foreign body has marked them",
            ),
            **FORCE_ON_ACTUATOR,
        ),
    )

    def coordinates(self, summary: RecordingSummary) -> tuple[Coordinate, ...]:
        """How far the stops lie inside the stroke, up to the far end of what OP asks for."""
        return (
            Coordinate(name="inside_low_percent", low=0.0, high=max(summary.op_high, 1.0)),
            Coordinate(name="inside_high_percent", low=0.0, high=max(100.0 - summary.op_low, 1.0)),
        )

    def starts(self, summary: RecordingSummary) -> Floats:
        """Where MV ended, and further inside the range of OP; one stop at a time."""
        inward = np.array([0.05, 0.15, 0.3]) * summary.swing
        most_low, most_high = (coordinate.high for coordinate in self.coordinates(summary))
        low = np.clip([summary.mv_low, *(summary.op_low + inward)], SOME, most_low)
        high = np.clip(
            [100.0 - summary.mv_high, *(100.0 - summary.op_high + inward)], SOME, most_high
        )
        none = np.zeros(low.size)
        return np.concatenate([np.stack([low, none], axis=1), np.stack([none, high], axis=1)])

    def fill(self, stem: Stem, values: Floats) -> None:
        """Put the stops where there are any, in percent of travel from 0."""
        if values[0] > 0.0:
            stem.numbers[stem_number.STOP_LOW] = values[0]
        if values[1] > 0.0:
            stem.numbers[stem_number.STOP_HIGH] = 100.0 - values[1]

    def material(self, values: Floats, summary: RecordingSummary) -> bool:
        """OP goes beyond the stop by more than friction explains, and the stop is not the end of
        the stroke.
        """
        friction_shortfall = 0.5 * (
            summary.S - summary.J
        )  # what friction alone keeps the stem short by
        low = values[0] - (summary.op_low + friction_shortfall)
        high = (summary.op_high - friction_shortfall) - (100.0 - values[1])
        return any(
            bool(op_end >= MATERIAL_BEYOND and stop >= MATERIAL_INSIDE)
            for op_end, stop in zip((low, high), values, strict=True)
        )

    def parameters(self, values: Floats) -> Mapping[str, tuple[float, str]]:
        """The places of the stops; 0 and 100 % are none."""
        return {
            "stop_low": (max(float(values[0]), 0.0), "%"),
            "stop_high": (100.0 - max(float(values[1]), 0.0), "%"),
        }

    def sentence(self, parameters: Mapping[str, Estimate], rising: str, falling: str) -> str:
        low, high = parameters["stop_low"], parameters["stop_high"]
        sentences = []
        if number(low) > SOME:
            sentences.append(f"does not fall below {low} of travel")
        if number(high) < 100.0 - SOME:
            sentences.append(f"does not rise above {high} of travel")
        places = (
            " and ".join(sentences) if sentences else f"stays between {low} and {high} of travel"
        )
        return f"The stem {places} while the command goes on."

    def field_test(self, parameters: Mapping[str, Estimate]) -> FieldTest:
        low, high = about_value(parameters["stop_low"]), about_value(parameters["stop_high"])
        return FieldTest(
            do="Where the process allows it, loop in manual: take OP to 0 % and to 100 %.",
            fails=f"the stem stays between {low} and {high}",
            passes=f"it reaches both ends to within {MATERIAL_INSIDE:g} %",
        )


TERM: Term = TravelStop()
