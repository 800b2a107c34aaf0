"""Actuator lag: ``p += (1 - exp(-dt/tau)) (u - p)``, before the stem. Neutral: ``tau = 0``.

Signature: the stem breaks away late and arrives late after every move, by an amount that grows
with the command's speed and dies out once the command rests.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.field_advice import FieldAdvice, FieldTest, check_steps
from stemwatch.models.mismatch.term import Coordinate, RecordingSummary, Term, Words
from stemwatch.models.mismatch.terms._common import (
    LAG_AS_BUILT_S,
    LONGEST_LAG_S,
    MATERIAL_LAG_S,
    SLOW_AS_BUILT,
    CommandTerm,
    about_value,
    lags_from,
    longest,
)
from stemwatch.models.recording import Floats
from stemwatch.models.signals.first_order_lag import lag_by_direction
from stemwatch.models.stickslip.kernel import Marks


class ActuatorLag(CommandTerm):
    """A first-order lag before the stem: one coordinate, the time constant ``tau`` in seconds."""

    slug = "actuator_lag"
    order = 20
    words = Words(
        no_work=SLOW_AS_BUILT,
        plain="the actuator or its I/P converter takes time to fill or vent",
        decide=(
            "Step OP by 2 % and by 10 %, then ramp it at two speeds: a lag delays the start of "
            "the motion the more, the faster the ramp; grease on the stem (drag) does not delay "
            "it; a dead time delays it by the same time always."
        ),
        advice=FieldAdvice(
            title="actuator slow to fill or vent",
            steps=check_steps(
                "look: Read the supply pressure at the valve during a move; it should not fall.",
                "look: Listen and soap for leaks: tubing, fittings, diaphragm case, vent holes.",
                (
                    "manual: Step OP by 10 % and time output pressure and stem: is the air "
                    "late, or the stem?"
                ),
                (
                    "air: Clean or exchange nozzle and filter of the I/P converter; check bore "
                    "of the tubing, diaphragm, piston seals."
                ),
                "air: Where all is well: a booster, or a positioner with more air.",
            ),
            parts=(
                "I/P converter or its nozzle and filter",
                "filter element of the air regulator",
                "tubing and fittings",
                "volume booster",
                "diaphragm or piston seals",
            ),
            damage="DOP",
            cause="5.1",
            part="I/P converter",
        ),
    )

    def coordinates(self, summary: RecordingSummary) -> tuple[Coordinate, ...]:
        """The time constant, up to 15 s or ten samples."""
        return (Coordinate(name="tau_s", low=0.0, high=longest(summary, LONGEST_LAG_S)),)

    def starts(self, summary: RecordingSummary) -> Floats:
        """From half a second or half a sample upwards."""
        unit = max(summary.interval_s, 1.0)
        return lags_from(summary, np.array([[0.5], [1.0], [2.0], [4.0], [6.0]]) * unit)

    def shape(
        self, command: Floats, marks: Marks, interval_s: float, values: Floats, out: Floats
    ) -> None:
        """The command through a first-order lag: tau dx/dt = u - x."""
        tau_s = float(values[0])
        lag_by_direction(command, marks, interval_s, tau_s, tau_s, out)

    def material(self, values: Floats, summary: RecordingSummary) -> bool:
        """A slip that takes 0.2 s is not worth a work order."""
        return bool(values[0] >= max(MATERIAL_LAG_S, 0.7 * summary.interval_s))

    def inherent(self, values: Floats, summary: RecordingSummary) -> bool:
        """No slower than the largest valves are allowed to be."""
        return bool(values[0] * summary.unit_s <= LAG_AS_BUILT_S)

    def parameters(self, values: Floats) -> Mapping[str, tuple[float, str]]:
        """tau, the time constant in seconds."""
        return {"tau": (float(values[0]), "s")}

    def sentence(self, parameters: Mapping[str, Estimate], rising: str, falling: str) -> str:
        return (
            f"The actuator follows its command with a lag of {parameters['tau']} both ways: "
            f"{self.words.plain}."
        )

    def field_test(self, parameters: Mapping[str, Estimate]) -> FieldTest:
        tau = parameters["tau"]
        return FieldTest(
            do=(
                "Loop in manual: step OP by 10 % and by 20 %, and time the stem to 63 % of each "
                "step."
            ),
            fails=f"about {about_value(tau)} for either step",
            passes=f"within {LAG_AS_BUILT_S} s",
        )


TERM: Term = ActuatorLag()
