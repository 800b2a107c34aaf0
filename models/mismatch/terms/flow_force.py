"""Flow force: the fluid pushes on the plug, ``F -= U (4 x/100 (1 - x/100) - 1)``. Neutral: U = 0.

``U`` in percent of span is the rise of the force from either end of travel to its middle; the
shape is 0 in the middle, so that it is separate from a zero shift there.

Signature: an error that is curved over travel, the same in both directions.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.field_advice import FORCE_ON_ACTUATOR, FieldAdvice, FieldTest, check_steps
from stemwatch.models.mismatch.stem_model import stem as stem_number
from stemwatch.models.mismatch.stem_model.stem import Stem
from stemwatch.models.mismatch.term import Coordinate, RecordingSummary, Term, Words
from stemwatch.models.mismatch.terms._common import (
    CALIBRATE_FROM_PERCENT,
    StemTerm,
    about_value,
    either_sign,
    number,
    size,
)
from stemwatch.models.recording import Floats

# Change of the force over the travel seen, percent of span: what it moves the stem by counts as an
# error of the reading does.
MATERIAL_PERCENT = 0.3
# Flow pushes on every plug; by less than this, percent of span, it moves the stem no further than
# the errors of a reading that a stroke check lets pass.
WORK_FROM_PERCENT = CALIBRATE_FROM_PERCENT
# The force of a real plug is largest near mid-travel, not at it: it differs from this shape by a
# line and a bow. So much of either may be its own, in shares of U: the slope over the whole stroke,
# and the height of the bow. Of 14 simulated valves on which a line or a bow was named beside a
# force that is largest at 45 to 55 % of travel, the largest have 0.43 and 0.13 (`draw_effect`,
# `draw_hidden`, seeds 4060, 4068, 4071 and 2114, development).
OWN_SLOPE, OWN_BOW = 0.5, 1.0 / 6.0


def _shape(x: Floats) -> Floats:
    """(n,) the force over travel, in units of U."""
    return 4.0 * x / 100.0 * (1.0 - x / 100.0) - 1.0


_TABLE = _shape(stem_number.places())


class FlowForce(StemTerm):
    """The fluid's force on the plug: one coordinate, ``U`` in percent of span."""

    slug = "flow_force"
    order = 10
    alike: tuple[str, ...] = ("bowed_linkage",)
    words = Words(
        plain="the process fluid pushes on the plug, differently at different openings",
        decide=(
            "Stroke the valve without flow, or at a second pressure drop: a flow force goes or "
            "changes, an error of the reading stays. Over a small travel the two look alike."
        ),
        advice=FieldAdvice(
            title="flow pushes on the plug",
            steps=check_steps(
                "desk: Compare the pressure drop of today with the one on the data sheet.",
                "look: Check that the flow goes through the body the way the arrow says.",
                "manual: Compare positions at two pressure drops, or without flow.",
                (
                    "air: Check the bench set; see whether a stiffer spring or a larger "
                    "actuator is due."
                ),
                "line: Look at the balance seal of a balanced plug.",
            ),
            parts=(
                "balance seal",
                "spring or actuator of the next size",
                "positioner, where there is none",
            ),
            **FORCE_ON_ACTUATOR,
        ),
        no_work=(
            f"less than {WORK_FROM_PERCENT:g} % of span: flow pushes on every plug, and the "
            "controller makes up for that"
        ),
    )

    def coordinates(self, summary: RecordingSummary) -> tuple[Coordinate, ...]:
        """The force in the middle of travel against the ends."""
        return (Coordinate(name="U_percent", low=-12.0, high=12.0),)

    def starts(self, summary: RecordingSummary) -> Floats:
        """From 1 to 6 % of span, either way."""
        return either_sign(1.0, 3.0, 6.0)

    def fill(self, stem: Stem, values: Floats) -> None:
        """The shape onto the table of force."""
        if values[0] != 0.0:
            table = stem.force
            table += values[0] * _TABLE
            stem.numbers[stem_number.BY_PLACE] = 1.0

    def material(self, values: Floats, summary: RecordingSummary) -> bool:
        """The force changes by so much over the travel that was seen."""
        seen = _shape(np.linspace(summary.mv_low, summary.mv_high, 21))
        return bool(abs(values[0]) * (seen.max() - seen.min()) >= MATERIAL_PERCENT)

    def inherent(self, values: Floats, summary: RecordingSummary) -> bool:
        """So little that any plug has it."""
        return bool(abs(values[0]) < WORK_FROM_PERCENT)

    def parameters(self, values: Floats) -> Mapping[str, tuple[float, str]]:
        """The force, positive where the middle of travel is pushed down."""
        return {"U": (float(values[0]), "%")}

    def sentence(self, parameters: Mapping[str, Estimate], rising: str, falling: str) -> str:
        towards = rising if number(parameters["U"]) < 0.0 else falling
        return (
            "The process fluid pushes on the plug, differently at different openings: by "
            f"{size(parameters['U'])} of span more towards {towards} at mid-travel than at the "
            "ends."
        )

    def field_test(self, parameters: Mapping[str, Estimate]) -> FieldTest:
        return FieldTest(
            do=(
                "Loop in manual, flow through the valve: go to both ends of its usual travel and "
                "to the "
                "middle, each from below, and read OP less position."
            ),
            fails=f"in the middle {about_value(size(parameters['U']))} off the mean of the ends",
            passes=f"within {MATERIAL_PERCENT} %",
        )


TERM: Term = FlowForce()
