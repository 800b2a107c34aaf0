"""Asymmetric slip: the jump is ``J (1 + a)`` rising and ``J (1 - a)`` falling. Neutral: ``a = 0``.

S is the same both ways: an asymmetry of S is exactly a bias of the force and cannot be told from
a zero shift. The friction levels are ``(S +- J (1 +- a))/2``.

Signature: slips of one direction are larger than those of the other.
"""

from __future__ import annotations

from collections.abc import Mapping

from stemwatch.models.estimate import Estimate
from stemwatch.models.field_advice import STICKING_PACKING, FieldAdvice, FieldTest, check_steps
from stemwatch.models.mismatch.stem_model import stem as stem_number
from stemwatch.models.mismatch.term import Coordinate, RecordingSummary, Term, Words
from stemwatch.models.mismatch.terms._common import OneNumberTerm, about_value, either_sign, number
from stemwatch.models.recording import Floats

# Jumps that differ by less than 1.5 to 1 lie within the scatter of a few dozen slips.
MATERIAL = 0.2
# Of travel, by which the breakaways of both ways differ: on a healthy valve an error of a tenth of
# a percent in zero or curve is a ratio too.
MATERIAL_PERCENT = 0.2
MOST = 0.95


class AsymmetricSlip(OneNumberTerm):
    """Slips that differ by direction: one coordinate, the share ``a`` by which J is uneven."""

    slug = "asymmetric_slip"
    fills = stem_number.ASYMMETRY
    order = 20
    contains: tuple[str, ...] = ("zero_shift",)
    words = Words(
        plain="the stem jumps further in one direction than in the other",
        decide=(
            "Ramp OP slowly up and down over the same 10 % and compare the sizes of ten slips "
            "each way: unequal jumps are this, equal jumps about a shifted middle are a zero "
            "shift."
        ),
        advice=FieldAdvice(
            title="jumps further one way",
            steps=check_steps(
                "look: Look at the stem from two sides: is it bent, or does it lean on its guide?",
                (
                    "manual: Ramp OP slowly up and down over the same 10 % and note ten jumps "
                    "each way."
                ),
                (
                    "air: Check bench set, spring and balance of the plug, and the piston seals "
                    "for lips that grip."
                ),
                (
                    "line: Open the packing box: rings the wrong way up, worn on one side; look "
                    "at stem and plug."
                ),
            ),
            parts=(
                "packing set",
                "stem and guide bushing",
                "piston seals",
                "actuator spring",
            ),
            **STICKING_PACKING,
        ),
    )

    def coordinates(self, summary: RecordingSummary) -> tuple[Coordinate, ...]:
        """The asymmetry, positive where rising jumps are the larger ones."""
        return (Coordinate(name="asymmetry", low=-MOST, high=MOST),)

    def starts(self, summary: RecordingSummary) -> Floats:
        """Ratios of the jumps of 1.7, 3.4 and 9, either way."""
        return either_sign(0.25, 0.55, 0.8)

    def material(self, values: Floats, summary: RecordingSummary) -> bool:
        """The larger jump is at least one and a half times the smaller, and the two ways differ by
        a size that matters.
        """
        apart_percent = abs(values[0]) * (summary.S + summary.J)
        return bool(abs(values[0]) >= MATERIAL and apart_percent >= MATERIAL_PERCENT)

    def parameters(self, values: Floats) -> Mapping[str, tuple[float, str]]:
        """Jump rising over jump falling."""
        a = min(max(float(values[0]), -MOST), MOST)
        return {"ratio": ((1.0 + a) / (1.0 - a), "")}

    def sentence(self, parameters: Mapping[str, Estimate], rising: str, falling: str) -> str:
        """With the ratio as a number above 1."""
        ratio, larger, smaller = parameters["ratio"], rising, falling
        if number(ratio) < 1.0:
            ratio, larger, smaller = _inverse(ratio), falling, rising
        return f"The jumps when {larger} are {ratio} times those when {smaller}."

    def field_test(self, parameters: Mapping[str, Estimate]) -> FieldTest:
        return FieldTest(
            do=(
                "Loop in manual: step OP by 0.2 % one way until the stem jumps, five times each "
                "way, "
                "and read each jump."
            ),
            fails=f"jumps rising about {about_value(parameters['ratio'])} times those falling",
            passes=f"alike to within {(1.0 + MATERIAL) / (1.0 - MATERIAL):.1f} times",
        )


def _inverse(ratio: Estimate) -> Estimate:
    """The ratio seen from the other side; an end at or below 0 has no other side."""
    value, low, high = (
        None if v is None or v <= 0.0 else 1.0 / v for v in (ratio.value, ratio.high, ratio.low)
    )
    return Estimate(value=value, low=low, high=high)


TERM: Term = AsymmetricSlip()
