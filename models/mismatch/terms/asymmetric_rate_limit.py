"""Asymmetric rate limit: ``dp = clip(u - p, -R_down dt, R_up dt)``. Neutral: both ``inf``.

The coordinates are slownesses ``1/R`` in seconds per percent; equal values are the rate limit.

Signature: long straight returns after fast moves in one direction only; the other is followed.
S and J alone read the slow direction as a wide dead band.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from stemwatch.models.compiled import compiled
from stemwatch.models.estimate import Estimate
from stemwatch.models.field_advice import SLOW_POSITIONER, FieldAdvice, FieldTest, check_steps
from stemwatch.models.mismatch.term import Coordinate, RecordingSummary, Term, Words
from stemwatch.models.mismatch.terms._common import CommandTerm, about_value, inverse, number
from stemwatch.models.recording import Floats
from stemwatch.models.stickslip.kernel import Marks

SLOWEST = 8.0  # s per %, as for the rate limit
FREE = 100.0  # %/s, as for the rate limit
MATERIAL = 10.0  # %/s, as for the rate limit
STEP_PERCENT = 20.0  # of the test by hand
AS_BUILT = 2.5  # %/s, as for the rate limit
MATERIAL_RATIO = 1.5  # below, it is one limit


@compiled()
def limited_by_direction(
    command: Floats, marks: Marks, dt: float, up: float, down: float, out: Floats
) -> None:
    """``command`` (n,) at no more than its top speeds into ``out`` (n,), percent.

    ``up`` and ``down`` are slownesses in seconds per percent, 0 is no limit; at rest where marked
    START.
    """
    most_up = dt / up if up > 0.0 else np.inf
    most_down = dt / down if down > 0.0 else np.inf
    p = command[0]
    for k in range(command.size):
        error = command[k] - p
        if marks[k] == 1 or -most_down <= error <= most_up:
            p = command[k]
        else:
            p += most_up if error > 0.0 else -most_down
        out[k] = p


class AsymmetricRateLimit(CommandTerm):
    """A speed limit that differs by direction: two slownesses in seconds per percent."""

    slug = "asymmetric_rate_limit"
    order = 30
    contains: tuple[str, ...] = ("rate_limit",)
    words = Words(
        plain="the valve has a top speed in one direction and is faster in the other",
        decide=(
            "Step OP by 5 % and by 20 % in the slow direction: with a limit the speed stays the "
            "same, with a lag it grows with the step. On a record, plot that speed against the "
            "size of the error."
        ),
        advice=FieldAdvice(
            title="top speed too low one way",
            steps=check_steps(
                (
                    "look: Look for a blocked exhaust, a throttled speed controller, a kinked "
                    "tube on the slow side."
                ),
                (
                    "look: Air to open or air to close: that tells whether the slow side "
                    "vents or fills."
                ),
                "manual: Step OP by 5 % and by 20 % in the slow direction; read the supply gauge.",
                (
                    "air: Open or clean what is throttled; check volume tank, booster and its "
                    "bypass needle."
                ),
                "air: Where the spring alone drives the slow stroke: check the bench set.",
            ),
            parts=(
                "quick exhaust valve or silencer",
                "booster and its bypass needle",
                "speed controller",
                "filter element",
            ),
            **SLOW_POSITIONER,
        ),
    )

    def coordinates(self, summary: RecordingSummary) -> tuple[Coordinate, ...]:
        """Seconds for a percent of travel, rising and falling: 0 for no limit."""
        high = SLOWEST * max(summary.interval_s, 1.0)
        return (
            Coordinate(name="slowness_up_s_per_percent", low=0.0, high=high),
            Coordinate(name="slowness_down_s_per_percent", low=0.0, high=high),
        )

    def starts(self, summary: RecordingSummary) -> Floats:
        """Eight limits, each way, with the other way five times as fast: a descent from twice the
        limit does not find it.
        """
        unit = max(summary.interval_s, 1.0)
        fastest = min(max(summary.swing / (2.0 * summary.interval_s), 1.0 / unit), 6.0)
        slow = 1.0 / np.geomspace(0.35 / unit, fastest, 8)
        rising = np.stack([slow, 0.2 * slow], axis=1)
        return np.concatenate([rising, rising[:, ::-1]])

    def shape(
        self, command: Floats, marks: Marks, interval_s: float, values: Floats, out: Floats
    ) -> None:
        """The command, followed at no more than the speed limit of its direction."""
        limited_by_direction(command, marks, interval_s, float(values[0]), float(values[1]), out)

    def material(self, values: Floats, summary: RecordingSummary) -> bool:
        """The slower side counts as for the rate limit, where it is clearly the slower one."""
        fast, slow = sorted((float(values[0]), float(values[1])))
        matters = slow * MATERIAL >= 1.0 and slow * summary.swing >= 0.7 * summary.interval_s
        return matters and slow >= MATERIAL_RATIO * fast

    def inherent(self, values: Floats, summary: RecordingSummary) -> bool:
        """The slower way is as fast as large actuators without a booster are built."""
        return bool(np.max(values) * summary.unit_s * AS_BUILT <= 1.0)

    def parameters(self, values: Floats) -> Mapping[str, tuple[float, str]]:
        """The top speeds of the position; 100 %/s stands for no limit."""
        up, down = (1.0 / max(float(value), 1.0 / FREE) for value in values)
        return {"rate_rising": (up, "%/s"), "rate_falling": (down, "%/s")}

    def sentence(self, parameters: Mapping[str, Estimate], rising: str, falling: str) -> str:
        up, down = parameters["rate_rising"], parameters["rate_falling"]
        slow, slowly, fast, quickly = down, falling, up, rising
        if number(up) < number(down):
            slow, slowly, fast, quickly = up, rising, down, falling
        if number(fast) >= 0.99 * FREE:
            other = f"is free when {quickly}"
        else:
            other = f"reaches {fast} when {quickly}"
        return (
            f"The valve moves at no more than {slow} when {slowly} but {other}: check the "
            "exhaust restriction, the booster or the supply."
        )

    def field_test(self, parameters: Mapping[str, Estimate]) -> FieldTest:
        up, down = (
            "without such a limit"
            if number(parameters[name]) >= 0.99 * FREE
            else f"in about {about_value(inverse(parameters[name], STEP_PERCENT))}"
            for name in ("rate_rising", "rate_falling")
        )
        return FieldTest(
            do=(
                f"Loop in manual: step OP by {STEP_PERCENT:g} % each way and time the stem from "
                "where it begins to move, which leaves out a delay, to its place."
            ),
            fails=f"rising {up} and falling {down}",
            passes=(
                f"both within {STEP_PERCENT / AS_BUILT:g} s, or alike to within "
                f"{MATERIAL_RATIO} times"
            ),
        )


TERM: Term = AsymmetricRateLimit()
