"""Can this recording be judged? Obstacles, each with a remedy, and a grade of the data.

Record effects come first: a frozen transmitter is not stiction, and a line that a historian drew
between its stored points is not a measurement.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stemwatch.models.limits import Limits
from stemwatch.models.preparation.own_clock import duration
from stemwatch.models.record_checks.data_quality import DataQuality, Obstacle
from stemwatch.models.record_checks.frozen import after_the_first, frozen_runs, without_frozen
from stemwatch.models.record_checks.on_a_stop import Stop, find_stop, stop_obstacle, without_stop
from stemwatch.models.record_checks.validity_checks import (
    between_pieces,
    foreign_obstacles,
    length_obstacles,
    movement_obstacles,
    position_obstacles,
    record_obstacles,
    unit_obstacles,
)
from stemwatch.models.recording import PERCENT, Recording, Role
from stemwatch.models.signals.excitation import at_limits
from stemwatch.models.signals.forensics import interpolated, quantum
from stemwatch.models.signals.op_in_steps import op_is_set_in_steps
from stemwatch.models.signals.percent import without_impossible_values
from stemwatch.models.signals.runs_of_samples import runs_of
from stemwatch.models.stickslip.problem import scored_samples
from stemwatch.models.words import counted, share

NEGLIGIBLE_SHARE = 0.005
PUT_TOGETHER = 0.1  # share of holes above which a recording counts as put together from pieces


@dataclass(frozen=True)
class Assessment:
    """A recording with its frozen samples masked, and those on a ``stop``, the grade of its data,
    and the obstacles."""

    recording: Recording  # frozen runs and a stop masked
    quality: DataQuality
    obstacles: tuple[Obstacle, ...]
    frozen_share: float
    stop: Stop | None = None


def _drawn_share(recording: Recording) -> float:
    """Share of position samples that lie on a sloped straight line where the command does not."""
    if recording.mv is None:
        return 0.0
    mv, op = recording.mv.values, recording.op.values
    interpolated_mv = interpolated(mv) & ~interpolated(op)
    moving = np.abs(np.gradient(mv)) > 0 if mv.size > 1 else interpolated_mv
    usable = np.isfinite(mv) & moving
    return float(interpolated_mv[usable].mean()) if usable.sum() > 20 else 0.0


def _clock_remarks(recording: Recording) -> list[tuple[str, str]]:
    clock_remarks, clock = [], recording.clock
    if clock.gaps:
        longest = duration(clock.longest_gap_s, recording.unit_s)
        several = f"{clock.gaps} gaps, the longest {longest}"
        clock_remarks.append(("B", f"1 gap of {longest}" if clock.gaps == 1 else several))
    if clock.repeated_times or clock.backward_steps:
        text = (
            f"{counted(clock.repeated_times, 'repeated time')}, "
            f"{counted(clock.backward_steps, 'step backward', 'steps backward')}"
        )
        clock_remarks.append(("B", text))
    if clock.jitter_s > 0.1 * recording.interval_s:
        jitter = duration(clock.jitter_s, recording.unit_s, ".2g")
        clock_remarks.append(("B", f"the clock jitters by {jitter}"))
    return clock_remarks


def _quality_remarks(
    recording: Recording, frozen: float, drawn_share: float, limits: Limits
) -> list[tuple[str, str]]:
    """(grade, sentence) for each defect of the data that does not prevent a verdict."""
    found_remarks: list[tuple[str, str]] = []
    bad = 1.0 - float(recording.usable.mean()) - frozen
    if bad > NEGLIGIBLE_SHARE:
        found_remarks.append(
            ("C" if bad > 0.1 else "B", f"{share(bad, 1)} of the samples are unusable")
        )
    found_remarks += _clock_remarks(recording)
    holes = between_pieces(recording)
    if bad > NEGLIGIBLE_SHARE and holes.mean() > PUT_TOGETHER:
        pieces = len(runs_of(~holes))
        text = f"the recording is put together from {pieces} pieces, each fitted from its own start"
        found_remarks.append(("C", text))
    if 0.0 < frozen <= limits.max_bad_share:
        text = f"the position was frozen for {share(frozen, 1)} of the time, which is left out"
        found_remarks.append(("C", text))
    if drawn_share > 0.1:
        found_remarks.append(
            ("C", f"{share(drawn_share)} of the moving position samples lie on drawn lines")
        )
    for signal, name in ((recording.op, "OP"), (recording.mv, "position")):
        step = quantum(signal.values) if signal is not None else 0.0
        if step > 0.2 and not (name == "OP" and op_is_set_in_steps(recording)):
            found_remarks.append(
                ("C" if step > 0.6 else "B", f"{name} is recorded in steps of {step:.2g} %")
            )
    saturated = sum(at_limits(recording.op.values))
    if recording.op.unit == PERCENT and saturated > 0.05:
        found_remarks.append(("C", f"OP is at its limit for {share(saturated)} of the time"))
    return found_remarks


def assess(recording: Recording, limits: Limits) -> Assessment:
    """Mask frozen samples, list the obstacles to a verdict, and grade the data.

    Grade A: no defects; B, C: a verdict is possible but less certain; D: no verdict.
    """
    obstacles = unit_obstacles(recording)
    recording = without_impossible_values(recording)
    stop = find_stop(recording)
    # On a stop a coarse reading repeats itself, and is not frozen.
    runs = [run for run in frozen_runs(recording) if stop is None or not stop.on[run[0]]]
    frozen = sum(b - a - 1 for a, b in runs) / max(len(recording), 1)
    drawn_share = _drawn_share(recording)
    if recording.mv is None or not obstacles:
        obstacles = position_obstacles(recording) + obstacles
    unmasked = recording
    if not obstacles:
        recording = without_frozen(recording, after_the_first(runs, len(recording)))
        # Of lines whose deviation is known it is known, too, what they hide.
        hidden_share = (
            drawn_share if recording.mv is None or recording.mv.deviation is None else 0.0
        )
        obstacles += record_obstacles(frozen, hidden_share, limits) or foreign_obstacles(
            without_stop(recording, stop)
        )
    # Frozen samples are reported as frozen, and not a second time as missing.
    obstacles += length_obstacles(unmasked if frozen > limits.max_bad_share else recording, limits)
    obstacles += movement_obstacles(recording, limits)
    if stop is not None and not obstacles:
        recording = without_stop(recording, stop)
        if _tells_nothing(recording, stop, limits):
            obstacles = [stop_obstacle(stop)]
    quality_remarks = (
        _quality_remarks(recording, frozen, drawn_share, limits) if len(recording) else []
    )
    reasons = tuple(o.reason for o in obstacles) + tuple(text for _, text in quality_remarks)
    grade = "D" if obstacles else max((letter for letter, _ in quality_remarks), default="A")
    return Assessment(
        recording=recording,
        quality=DataQuality(grade=grade, reasons=reasons),
        obstacles=tuple(obstacles),
        frozen_share=frozen,
        stop=stop,
    )


def _tells_nothing(beside: Recording, stop: Stop, limits: Limits) -> bool:
    """Whether what is left ``beside`` a stop is too little for a verdict."""
    fitted = np.count_nonzero(scored_samples(beside)) if beside.usable.any() else 0
    if fitted < limits.min_samples:  # pieces between two stands may be too short to fit
        return True
    op = replace(beside.op, values=np.where(stop.on, np.nan, beside.op.values))
    moved = replace(beside, signals={**beside.signals, Role.OP: op})
    return bool(movement_obstacles(moved, limits))


def with_obstacles(assessment: Assessment, obstacles: Sequence[Obstacle]) -> Assessment:
    """``assessment`` with obstacles that only a fit could find; grade D where there are any."""
    if not obstacles:
        return assessment
    reasons = (*(obstacle.reason for obstacle in obstacles), *assessment.quality.reasons)
    return replace(
        assessment,
        obstacles=(*assessment.obstacles, *obstacles),
        quality=replace(assessment.quality, grade="D", reasons=reasons),
    )
