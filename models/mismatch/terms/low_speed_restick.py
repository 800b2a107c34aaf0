"""Low-speed re-stick: a stem slower than ``v_c`` sticks again. Neutral: ``v_c = 0``.

``v_c`` in %/s is the speed below which friction climbs back to its static level (Stribeck);
infinity is He's model (2007, doi:10.1021/ie061219a), in which the stem sticks at every sample.

Signature: a staircase on slow ramps, where the canonical element slides smoothly.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.field_advice import STICKING_PACKING, FieldAdvice, FieldTest, check_steps
from stemwatch.models.mismatch.stem_model import stem as stem_number
from stemwatch.models.mismatch.stem_model.stem import Stem
from stemwatch.models.mismatch.term import Coordinate, RecordingSummary, Term, Words
from stemwatch.models.mismatch.terms._common import StemTerm, about_value
from stemwatch.models.recording import Floats

# Every stem sticks again on ramps slower than its packing's Stribeck speed, up to 0.1 %/s or so,
# and scatter of the breakaways makes that seem more. Of 13 windows and recordings of development on
# which it was named in error none has more than 0.23; of 31 on which it was hidden and named none
# less than 0.36 (seeds 2062, 2114, 4060, 4062, 4063, 4064 and 4066).
MATERIAL_PERCENT_PER_S = 0.3
# Where sliding friction is the smaller one, which is what J is, it climbs back to its level on slow
# moves. Up to this speed published friction of packings does: its Stribeck speed is 0.01 inch/s,
# 0.25 to 1 %/s of a stroke of 4 to 1 inches (Kayihan and Doyle 2000, *memory*).
AS_BUILT_PERCENT_PER_S = 1.0


class LowSpeedRestick(StemTerm):
    """A stem that sticks again when slow: one coordinate, the speed ``v_c`` in %/s."""

    slug = "low_speed_restick"
    order = 30
    in_base = True
    words = Words(
        plain="on a slow command the stem does not slide, it moves in small steps",
        decide=(
            "Ramp OP at 0.02 %/s and at 0.5 %/s in manual: steps on the slow ramp and a smooth "
            "slide on the fast one are re-sticking; steps of one size on both are coarse "
            "commands or recording."
        ),
        advice=FieldAdvice(
            title="steps on a slow command",
            steps=check_steps(
                (
                    "manual: Ramp OP at 0.02 %/s and at 0.5 %/s: steps on the slow ramp and a "
                    "smooth slide on the fast one confirm it."
                ),
                "manual: Check gland torque and lubrication. Graphite steps where PTFE slides.",
                "air: Check the actuator's size against the friction; look at piston seals.",
                "line: Renew the packing; look at the stem's finish and the guide bushing.",
            ),
            parts=(
                "packing set of another material",
                "lubricant that suits the packing",
                "guide bushing",
                "piston seals",
            ),
            **STICKING_PACKING,
        ),
        no_work=(
            f"no quicker than {AS_BUILT_PERCENT_PER_S:g} %/s, as any packing does that sticks more "
            "at rest than in motion: no work of its own, S and J decide"
        ),
    )

    def coordinates(self, summary: RecordingSummary) -> tuple[Coordinate, ...]:
        """The speed, up to 2 %/s."""
        return (Coordinate(name="v_c_percent_per_s", low=0.0, high=2.0),)

    def starts(self, summary: RecordingSummary) -> Floats:
        """From the slowest ramps of a loop to fast ones; the loss is rough, so they are many."""
        return np.geomspace(0.015, 1.0, 8)[:, None]

    def fill(self, stem: Stem, values: Floats) -> None:
        """The speed of re-sticking; at 0 what the recording's resolution asks for stays."""
        if values[0] > 0.0:
            stem.numbers[stem_number.RESTICK] = values[0]

    def material(self, values: Floats, summary: RecordingSummary) -> bool:
        """It stops on ramps that loops really make."""
        return bool(values[0] >= MATERIAL_PERCENT_PER_S)

    def inherent(self, values: Floats, summary: RecordingSummary) -> bool:
        """As packings do whose friction is larger at rest; S and J decide whether that needs
        work.
        """
        return bool(values[0] <= AS_BUILT_PERCENT_PER_S * summary.unit_s)

    def parameters(self, values: Floats) -> Mapping[str, tuple[float, str]]:
        """v_c, the speed in percent of travel a second below which the stem sticks again."""
        return {"v_c": (float(values[0]), "%/s")}

    def sentence(self, parameters: Mapping[str, Estimate], rising: str, falling: str) -> str:
        return (
            f"Below {parameters['v_c']} the stem does not slide but sticks again and again: it "
            "follows a slow command in small steps."
        )

    def field_test(self, parameters: Mapping[str, Estimate]) -> FieldTest:
        half, double = about_value(parameters["v_c"], 0.5), about_value(parameters["v_c"], 2.0)
        return FieldTest(
            do=f"Loop in manual: ramp OP over 5 % at {half}, then at {double}, and watch the stem.",
            fails="steps on the slow ramp, a smooth slide on the quick one",
            passes="a smooth slide on both",
        )


TERM: Term = LowSpeedRestick()
