"""Asymmetric lag: as ``actuator_lag``, with ``tau_up`` where ``u > p`` and ``tau_down`` where
``u < p``. Neutral: both 0; equal values are the actuator lag.

Signature: late breakaways and late arrivals in one direction only.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.field_advice import SLOW_POSITIONER, FieldAdvice, FieldTest, check_steps
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
    number,
)
from stemwatch.models.recording import Floats
from stemwatch.models.signals.first_order_lag import lag_by_direction
from stemwatch.models.stickslip.kernel import Marks

# Springs, seals and relays never fill and vent quite alike; below this ratio it is one lag.
MATERIAL_RATIO = 1.5
AT_ONCE_S = 0.1  # seconds; quicker than any recording shows


class AsymmetricLag(CommandTerm):
    """A lag that differs by direction: two coordinates, ``tau_up`` and ``tau_down`` in seconds."""

    slug = "asymmetric_lag"
    order = 20
    contains: tuple[str, ...] = ("actuator_lag",)
    words = Words(
        no_work=SLOW_AS_BUILT,
        plain="the actuator fills faster than it vents, or the other way round",
        decide=(
            "Step OP by 5 % and by 20 % in the slow direction: with a lag the speed grows with "
            "the step, with a speed limit it stays the same."
        ),
        advice=FieldAdvice(
            title="slow one way (lag)",
            steps=check_steps(
                (
                    "look: Where the slow side vents: exhaust port and silencer, ice, paint, "
                    "insects. Where it fills: supply pressure during the move."
                ),
                (
                    "look: The actuator's action, air to open or to close, tells whether that side "
                    "vents or fills."
                ),
                "manual: Step OP by 5 % and by 20 % in the slow direction and time both.",
                (
                    "air: Clean or exchange silencer, quick exhaust, restrictor or the "
                    "positioner's relay; look at the diaphragm."
                ),
            ),
            parts=(
                "quick exhaust valve or silencer",
                "positioner relay",
                "filter element",
                "diaphragm",
            ),
            **SLOW_POSITIONER,
        ),
    )

    def coordinates(self, summary: RecordingSummary) -> tuple[Coordinate, ...]:
        """The two time constants, up to 15 s or ten samples."""
        high = longest(summary, LONGEST_LAG_S)
        return (
            Coordinate(name="tau_up_s", low=0.0, high=high),
            Coordinate(name="tau_down_s", low=0.0, high=high),
        )

    def starts(self, summary: RecordingSummary) -> Floats:
        """Six sizes, each way, with the other way at a quarter of it."""
        unit = max(summary.interval_s, 1.0)
        slow = lags_from(summary, unit * np.array([1.3, 2.0, 3.0, 4.2, 6.0, 9.0]))
        rising = np.stack([slow, 0.27 * slow], axis=1)
        return np.concatenate([rising, rising[:, ::-1]])

    def shape(
        self, command: Floats, marks: Marks, interval_s: float, values: Floats, out: Floats
    ) -> None:
        """The command through a first-order lag with a time constant for each direction."""
        lag_by_direction(command, marks, interval_s, float(values[0]), float(values[1]), out)

    def material(self, values: Floats, summary: RecordingSummary) -> bool:
        """The slower side counts, and only where it is clearly the slower one."""
        fast, slow = sorted((float(values[0]), float(values[1])))
        return (
            slow >= max(MATERIAL_LAG_S, 0.7 * summary.interval_s) and slow >= MATERIAL_RATIO * fast
        )

    def inherent(self, values: Floats, summary: RecordingSummary) -> bool:
        """No slower than the largest valves are allowed to be."""
        return bool(np.max(values) * summary.unit_s <= LAG_AS_BUILT_S)

    def parameters(self, values: Floats) -> Mapping[str, tuple[float, str]]:
        """The time constants of the position."""
        return {"tau_rising": (float(values[0]), "s"), "tau_falling": (float(values[1]), "s")}

    def sentence(self, parameters: Mapping[str, Estimate], rising: str, falling: str) -> str:
        up, down = parameters["tau_rising"], parameters["tau_falling"]
        if number(up) > number(down):
            slow, fast, slowly, quickly = up, down, rising, falling
        else:
            slow, fast, slowly, quickly = down, up, falling, rising
        other = f"by only {fast} when {quickly}"
        if number(fast) < AT_ONCE_S:
            other = f"follows at once when {quickly}"
        return f"The actuator lags by {slow} when {slowly} but {other}: {self.words.plain}."

    def field_test(self, parameters: Mapping[str, Estimate]) -> FieldTest:
        up, down = about_value(parameters["tau_rising"]), about_value(parameters["tau_falling"])
        return FieldTest(
            do=(
                "Loop in manual: step OP by 10 % up, then down, and time the stem to 63 % of "
                "each step."
            ),
            fails=f"about {up} rising and {down} falling",
            passes=f"both within {LAG_AS_BUILT_S} s, or alike to within {MATERIAL_RATIO} times",
        )


TERM: Term = AsymmetricLag()
