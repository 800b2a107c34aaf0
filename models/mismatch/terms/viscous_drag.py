"""Viscous drag: a moving stem covers ``1 - exp(-dt/tau_v)`` of its way. Neutral: ``tau_v = 0``.

``x += (1 - exp(-dt/tau_v)) (F - d fd)`` while it moves; physically ``tau_v`` is the viscous
coefficient over the spring rate. The stem goes on after the command has turned, until it stands.

Signature: it starts on time, whatever the ramp, and slides slowly.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.field_advice import FieldAdvice, FieldTest, check_steps
from stemwatch.models.mismatch.stem_model import stem as stem_number
from stemwatch.models.mismatch.term import Coordinate, RecordingSummary, Term, Words
from stemwatch.models.mismatch.terms._common import (
    LAG_AS_BUILT_S,
    LONGEST_LAG_S,
    MATERIAL_LAG_S,
    SLOW_AS_BUILT,
    OneNumberTerm,
    about_value,
    lags_from,
    longest,
)
from stemwatch.models.recording import Floats


class ViscousDrag(OneNumberTerm):
    """Drag on a moving stem: one coordinate, the time constant ``tau_v`` in seconds."""

    slug = "viscous_drag"
    fills = stem_number.DRAG_S
    order = 30
    words = Words(
        no_work=SLOW_AS_BUILT,
        plain="the stem starts on time but slides slowly, as through thick grease",
        decide=(
            "Ramp OP at two speeds: drag starts the motion at the same OP on both, a lag the "
            "later the faster the ramp. A gauge at the actuator shows it too: pressure that "
            "arrives at once while the stem is slow is drag."
        ),
        advice=FieldAdvice(
            title="stem slides slowly",
            steps=check_steps(
                (
                    "look: The air first: a gauge on the actuator that follows slowly means "
                    "air line, filter or booster."
                ),
                (
                    "look: Check that the vent of the spring chamber is open, and a damper or "
                    "snubber set as meant."
                ),
                (
                    "look: Look for old grease, deposits and cold on stem and bonnet; is the "
                    "tracing on?"
                ),
                (
                    "manual: Step OP by 5 % with a gauge on the actuator: pressure at once and "
                    "a slow stem is drag."
                ),
                "line: Clean stem and guides; renew packing and lubricant.",
            ),
            parts=(
                "lubricant that suits the packing",
                "packing set",
                "steam tracing",
                "vent plug of the spring chamber",
            ),
            damage="DOP",
            cause="5.2",
            part="stem",
        ),
    )

    def coordinates(self, summary: RecordingSummary) -> tuple[Coordinate, ...]:
        """The time constant, up to 15 s or ten samples."""
        return (Coordinate(name="tau_v_s", low=0.0, high=longest(summary, LONGEST_LAG_S)),)

    def starts(self, summary: RecordingSummary) -> Floats:
        """From half a second or half a sample upwards."""
        unit = max(summary.interval_s, 1.0)
        return lags_from(summary, np.array([[0.5], [1.0], [2.0], [3.5], [6.0]]) * unit)

    def material(self, values: Floats, summary: RecordingSummary) -> bool:
        """A slip that takes 0.2 s is not worth a work order."""
        return bool(values[0] >= max(MATERIAL_LAG_S, 0.7 * summary.interval_s))

    def inherent(self, values: Floats, summary: RecordingSummary) -> bool:
        """No slower than the largest valves are allowed to be."""
        return bool(values[0] * summary.unit_s <= LAG_AS_BUILT_S)

    def parameters(self, values: Floats) -> Mapping[str, tuple[float, str]]:
        """tau_v, viscous coefficient over spring rate: the time constant of a slip in seconds."""
        return {"tau_v": (float(values[0]), "s")}

    def sentence(self, parameters: Mapping[str, Estimate], rising: str, falling: str) -> str:
        return (
            "The stem starts on time but slides to its place with a time constant of "
            f"{parameters['tau_v']}, as through thick grease."
        )

    def field_test(self, parameters: Mapping[str, Estimate]) -> FieldTest:
        return FieldTest(
            do=(
                "Loop in manual: step OP by 10 %, and time the stem from its first movement to "
                "63 % of the "
                "step."
            ),
            fails=f"about {about_value(parameters['tau_v'])}",
            passes=f"within {LAG_AS_BUILT_S} s",
        )


TERM: Term = ViscousDrag()
