"""Underdamped positioner: a second order before the stem. Neutral: ``wn = 0``, switched off.

``vel += h (wn^2 (u - p) - 2 zeta wn vel)``, ``p += h vel`` in sub-steps ``h`` of at most 0.1 s and
at least ten per sample.

Signature: ringing of constant period after each move, with alternating sign.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import exp, pi, sqrt

import numpy as np

from stemwatch.models.compiled import compiled
from stemwatch.models.estimate import Estimate
from stemwatch.models.field_advice import FieldAdvice, FieldTest, check_steps
from stemwatch.models.mismatch.term import Coordinate, RecordingSummary, Term, Words
from stemwatch.models.mismatch.terms._common import CommandTerm, grid, number
from stemwatch.models.recording import Floats
from stemwatch.models.stickslip.kernel import Marks

MATERIAL_ZETA = 0.65  # more damping overshoots by less than 7 % of a move: a lag, not ringing
MATERIAL_OVERSHOOT = 0.3  # percent of travel on the largest moves
QUICKEST = 0.5 * pi  # radians between two samples: four samples a period


@compiled()
def rung(command: Floats, marks: Marks, dt: float, wn: float, zeta: float, out: Floats) -> None:
    """Second order over ``command`` (n,) into ``out`` (n,), percent; at rest where marked START.

    ``wn`` in rad/s, 0 switches it off; ``dt`` in seconds. The command rests within a sample, so
    that the sub-steps are one linear map of the error ``p - u`` and the velocity.
    """
    if wn <= 0.0:
        for k in range(command.size):
            out[k] = command[k]
        return
    steps = max(10, int(np.ceil(dt / 0.1 - 1e-9)))
    h = dt / steps
    pull, kept_share = h * wn * wn, 1.0 - 2.0 * h * zeta * wn
    # Columns of the map: where a unit of error and a unit of velocity go in one sample.
    ee, ve, ev, vv = 1.0, 0.0, 0.0, 1.0
    for _ in range(steps):
        ve = kept_share * ve - pull * ee
        ee += h * ve
        vv = kept_share * vv - pull * ev
        ev += h * vv
    p, velocity = command[0], 0.0
    for k in range(command.size):
        if marks[k] == 1:
            p, velocity = command[k], 0.0
        else:
            error = p - command[k]
            p = command[k] + ee * error + ev * velocity
            velocity = ve * error + vv * velocity
        out[k] = p


def overshoot(zeta: float) -> float:
    """Share of a step by which a second order of damping ``zeta`` goes too far, 0 to 1."""
    return exp(-pi * zeta / sqrt(1.0 - zeta * zeta)) if zeta < 1.0 else 0.0


class UnderdampedPositioner(CommandTerm):
    """A ringing positioner: natural frequency in rad/s and damping ratio."""

    slug = "underdamped_positioner"
    order = 25
    contains: tuple[str, ...] = ("actuator_lag",)
    words = Words(
        plain="the positioner overshoots and rings after each move",
        decide=(
            "Put the loop in manual and step OP by 5 %: ringing while OP rests is the "
            "positioner, ringing that ends in manual is the control loop, and a lag does not "
            "overshoot."
        ),
        advice=FieldAdvice(
            title="positioner rings",
            steps=check_steps(
                "look: Look at feedback arm, pin and cam for wear and play.",
                (
                    "manual: Step OP by 5 % with the loop in manual: ringing while OP rests is "
                    "the positioner."
                ),
                (
                    "manual: Lower its gain, raise its damping, or run its self-tuning; open a "
                    "booster's bypass."
                ),
                (
                    "air: Check whether the actuator is small for this positioner; exchange the "
                    "relay where worn."
                ),
            ),
            parts=(
                "positioner",
                "feedback linkage",
                "volume booster",
            ),
            damage="FTR",
            cause="3.4",
            part="positioner",
        ),
    )

    def coordinates(self, summary: RecordingSummary) -> tuple[Coordinate, ...]:
        """Natural frequency and damping; ringing faster than four samples is aliased."""
        unit = max(summary.interval_s, 1.0)
        return (
            Coordinate(name="wn_rad_per_s", low=0.15 / unit, high=2.0 / unit),
            Coordinate(name="zeta", low=0.03, high=1.0),
        )

    def starts(self, summary: RecordingSummary) -> Floats:
        """Periods from 5 to 30 s (or samples), little and much damping."""
        unit = max(summary.interval_s, 1.0)
        frequencies = np.array([0.2, 0.35, 0.55, 0.85, 1.3]) / unit
        return grid(frequencies, (0.12, 0.3, 0.6))

    def shape(
        self, command: Floats, marks: Marks, interval_s: float, values: Floats, out: Floats
    ) -> None:
        """The command through a second-order system that overshoots and rings."""
        rung(command, marks, interval_s, float(values[0]), float(values[1]), out)

    def material(self, values: Floats, summary: RecordingSummary) -> bool:
        """It overshoots by a share of each move and by an amount that disturbs a loop, and slowly
        enough to be seen: between a few samples a ring is not told from a lag."""
        wn, zeta = float(values[0]), float(values[1])
        seen = overshoot(zeta) * summary.swing >= MATERIAL_OVERSHOOT
        slow = wn * max(summary.interval_s, 1.0) <= QUICKEST
        return wn > 0.0 and slow and zeta <= MATERIAL_ZETA and seen

    def parameters(self, values: Floats) -> Mapping[str, tuple[float, str]]:
        """Natural frequency and damping ratio."""
        return {"wn": (float(values[0]), "rad/s"), "zeta": (float(values[1]), "")}

    def sentence(self, parameters: Mapping[str, Estimate], rising: str, falling: str) -> str:
        """With the period of the damped ringing."""
        wn, zeta = parameters["wn"], parameters["zeta"]
        rings = "The positioner rings after each move"
        damping = number(zeta)
        if number(wn) > 0.0 and damping < 1.0:
            period = 2.0 * pi / (number(wn) * sqrt(1.0 - damping * damping))
            period_estimate = replace(wn, value=period, low=None, high=None, unit="s")
            rings += (
                f", with a period of {period_estimate} and an overshoot of "
                f"{100.0 * overshoot(damping):.0f} % of the move"
            )
        return f"{rings} (natural frequency {wn}, damping ratio {zeta})."

    def field_test(self, parameters: Mapping[str, Estimate]) -> FieldTest:
        zeta = number(parameters["zeta"])
        overshoot_percent = 100.0 * overshoot(zeta) if 0.0 <= zeta < 1.0 else 0.0
        return FieldTest(
            do=(
                "Loop in manual: step OP by 10 %, and read how far the stem swings beyond its "
                "place."
            ),
            fails=f"by about {overshoot_percent:.0f} % of the step",
            passes=f"by no more than {100.0 * overshoot(MATERIAL_ZETA):.0f} % of it",
        )


TERM: Term = UnderdampedPositioner()
