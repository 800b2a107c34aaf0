"""Dead time: the command arrives ``theta`` late. Neutral: ``theta = 0``.

``u_d[k] = (1 - f) u[k-n] + f u[k-n-1]`` with ``theta/dt = n + f``. It counts from the recorded OP
to the recorded MV, so that a skew between their clocks is part of it and cannot be told from it.

Signature: a pulse of the same length after every edge of the command.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.field_advice import FieldAdvice, FieldTest, check_steps
from stemwatch.models.mismatch.stem_model.delay import delayed
from stemwatch.models.mismatch.term import Coordinate, RecordingSummary, Term, Words
from stemwatch.models.mismatch.terms._common import CommandTerm, about_value, longest
from stemwatch.models.recording import Floats
from stemwatch.models.stickslip.kernel import Marks

# Less lies within a scan of controller and recorder, where it cannot be told from sampling.
MATERIAL = 0.8  # seconds, and samples
# Seconds that specifications allow the largest valves (EnTech 3.0, from memory).
AS_BUILT_S = 1.2
ABOUT_A_SAMPLE = 1.2  # own seconds, and samples
# A controller that reads the position before it sets OP, as most do, and an archive that stamps
# either tag a scan late make two samples; the air of a good valve takes 0.2 more.
ABOUT_TWO_SAMPLES = 2.2
AT_THE_END = 0.99  # of the longest delay that is tried
STARTS = (0.5, 1.0, 1.75, 2.5, 3.5, 4.5, 6.0, 8.0, 10.0, 12.5, 15.5, 19.0, 23.0)  # units
LONGEST_S = 12.0  # that is tried


def about_a_sample(theta: float, summary: RecordingSummary) -> bool:
    """True where the clocks of a sound loop may differ by a delay of ``theta``, and often do: it is
    none of the valve's effects."""
    return theta <= ABOUT_A_SAMPLE * max(1.0, summary.interval_s)


class DeadTime(CommandTerm):
    """A command that arrives late: one coordinate, the delay ``theta`` in seconds."""

    slug = "dead_time"
    order = 10
    words = Words(
        of_record=True,
        plain="the command reaches the valve late, or the clocks of OP and MV differ",
        decide=(
            "Look whether other valves from the same source show the same delay: then it is the "
            "clock. Else step OP and watch the stem or the actuator's pressure gauge at the "
            "valve itself: a real dead time is seen there, a clock skew is not."
        ),
        advice=FieldAdvice(
            title="answers late (delay)",
            steps=check_steps(
                (
                    "desk: Compare with other valves of the same source: the same delay "
                    "everywhere is the clock, not the valve."
                ),
                (
                    "desk: Look how OP and MV are scanned and time-stamped, and for a filter in "
                    "the output card."
                ),
                (
                    "look: With a radio: let the operator step OP and see at the stem whether "
                    "the delay is real."
                ),
                "manual: Read dead band and delay in the positioner's settings.",
                "air: Shorten or widen the signal tubing; put the I/P converter at the valve.",
            ),
            parts=(
                "none before it is clear that the delay is real",
                "signal tubing, positioner",
            ),
            damage="DOP",
            cause="3.1",
            part="positioner",
        ),
        no_work=(
            "so short that the clocks of OP and position, a sample apart each way, or the air of a "
            "large valve may make it: no work of its own"
        ),
    )

    def coordinates(self, summary: RecordingSummary) -> tuple[Coordinate, ...]:
        """The delay, up to 12 s or ten samples."""
        return (Coordinate(name="theta_s", low=0.0, high=longest(summary, LONGEST_S)),)

    def starts(self, summary: RecordingSummary) -> Floats:
        """Close enough together that an edge of a few seconds finds its place."""
        starts = np.array(STARTS) * max(summary.interval_s, 1.0)
        return starts[starts < longest(summary, LONGEST_S), None]

    def shape(
        self, command: Floats, marks: Marks, interval_s: float, values: Floats, out: Floats
    ) -> None:
        """The command ``theta_s`` later: u(t - theta)."""
        delayed(command, marks, float(values[0]) / interval_s, out)

    def material(self, values: Floats, summary: RecordingSummary) -> bool:
        """More than what scanning alone makes, and less than the longest that is tried: a delay at
        that end has no size, and stands for something else."""
        least = MATERIAL * max(1.0, summary.interval_s)
        return bool(least <= values[0] <= AT_THE_END * longest(summary, LONGEST_S))

    def inherent(self, values: Floats, summary: RecordingSummary) -> bool:
        """As long as tubing and air of a large valve take, or the clocks of a sound loop may
        differ.
        """
        theta = float(values[0])
        clocks = ABOUT_TWO_SAMPLES * max(1.0, summary.interval_s)
        return theta * summary.unit_s <= AS_BUILT_S or theta <= clocks

    def parameters(self, values: Floats) -> Mapping[str, tuple[float, str]]:
        """theta, the dead time in seconds."""
        return {"theta": (float(values[0]), "s")}

    def sentence(self, parameters: Mapping[str, Estimate], rising: str, falling: str) -> str:
        return (
            f"The valve answers {parameters['theta']} after its command, by the same delay every "
            "time: a delay on the way of the command, or clocks of OP and MV that differ."
        )

    def field_test(self, parameters: Mapping[str, Estimate]) -> FieldTest:
        return FieldTest(
            do=(
                "Loop in manual, a watch at the valve: let the operator step OP by 5 % on a "
                "count by "
                "radio, and time how long the stem stands still."
            ),
            fails=f"about {about_value(parameters['theta'])}",
            passes=(
                f"less than {AS_BUILT_S} s; the delay is then in how OP and MV are stamped, not in "
                "the "
                "valve"
            ),
        )


TERM: Term = DeadTime()
