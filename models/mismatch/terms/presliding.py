"""Presliding: a stem gives way to each change of the force before it lets go. Neutral: ``c = 0``.

``x += c fs ln((1 - q0)/(1 - q1))``, where the force goes from the share ``q0`` of the breakaway
level ``fs`` to ``q1`` (``stem_model.presliding``): LuGre's friction below its level. ``c`` in
percent of travel for a percent of force; ``c fs`` is how far the packing bends until it lets go.

Signature: at rest the stem creeps towards its command, the more the nearer the force is to the
level and the more OP moves, noise included.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.field_advice import STICKING_PACKING, FieldAdvice, FieldTest, check_steps
from stemwatch.models.mismatch.stem_model import stem as stem_number
from stemwatch.models.mismatch.term import Coordinate, RecordingSummary, Term, Words
from stemwatch.models.mismatch.terms._common import OneNumberTerm
from stemwatch.models.recording import Floats

MOST = 0.3
# Less does not show: under an OP that moves by 0.2 % a sample at half of the level, a stem creeps
# by 0.4 % in ten minutes.
MATERIAL = 0.005


class Presliding(OneNumberTerm):
    """A packing that gives before it lets go: one coordinate, ``c``."""

    slug = "presliding"
    fills = stem_number.GIVES
    order = 41
    words = Words(
        plain="the packing gives a little before it lets go",
        decide=(
            "Hold OP in manual: a stem that gives way stands still as soon as OP does, and moves "
            "with each small step of OP; one that creeps moves on."
        ),
        advice=FieldAdvice(
            title="packing that gives",
            steps=check_steps(
                "desk: S and J alone decide whether the packing needs work.",
                "manual: Hold OP: the stem stands still as soon as OP does.",
                "line: Where S is too large: renew the packing.",
            ),
            parts=("packing set",),
            **STICKING_PACKING,
        ),
    )

    def coordinates(self, summary: RecordingSummary) -> tuple[Coordinate, ...]:
        """c, percent of travel for a percent of force."""
        return (Coordinate(name="c", low=0.0, high=MOST),)

    def starts(self, summary: RecordingSummary) -> Floats:
        """From stiff packings to soft ones."""
        return np.geomspace(0.004, 0.16, 6)[:, None]

    def material(self, values: Floats, summary: RecordingSummary) -> bool:
        """The stem moves visibly at rest."""
        return bool(values[0] >= MATERIAL)

    def inherent(self, values: Floats, summary: RecordingSummary) -> bool:
        """Always: so packings hold a stem. S and J alone decide whether it needs work."""
        return True

    def parameters(self, values: Floats) -> Mapping[str, tuple[float, str]]:
        """c, percent of travel for a percent of force."""
        return {"c": (float(values[0]), "%")}

    def sentence(self, parameters: Mapping[str, Estimate], rising: str, falling: str) -> str:
        return (
            "The packing gives before it lets go: at rest the stem follows OP by "
            f"{parameters['c']} of travel for each percent, and by more just before it lets go."
        )

    def field_test(self, parameters: Mapping[str, Estimate]) -> FieldTest:
        return FieldTest(
            do=(
                "Loop in manual: hold OP for two minutes, then step it by 0.5 % to and fro ten "
                "times."
            ),
            fails="the stem stands still while OP does, and creeps while OP steps",
            passes="the stem stands still both times",
        )


TERM: Term = Presliding()
