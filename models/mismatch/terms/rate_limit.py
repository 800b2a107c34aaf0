"""Rate limit: ``dp = clip(u - p, -R dt, R dt)``, before the stem. Neutral: ``R = inf``.

The coordinate is the slowness ``1/R`` in seconds per percent, so that 0 is "no limit".

Signature: large fast commands are followed along a straight line; small slow ones are followed.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from stemwatch.models.compiled import compiled
from stemwatch.models.estimate import Estimate
from stemwatch.models.field_advice import WEAK_AIR, FieldAdvice, FieldTest, check_steps
from stemwatch.models.mismatch.term import Coordinate, RecordingSummary, Term, Words
from stemwatch.models.mismatch.terms._common import CommandTerm, about_value, inverse
from stemwatch.models.recording import Floats
from stemwatch.models.stickslip.kernel import Marks

SLOWEST = 8.0  # s per %: a full stroke in 13 minutes; more where samples are further apart
FREE = 100.0  # %/s: a full stroke in a second is as good as no limit
MATERIAL = 10.0  # %/s: a full stroke in 10 s is what valves of usual size do
STEP_PERCENT = 20.0  # of the test by hand
AS_BUILT = 2.5  # %/s: large actuators without a booster take up to 40 s for a full stroke


@compiled()
def limited(command: Floats, marks: Marks, dt: float, slowness: float, out: Floats) -> None:
    """``command`` (n,) at no more than ``1/slowness`` %/s into ``out`` (n,), percent.

    ``slowness`` in seconds per percent, 0 is no limit; at rest where marked START.
    """
    most_per_sample = dt / slowness if slowness > 0.0 else np.inf
    p = command[0]
    for k in range(command.size):
        if marks[k] == 1:
            p = command[k]
        else:
            error = command[k] - p
            p = (
                command[k]
                if abs(error) <= most_per_sample
                else p + (most_per_sample if error > 0.0 else -most_per_sample)
            )
        out[k] = p


class RateLimit(CommandTerm):
    """A speed limit of the actuator: one coordinate, the slowness ``1/R`` in s/%."""

    slug = "rate_limit"
    order = 30
    words = Words(
        plain="the valve has a top speed and follows large fast commands no faster",
        decide=(
            "Step OP by 5 % and by 20 %: a limit takes four times as long for the large step, a "
            "lag equally long. Repeat with the supply gauge in view: where the pressure falls, "
            "it is the supply."
        ),
        advice=FieldAdvice(
            title="top speed too low",
            steps=check_steps(
                (
                    "look: Look for a speed controller or restrictor left throttled, and for "
                    "kinked tubes."
                ),
                (
                    "look: Read the supply pressure during a large move: where it falls, it is "
                    "the supply."
                ),
                (
                    "manual: Step OP by 5 % and by 20 % and time both. With an electric "
                    "actuator: read its set speed."
                ),
                (
                    "air: Clean or exchange the filter; check bore of tubing and fittings, "
                    "positioner and booster."
                ),
            ),
            parts=(
                "filter element of the air regulator",
                "tubing and fittings",
                "volume booster",
                "speed controller",
            ),
            **WEAK_AIR,
        ),
    )

    def coordinates(self, summary: RecordingSummary) -> tuple[Coordinate, ...]:
        """Seconds for a percent of travel, the inverse of the speed: 0 for no limit."""
        high = SLOWEST * max(summary.interval_s, 1.0)
        return (Coordinate(name="slowness_s_per_percent", low=0.0, high=high),)

    def starts(self, summary: RecordingSummary) -> Floats:
        """Ten limits from 0.3 % in a second or sample to half the swing in one, all that shows."""
        unit = max(summary.interval_s, 1.0)
        fastest = min(max(summary.swing / (2.0 * summary.interval_s), 1.0 / unit), 8.0)
        return 1.0 / np.geomspace(0.3 / unit, fastest, 10)[:, None]

    def shape(
        self, command: Floats, marks: Marks, interval_s: float, values: Floats, out: Floats
    ) -> None:
        """The command, followed at no more than the speed limit."""
        limited(command, marks, interval_s, float(values[0]), out)

    def material(self, values: Floats, summary: RecordingSummary) -> bool:
        """Slow for a valve, and slow enough to take most of a sample over the swing of OP."""
        slowness = float(values[0])
        return slowness * MATERIAL >= 1.0 and slowness * summary.swing >= 0.7 * summary.interval_s

    def inherent(self, values: Floats, summary: RecordingSummary) -> bool:
        """As fast as large actuators without a booster are built."""
        return bool(values[0] * summary.unit_s * AS_BUILT <= 1.0)

    def parameters(self, values: Floats) -> Mapping[str, tuple[float, str]]:
        """The top speed; 100 %/s stands for no limit."""
        return {"rate": (1.0 / max(float(values[0]), 1.0 / FREE), "%/s")}

    def sentence(self, parameters: Mapping[str, Estimate], rising: str, falling: str) -> str:
        return (
            f"The valve moves at no more than {parameters['rate']}, {rising} and {falling} alike: "
            "large fast commands are followed at that speed and no faster."
        )

    def field_test(self, parameters: Mapping[str, Estimate]) -> FieldTest:
        took = about_value(inverse(parameters["rate"], STEP_PERCENT))
        return FieldTest(
            do=(
                f"Loop in manual: step OP by {STEP_PERCENT:g} % each way and time the stem to its "
                "place."
            ),
            fails=f"about {took}, and a quarter of that for a quarter of the step",
            passes=f"within {STEP_PERCENT / AS_BUILT:g} s",
        )


TERM: Term = RateLimit()
