"""Stem creep: a resting stem moves on, ``x += creep dt``. Neutral: ``creep = 0``.

``creep`` in %/s, positive upwards.

Signature: MV has a slope while the stem should rest, whichever way it moved before.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from stemwatch.models.estimate import Estimate
from stemwatch.models.field_advice import FieldAdvice, FieldTest, check_steps
from stemwatch.models.mismatch.stem_model import stem as stem_number
from stemwatch.models.mismatch.term import Coordinate, RecordingSummary, Term, Words
from stemwatch.models.mismatch.terms._common import (
    OneNumberTerm,
    about_value,
    either_sign,
    number,
    size,
)
from stemwatch.models.recording import Floats

MATERIAL_PERCENT_PER_S = 0.004  # 1 % of travel in four minutes: a loop has to work against it


class StemCreep(OneNumberTerm):
    """A stem that moves on at rest: one coordinate, its speed in %/s."""

    slug = "stem_creep"
    fills = stem_number.CREEP
    order = 40
    words = Words(
        plain="the stem creeps while it should rest",
        decide=(
            "Hold OP in manual for ten minutes and watch the stem itself with a dial gauge: a "
            "stem that moves creeps, one that stands while MV moves has a drifting transmitter."
        ),
        advice=FieldAdvice(
            title="stem creeps at rest",
            steps=check_steps(
                (
                    "look: Soap tubing, fittings and diaphragm case; listen at vents; look for "
                    "a handwheel or clamp that slips."
                ),
                (
                    "manual: Hold OP for ten minutes with a dial gauge on the stem: a stem that "
                    "stands while MV moves has a drifting transmitter instead."
                ),
                (
                    "air: Test diaphragm or piston seals, lock-up and solenoid valve; tighten "
                    "or renew."
                ),
            ),
            parts=(
                "tubing and fittings",
                "diaphragm or piston seals",
                "lock-up or solenoid valve",
            ),
            damage="SPO",
            cause="1.1",
            part="actuator",
        ),
    )

    def coordinates(self, summary: RecordingSummary) -> tuple[Coordinate, ...]:
        """The speed at rest."""
        return (Coordinate(name="creep_percent_per_s", low=-0.3, high=0.3),)

    def starts(self, summary: RecordingSummary) -> Floats:
        """From 0.5 to 6 % a minute, either way."""
        return either_sign(0.008, 0.025, 0.1)

    def material(self, values: Floats, summary: RecordingSummary) -> bool:
        """A percent of travel in four minutes."""
        return bool(abs(values[0]) >= MATERIAL_PERCENT_PER_S)

    def parameters(self, values: Floats) -> Mapping[str, tuple[float, str]]:
        """The speed, positive upwards."""
        return {"creep": (float(values[0]), "%/s")}

    def sentence(self, parameters: Mapping[str, Estimate], rising: str, falling: str) -> str:
        direction = falling if number(parameters["creep"]) < 0.0 else rising
        return (
            f"The stem creeps at {size(parameters['creep'])}, {direction}, while it should rest: "
            "an air leak, or packing that gives."
        )

    def field_test(self, parameters: Mapping[str, Estimate]) -> FieldTest:
        held_s = 240.0
        crept = about_value(size(replace(parameters["creep"], unit="%")), held_s)
        return FieldTest(
            do=(
                "Loop in manual: hold OP for four minutes, and read the stem at the beginning and "
                "at the end."
            ),
            fails=f"it creeps by about {crept}",
            passes=f"less than {held_s * MATERIAL_PERCENT_PER_S:.1g} %",
        )


TERM: Term = StemCreep()
