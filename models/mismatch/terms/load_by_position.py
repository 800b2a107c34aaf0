"""Load that depends on position: ``F -= a z + b z^2 + c z^3``, ``z = (x - 50)/50``. Neutral: all 0.

A force of any smooth shape, such as a weight on an arm, a spring or a cam, to which a drive of
finite gain gives way; constant beyond 0 and 100 %, and 0 at mid-travel, where it is a zero shift.
Its straight part is what a span error of the reading would be; beside this term the reading's
gain is 1.

Signature: the error depends on the position alone, whichever way the stem came.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.field_advice import FORCE_ON_ACTUATOR, FieldAdvice, FieldTest, check_steps
from stemwatch.models.mismatch.stem_model import stem as stem_number
from stemwatch.models.mismatch.stem_model.stem import Stem
from stemwatch.models.mismatch.term import Coordinate, RecordingSummary, Term, Words
from stemwatch.models.mismatch.terms._common import StemTerm, about_value, number, size
from stemwatch.models.recording import Floats
from stemwatch.models.stickslip.force_balance import MOST_LOAD

MATERIAL_PERCENT = 1.2  # change of the force over the travel seen
SAID_AT = np.array([25.0, 50.0, 75.0])  # percent of travel


def _powers(x: Floats) -> Floats:
    """(n, 3) the shapes at places ``x`` (n,), percent of travel."""
    z = np.clip(x / 50.0 - 1.0, -1.0, 1.0)
    return np.stack((z, z**2, z**3), axis=-1)


_TABLES = _powers(stem_number.places())


class LoadByPosition(StemTerm):
    """A smooth force over the travel, a cubic: three coefficients, percent of span."""

    slug = "load_by_position"
    order = 12
    contains: tuple[str, ...] = ("flow_force", "span_error")
    words = Words(
        plain="a load that depends on position pulls the moving part off its command",
        decide=(
            "Take the load off, or raise the gain of the position controller: what a load pulls "
            "goes or shrinks, an error of the reading stays."
        ),
        advice=FieldAdvice(
            title="load pulls moving part off",
            steps=check_steps(
                "desk: Compare the load with what drive and gain can hold: gain, size, gear.",
                "look: Look for a weight, an unbalanced arm or a spring that is not as meant.",
                "manual: Hold five places, coming from either side, and note OP and position.",
                "line: Balance the load, or add integral action to the position controller.",
            ),
            parts=("counterweight or balance spring", "drive of the next size"),
            **FORCE_ON_ACTUATOR,
        ),
    )

    def coordinates(self, summary: RecordingSummary) -> tuple[Coordinate, ...]:
        """The linear, quadratic and cubic coefficients: what each part adds at 100 % of travel."""
        return (
            Coordinate(name="straight_percent", low=-MOST_LOAD, high=MOST_LOAD),
            Coordinate(name="bent_percent", low=-MOST_LOAD, high=MOST_LOAD),
            Coordinate(name="twice_bent_percent", low=-MOST_LOAD, high=MOST_LOAD),
        )

    def starts(self, summary: RecordingSummary) -> Floats:
        """Linear and quadratic loads, either sign."""
        straight = np.array([[size, 0.0, 0.0] for size in (-12.0, -5.0, -2.0, 2.0, 5.0, 12.0)])
        bent = np.array([[0.0, size, 0.0] for size in (-8.0, -3.0, 3.0, 8.0)])
        return np.vstack((straight, bent))

    def fill(self, stem: Stem, values: Floats) -> None:
        """The shape onto the table of force."""
        if np.any(values != 0.0):
            table = stem.force
            table += _TABLES @ values
            stem.numbers[stem_number.BY_PLACE] = 1.0

    def material(self, values: Floats, summary: RecordingSummary) -> bool:
        """The force changes by more than a percent of span over the travel that was seen."""
        seen = _powers(np.linspace(summary.mv_low, summary.mv_high, 21)) @ values
        return bool(seen.max() - seen.min() >= MATERIAL_PERCENT)

    def inherent(self, values: Floats, summary: RecordingSummary) -> bool:
        """What hangs on a drive of finite gain pulls it off its command, however sound it is."""
        return True

    def parameters(self, values: Floats) -> Mapping[str, tuple[float, str]]:
        """How much more it pulls down at 75 % of travel than at 25 %, and at 50 % than halfway
        between these."""
        low, middle, high = _powers(SAID_AT) @ values
        return {
            "rise": (float(high - low), "%"),
            "bend": (float(middle - 0.5 * (low + high)), "%"),
        }

    def sentence(self, parameters: Mapping[str, Estimate], rising: str, falling: str) -> str:
        rise = parameters["rise"]
        towards = falling if number(rise) > 0.0 else rising
        return (
            "A load that depends on position pulls the moving part off its command: by "
            f"{size(rise)} of span more towards {towards} at 75 % of travel than at 25 %."
        )

    def field_test(self, parameters: Mapping[str, Estimate]) -> FieldTest:
        return FieldTest(
            do=(
                "Loop in manual: go to 25 % and to 75 % from below, and read OP less position at "
                "both."
            ),
            fails=f"the two differ by about {about_value(size(parameters['rise']))}",
            passes=f"within {MATERIAL_PERCENT} %",
        )


TERM: Term = LoadByPosition()
