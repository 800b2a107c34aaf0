"""A positioner that integrates: ``F = p + v - x``, ``dv/dt = (p - MV)/T_i`` where ``|p - MV| > b``.

Neutral: ``r = 1/T_i = 0``. Coordinates: ``r`` and the dead zone ``b``, percent of travel
(``stem_model.integral_action``).

Signature: a stem that rests beyond ``b`` lets go without a change of OP, and the error at which it
lets go falls with what errors have summed up before.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.field_advice import FieldAdvice, FieldTest, check_steps
from stemwatch.models.mismatch.stem_model import stem as stem_number
from stemwatch.models.mismatch.stem_model.stem import Stem
from stemwatch.models.mismatch.term import Coordinate, RecordingSummary, Term, Words
from stemwatch.models.mismatch.terms._common import StemTerm, about_value, grid
from stemwatch.models.recording import Floats

QUICKEST_S, SLOWEST_S = 4.0, 200.0
WIDEST_ZONE = 6.0  # percent of travel
PERIODS_S, ZONES = (12.0, 30.0, 75.0), (0.05, 0.6, 0.8, 0.95, 1.15)


class IntegratingPositioner(StemTerm):
    """A positioner with integral action: two coordinates, ``1/T_i`` and the dead zone."""

    slug = "integrating_positioner"
    order = 5
    words = Words(
        plain="the positioner integrates, and lets a resting stem go without a change of OP",
        decide=(
            "Hold OP in manual with the stem at rest: the output pressure of a positioner that "
            "integrates moves on until the stem lets go, that of another stands."
        ),
        advice=FieldAdvice(
            title="positioner integrates",
            steps=check_steps(
                (
                    "desk: S and J alone decide whether the packing needs work; positioners are "
                    "made so."
                ),
                "manual: Hold OP for ten minutes: does the stem go on moving to and fro?",
                (
                    "manual: If it does, widen the dead zone of the integral beyond "
                    "the dead band of the stem, or switch the integral off."
                ),
            ),
            parts=("positioner",),
            damage="FTR",
            cause="3.4",
            part="positioner",
        ),
    )

    def coordinates(self, summary: RecordingSummary) -> tuple[Coordinate, ...]:
        """1/T_i in 1/s and the dead zone, percent."""
        return (
            Coordinate(name="r_per_s", low=0.0, high=1.0 / QUICKEST_S),
            Coordinate(name="zone", low=0.0, high=WIDEST_ZONE),
        )

    def starts(self, summary: RecordingSummary) -> Floats:
        """From quick to slow, with zones from none to beyond the force at which the stem seems to
        let go, which the integral lowers."""
        level = min(0.5 * (summary.S + summary.J), WIDEST_ZONE / ZONES[-1])
        return grid(1.0 / np.array(PERIODS_S), level * np.array(ZONES))

    def fill(self, stem: Stem, values: Floats) -> None:
        """Rate and zone, as they are."""
        stem.numbers[stem_number.INTEGRATES] = values[0]
        stem.numbers[stem_number.ZONE] = values[1]

    def material(self, values: Floats, summary: RecordingSummary) -> bool:
        """Quick enough to show within a record."""
        return bool(values[0] >= 1.0 / SLOWEST_S)

    def inherent(self, values: Floats, summary: RecordingSummary) -> bool:
        """Always: so positioners are made."""
        return True

    def parameters(self, values: Floats) -> Mapping[str, tuple[float, str]]:
        """T_i in seconds and the dead zone, percent of travel."""
        return {
            "T_i": (1.0 / max(float(values[0]), 1e-9), "s"),
            "zone": (float(values[1]), "%"),
        }

    def sentence(self, parameters: Mapping[str, Estimate], rising: str, falling: str) -> str:
        return (
            f"The positioner integrates, with an integral time of {parameters['T_i']}, where the "
            f"position is further than {parameters['zone']} from its command."
        )

    def field_test(self, parameters: Mapping[str, Estimate]) -> FieldTest:
        return FieldTest(
            do="Loop in manual: hold OP, and watch the output pressure of the positioner.",
            fails=f"it moves on, with {about_value(parameters['T_i'])}",
            passes="it stands",
        )


TERM: Term = IntegratingPositioner()
