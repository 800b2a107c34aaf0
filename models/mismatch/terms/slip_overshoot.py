"""A slip that overshoots: with little damping it goes past the place where friction balances the
force, and the stem rests there. Neutral: ``v = 0``.

A mass behind a spring that slips with a gap ``J`` between force and sliding friction comes to rest
after ``(1 + o) J``, ``o = exp(-pi zeta / sqrt(1 - zeta^2))`` with the damping ratio ``zeta``
(Coulomb friction moves the place about which it swings and takes nothing off it). A second swing
back would need twice the force that is left, so it stays. In a record the slip is over between two
samples: the stem sticks after each slip whatever the speed of its command, with the J and S of the
longer slip (J (1 + o) and S - o J). ``v`` in %/s is the speed up to which it does.

Signature: steps on every ramp, slow or quick. Low-speed re-stick, whose stem slides above some
speed, can be excluded only where quick moves show no slide.
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

AT_EVERY_SPEED = 4.0  # %/s; at a sample a second a stem moves by a slip and more at each sample
MATERIAL_PERCENT_PER_S = 2.0  # less is a low speed
AT_THE_END = 0.97 * AT_EVERY_SPEED  # within a fit's error of the end no value is known
NO_QUICKER_MOVE = "it sticks after each slip that the recording shows, on the quickest moves too"


class SlipOvershoot(StemTerm):
    """A stem that sticks after each slip: one coordinate, the speed ``v`` in %/s up to which."""

    slug = "slip_overshoot"
    order = 31
    in_base = True
    words = Words(
        plain="each slip goes past its end and the stem rests there, on quick moves too",
        decide=(
            "Ramp OP at 0.02 %/s and at 1 %/s in manual: steps on both ramps are slips that "
            "overshoot; a smooth slide on the quick one is re-sticking at low speed."
        ),
        advice=FieldAdvice(
            title="slips overshoot",
            steps=check_steps(
                (
                    "desk: Ask when the packing was last tightened or lubricated: S and J are "
                    "those of the longer slip, and friction itself is what needs work."
                ),
                "manual: Ramp OP at 0.02 %/s and at 1 %/s: steps on both confirm it.",
                "air: Check positioner gain and damping, and the actuator's size for its friction.",
                "line: Where S is too large: renew the packing, one of less static friction.",
            ),
            parts=(
                "packing set of less static friction",
                "positioner damping or restriction",
            ),
            **STICKING_PACKING,
        ),
    )

    def coordinates(self, summary: RecordingSummary) -> tuple[Coordinate, ...]:
        """The speed; the upper end is every speed that a record shows."""
        return (Coordinate(name="v_percent_per_s", low=0.0, high=AT_EVERY_SPEED),)

    def starts(self, summary: RecordingSummary) -> Floats:
        """From quick moves to every speed."""
        return np.array([[2.0], [3.0], [AT_EVERY_SPEED]])

    def fill(self, stem: Stem, values: Floats) -> None:
        """The speed of sticking again; at 0 what the recording's resolution asks for stays."""
        if values[0] > 0.0:
            stem.numbers[stem_number.RESTICK] = values[0]

    def material(self, values: Floats, summary: RecordingSummary) -> bool:
        """It sticks on quick moves too."""
        return bool(values[0] >= MATERIAL_PERCENT_PER_S)

    def inherent(self, values: Floats, summary: RecordingSummary) -> bool:
        """Always: a light moving part behind a stiff spring with little damping is how the valve is
        made. S and J alone decide whether it needs work.
        """
        return self.material(values, summary)

    def parameters(self, values: Floats) -> Mapping[str, tuple[float, str]]:
        """v_c, the speed in percent of travel a second up to which the stem sticks after a slip."""
        return {"v_c": (float(values[0]), "%/s")}

    def only_at_least(self, values: Floats) -> Mapping[str, str]:
        """The speed, where it is the largest that a record shows."""
        return {"v_c": NO_QUICKER_MOVE} if values[0] >= AT_THE_END else {}

    def sentence(self, parameters: Mapping[str, Estimate], rising: str, falling: str) -> str:
        speed = parameters["v_c"]
        moves = "the quickest moves" if speed.at_least is not None else f"moves of {speed}"
        return (
            f"Slips overshoot: the stem sticks again after each of them, on {moves} too, and "
            "follows in steps; S and J are those of the longer slip."
        )

    def field_test(self, parameters: Mapping[str, Estimate]) -> FieldTest:
        speed = parameters["v_c"]
        quick = about_value(speed, 0.25)
        if speed.at_least is not None:
            quick = f"{0.25 * speed.at_least:.1g} {speed.unit}"
        return FieldTest(
            do=(
                f"Loop in manual: ramp OP over 10 % at {quick}, and watch the stem or record it "
                "ten times a second."
            ),
            fails="it moves in steps, each as long as J",
            passes="a smooth slide",
        )


TERM: Term = SlipOvershoot()
