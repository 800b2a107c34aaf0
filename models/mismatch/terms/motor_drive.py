"""Motor drive of finite gain: ``tau (tau_r dv/dt + v) = F - d fd``. Neutral: 0.

A motor under proportional position control is driven by the distance ``u - x`` that is left, less
what its speed induces: ``tau`` is that voltage over the controller's gain, in seconds; ``tau_r``
is the time in which the motor runs up, its inertia over the same coefficient; ``v_max`` is the
speed at full voltage, so that ``u - x`` drives it by ``tau v_max`` at most, whatever the load. The
bus and the controller may keep the command back by some samples, so the delay of the base reaches
further beside this term. A usual model of a direct-current drive, as in Armstrong-Hélouvry, Dupont
and Canudas de Wit (1994, doi:10.1016/0005-1098(94)90209-7).

Signature: the position follows behind the command by an amount that rises with speed, and swings
into and out of motion over several samples.
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

LONGEST = 100.0  # samples of lag and run-up
SLOWEST = 400.0  # samples in which full voltage brings the motor through the swing of OP
# Samples of lag and run-up, below which a drive does not show. The force balance has asked before.
LEAST_SHOWN = 0.25
# Samples that lag and run-up must last together. A position that is stored five seconds late in
# even steps of a second looks like a drive of 1.0 to 2.4 samples (15 healthy valves); 54 drives of
# `bench_servo_ladder` and `bench_other_motors` take 4.6 and more.
LEAST_OF_BOTH = 3.0
FREE = 1e6  # percent a unit of time: no top speed


class MotorDrive(StemTerm):
    """Lag, inertia and top speed of a drive: ``tau`` and ``tau_r`` in seconds, ``1/v_max``."""

    slug = "motor_drive"
    order = 32
    contains: tuple[str, ...] = (
        "viscous_drag",
        "actuator_lag",
        "asymmetric_lag",
        "dead_time",
        "rate_limit",
        "underdamped_positioner",
    )
    words = Words(
        plain="a motor of finite gain drives the moving part: it lags, runs up, has a top speed",
        decide=(
            "Raise the gain of the position controller: lag, dead band and the pull of a load all "
            "shrink as one over the gain, the run-up time does not."
        ),
        advice=FieldAdvice(
            title="drive follows slowly",
            steps=check_steps(
                "desk: Compare lag and top speed with the data sheet of drive and gear.",
                "desk: Read the gain of the position controller; integral action takes the rest.",
                "look: Look for a low supply voltage and a hot motor.",
                "manual: Step OP by 2 % and by 20 %: the large step meets the top speed.",
                "line: Check gear and bearings for stiff spots.",
            ),
            parts=("motor", "gear", "power supply of the drive"),
            damage="DOP",
            cause="4.2",
            part="actuator",
        ),
    )

    def coordinates(self, summary: RecordingSummary) -> tuple[Coordinate, ...]:
        """Lag and run-up up to a hundred samples; the speed at full voltage as ``SLOWEST`` says."""
        longest = LONGEST * summary.interval_s
        return (
            Coordinate(name="tau_s", low=0.0, high=longest),
            Coordinate(name="run_up_s", low=0.0, high=longest),
            Coordinate(
                name="slowness_s_per_percent",
                low=0.0,
                high=SLOWEST * summary.interval_s / max(summary.swing, 1.0),
            ),
        )

    def starts(self, summary: RecordingSummary) -> Floats:
        """Lags of 4 to 30 samples, run-ups of 2 to 8, without and with a top speed."""
        dt = summary.interval_s
        lags, run_ups = np.array([4.0, 10.0, 30.0]) * dt, np.array([2.0, 6.0]) * dt
        slow = np.array([0.0, 40.0]) * dt / max(summary.swing, 1.0)
        return grid(lags, run_ups, slow)

    def fill(self, stem: Stem, values: Floats) -> None:
        """Drag, run-up and top speed."""
        numbers = stem.numbers
        numbers[stem_number.DRAG_S], numbers[stem_number.RUN_UP_S] = values[0], values[1]
        numbers[stem_number.TOP_SPEED] = 1.0 / values[2] if values[2] > 1.0 / FREE else np.inf

    def material(self, values: Floats, summary: RecordingSummary) -> bool:
        """Lag and run-up are there and last long enough to be seen; without a run-up this is a drag
        or a lag, and one of a sample or two is a late clock."""
        lag, run_up = values[0] / summary.interval_s, values[1] / summary.interval_s
        return bool(min(lag, run_up) >= LEAST_SHOWN and lag + run_up >= LEAST_OF_BOTH)

    def inherent(self, values: Floats, summary: RecordingSummary) -> bool:
        """Lag and run-up are those of the motor: every drive of finite gain has them."""
        return True

    def parameters(self, values: Floats) -> Mapping[str, tuple[float, str]]:
        """The lag and the run-up."""
        return {"tau": (float(values[0]), "s"), "run_up": (float(values[1]), "s")}

    def sentence(self, parameters: Mapping[str, Estimate], rising: str, falling: str) -> str:
        return (
            "A motor of finite gain drives the moving part: it follows with a time constant of "
            f"{parameters['tau']} and runs up in {parameters['run_up']}."
        )

    def field_test(self, parameters: Mapping[str, Estimate]) -> FieldTest:
        return FieldTest(
            do="Step the command by 5 % and time the drive to 63 % of it.",
            fails=f"about {about_value(parameters['tau'])} behind the command",
            passes="the time that the maker gives for this gain and load",
        )


TERM: Term = MotorDrive()
