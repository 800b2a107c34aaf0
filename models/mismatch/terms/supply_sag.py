"""Supply sag: ``air += m max(dp, 0) - dt air / T``; the actuator sees ``p - air``. Neutral: m = 0.

A negative ``m`` is an actuator that uses air to fall (air to close): the air is then used by
falling moves, and the actuator sees ``p + air``.

Signature: a shortfall on large moves in the direction that uses air, which recovers with ``T``.
"""

from __future__ import annotations

from collections.abc import Mapping

from stemwatch.models.compiled import compiled
from stemwatch.models.estimate import Estimate
from stemwatch.models.field_advice import WEAK_AIR, FieldAdvice, FieldTest, check_steps
from stemwatch.models.mismatch.term import Coordinate, RecordingSummary, Term, Words
from stemwatch.models.mismatch.terms._common import CommandTerm, about_value, grid, number, size
from stemwatch.models.recording import Floats
from stemwatch.models.stickslip.kernel import Marks

# A stem that stops 1 % of travel short on the largest move, for a while, disturbs a loop.
MATERIAL_PERCENT = 1.0


@compiled()
def sagged(
    command: Floats, marks: Marks, dt: float, share: float, recovery_s: float, out: Floats
) -> None:
    """``command`` (n,) less what the supply lacks into ``out`` (n,), percent.

    ``share`` of a move that is missing, negative where falling uses the air; ``recovery_s`` in
    seconds; the supply is full where marked START.
    """
    if share == 0.0 or recovery_s <= 0.0:
        for k in range(command.size):
            out[k] = command[k]
        return
    side = 1.0 if share > 0.0 else -1.0
    kept_share = max(1.0 - dt / recovery_s, 0.0)
    air, before = 0.0, command[0]
    for k in range(command.size):
        if marks[k] == 1:
            air, before = 0.0, command[k]
        air = kept_share * air + abs(share) * max(side * (command[k] - before), 0.0)
        before = command[k]
        out[k] = command[k] - side * air


class SupplySag(CommandTerm):
    """A weak air supply: two coordinates, the share that is missing and its recovery in seconds."""

    slug = "supply_sag"
    order = 40
    words = Words(
        plain="the air supply cannot keep up with large moves and recovers later",
        decide=(
            "Look whether valves on the same header fall short at the same time, and record the "
            "supply pressure during a full stroke: sag follows the pressure, a speed limit and "
            "a travel stop do not."
        ),
        advice=FieldAdvice(
            title="air supply sags",
            steps=check_steps(
                "desk: Look whether valves on the same header fall short at the same time.",
                (
                    "look: Watch the supply gauge during a large move; check that isolating "
                    "valves are fully open; drain the filter."
                ),
                "manual: Record supply pressure during a full stroke.",
                (
                    "air: Exchange filter element or regulator, whose pressure must not droop; "
                    "check bore and length of the supply line; add a volume tank."
                ),
            ),
            parts=(
                "filter element",
                "filter regulator",
                "volume tank",
                "supply tubing of a larger bore",
            ),
            **WEAK_AIR,
        ),
    )

    def coordinates(self, summary: RecordingSummary) -> tuple[Coordinate, ...]:
        """The share that is missing, and the time of recovery."""
        low = max(3.0, 2.0 * summary.interval_s)
        return (
            Coordinate(name="share", low=-0.9, high=0.9),
            Coordinate(name="recovery_s", low=low, high=max(300.0, 100.0 * summary.interval_s)),
        )

    def starts(self, summary: RecordingSummary) -> Floats:
        """A tenth to a half of the move, back within a minute or five."""
        unit = max(summary.interval_s, 1.0)
        return grid((-0.4, -0.15, 0.15, 0.4), (8.0 * unit, 25.0 * unit, 80.0 * unit))

    def shape(
        self, command: Floats, marks: Marks, interval_s: float, values: Floats, out: Floats
    ) -> None:
        """What the supply leaves of the command."""
        sagged(command, marks, interval_s, float(values[0]), float(values[1]), out)

    def material(self, values: Floats, summary: RecordingSummary) -> bool:
        """The largest move falls short by an amount that disturbs a loop."""
        return bool(abs(values[0]) * summary.swing >= MATERIAL_PERCENT)

    def parameters(self, values: Floats) -> Mapping[str, tuple[float, str]]:
        """Percent of a move that is missing (negative: falling uses the air); the recovery."""
        return {"sag": (100.0 * float(values[0]), "%"), "recovery": (float(values[1]), "s")}

    def sentence(self, parameters: Mapping[str, Estimate], rising: str, falling: str) -> str:
        direction = falling if number(parameters["sag"]) < 0.0 else rising
        return (
            f"On large moves the valve falls short by {size(parameters['sag'])} of the move when "
            f"{direction} and recovers with a time constant of {parameters['recovery']}: "
            "the air supply cannot keep up."
        )

    def field_test(self, parameters: Mapping[str, Estimate]) -> FieldTest:
        step = 20.0
        return FieldTest(
            do=(
                f"Loop in manual: step OP by {step:g} % the way that uses the air, the supply "
                "gauge in "
                "view."
            ),
            fails=(
                f"the stem stops about {about_value(size(parameters['sag']), step / 100.0)} "
                "short, and arrives "
                f"with a time constant of about {about_value(parameters['recovery'])}"
            ),
            passes=f"less than {MATERIAL_PERCENT:g} % short, and the gauge stands still",
        )


TERM: Term = SupplySag()
