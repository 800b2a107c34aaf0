"""Spring with hysteresis: the spring or the diaphragm holds back each turn by up to ``H`` percent
of span, fully after a way of ``w`` percent of travel. Neutral: ``H = 0``.

The force is that of ``inner_friction``. The stem settles at its command less ``H h``, where ``h``
goes from -1 to 1 along the way since it turned.

Signature: after a turn the stem goes less far than its command, at first by a share and after the
way by ``2 H`` in all, however small its steps are. A packing loses S at once, play is lost in the
reading alone and at once, and a span error is the same whether the stem has turned or not.
"""

from __future__ import annotations

from collections.abc import Mapping

from stemwatch.models.estimate import Estimate
from stemwatch.models.field_advice import FORCE_ON_ACTUATOR, FieldAdvice, FieldTest, check_steps
from stemwatch.models.mismatch.stem_model import stem as stem_number
from stemwatch.models.mismatch.stem_model.stem import Stem
from stemwatch.models.mismatch.term import Coordinate, RecordingSummary, Term, Words
from stemwatch.models.mismatch.terms._common import StemTerm, about_value, grid
from stemwatch.models.recording import Floats

MATERIAL_PERCENT = 0.5  # of span, to either side
NARROWEST, WIDEST = 3.0, 20.0  # percent of travel: less is like sticking, more like a span error


class SpringHysteresis(StemTerm):
    """Inner friction of spring or diaphragm: two coordinates, its size and its way."""

    slug = "spring_hysteresis"
    order = 11
    words = Words(
        plain="the spring or diaphragm has friction of its own and holds back the stem at turns",
        decide=(
            "Step OP by 1 % with holds over 20 % of travel and back, and note each step of the "
            "stem. After the turn a packing takes S once, then every step is whole; here the "
            "steps begin short and grow over some percent of travel. With an error of the span "
            "all steps are short, with play the stem itself takes whole ones."
        ),
        advice=FieldAdvice(
            title="spring or diaphragm rubs",
            steps=check_steps(
                "desk: See when spring and diaphragm were renewed, and whether the air is cold.",
                (
                    "manual: Step OP by 1 % up over 20 % of travel and down again, with holds, "
                    "and note actuator pressure and travel: the pressures up and down part over "
                    "some percent of travel, not at once."
                ),
                (
                    "air: Take the actuator apart: broken, rusted or nested springs that touch "
                    "each other or their guide, a diaphragm that is stiff, folded or the wrong "
                    "one."
                ),
            ),
            parts=("actuator springs", "diaphragm", "spring guide"),
            otherwise=(
                "A positioner makes up for it where its feedback is at the stem: then look at the "
                "feedback spring inside of it.",
            ),
            **FORCE_ON_ACTUATOR,
        ),
    )

    def coordinates(self, summary: RecordingSummary) -> tuple[Coordinate, ...]:
        """H, percent of span, and the way w, percent of travel."""
        return (
            Coordinate(name="H_percent", low=0.0, high=5.0),
            Coordinate(name="way_percent", low=NARROWEST, high=WIDEST),
        )

    def starts(self, summary: RecordingSummary) -> Floats:
        """Weak and strong, over short and long ways."""
        return grid((0.8, 1.8), (5.0, 11.0))

    def fill(self, stem: Stem, values: Floats) -> None:
        """Size and way."""
        if values[0] > 0.0:
            stem.numbers[stem_number.HYSTERESIS] = values[0]
            stem.numbers[stem_number.WAY] = values[1]
            stem.numbers[stem_number.BY_PLACE] = 1.0

    def material(self, values: Floats, summary: RecordingSummary) -> bool:
        """More than a good spring and diaphragm have."""
        return bool(values[0] >= MATERIAL_PERCENT)

    def parameters(self, values: Floats) -> Mapping[str, tuple[float, str]]:
        """What is held back to either side, and the way."""
        return {"H": (float(values[0]), "%"), "way": (float(values[1]), "%")}

    def sentence(self, parameters: Mapping[str, Estimate], rising: str, falling: str) -> str:
        return (
            f"The spring or diaphragm holds the stem back after each turn, by up to "
            f"{parameters['H']} of span either way, reached over some {parameters['way']} of "
            "travel."
        )

    def field_test(self, parameters: Mapping[str, Estimate]) -> FieldTest:
        return FieldTest(
            do=(
                "Loop in manual: step OP by 1 % with holds over 20 % of travel up, then down, "
                "and read OP less position at one place in the middle of either."
            ),
            fails=(
                f"the two differ by S and {about_value(parameters['H'], 2.0)} more, and by less "
                "the sooner after the turn the place is passed"
            ),
            passes=f"they differ by S, within {2.0 * MATERIAL_PERCENT:g} %, wherever it is",
        )


TERM: Term = SpringHysteresis()
