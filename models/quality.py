"""Can this recording carry a verdict? Obstacles, each with what would help, and a grade.

Record effects come first: a frozen transmitter is not stiction, and what a historian drew between
its stored points is not a measurement.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stemwatch.models.excitation import reversals, swing
from stemwatch.models.findings import DataQuality
from stemwatch.models.forensics import interpolated, noise_sigma, quantum, repeat_share
from stemwatch.models.limits import Limits
from stemwatch.models.recording import PERCENT, Bools, Quality, Recording, Role, Signal

FROZEN_S = 30.0  # a noisy transmitter does not repeat itself to the last bit for this long
FROZEN_SAMPLES = 20
NEGLIGIBLE_SHARE = 0.005
UNIT_REMEDY = "Give its values at 0 % and 100 % (low, high) so that it can be read as percent."


@dataclass(frozen=True)
class Obstacle:
    """Why there can be no verdict, and what would make one possible; a sentence each."""

    slug: str
    reason: str
    remedy: str


@dataclass(frozen=True)
class Assessment:
    """What is left of a recording after record effects are masked, and what stands in the way."""

    recording: Recording  # frozen runs masked
    quality: DataQuality
    obstacles: tuple[Obstacle, ...]
    frozen_share: float
    interpolated_share: float


def _runs(flags: Bools) -> list[tuple[int, int]]:
    """(first, last + 1) of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], flags.astype(np.int8), [0]))))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def frozen_runs(recording: Recording) -> list[tuple[int, int]]:
    """Runs in which the position reading was frozen: bit-exact repeats that friction cannot make.

    Where the reading has noise, any long exact repeat is frozen. A coarse reading repeats itself
    whenever the stem rests, so there a run counts only while OP moves four times as far as in the
    valve's other rests.
    """
    if recording.mv is None:
        return []
    mv, op = recording.mv.values, recording.op.values
    least = max(FROZEN_SAMPLES, round(FROZEN_S / recording.interval_s))
    same = np.concatenate(([False], np.diff(mv) == 0.0))
    runs = [(a - 1, b) for a, b in _runs(same) if b - a + 1 >= least]
    if not runs:
        return []
    if repeat_share(mv) < 0.3:  # outside its frozen runs the reading never repeats: it has noise
        return runs
    moved = np.array([swing(op[a:b]) for a, b in runs])
    everything = [swing(op[a:b]) for a, b in _runs(same) if b - a >= 3]
    usual = float(np.median(everything)) if everything else 0.0
    return [run for run, far in zip(runs, moved, strict=True) if far > max(4.0 * usual, 6.0)]


def _mask(recording: Recording, role: Role, runs: list[tuple[int, int]]) -> Recording:
    signal = recording.signals[role]
    quality = signal.quality.copy()
    for first, last in runs:
        # The first sample of a run is the last true one.
        quality[first + 1 : last] = Quality.BAD
    masked = Signal(signal.values, quality, signal.tag, signal.unit, signal.interval_s)
    return replace(recording, signals={**recording.signals, role: masked})


def _drawn_share(recording: Recording) -> float:
    """Share of position samples that lie on a sloped straight line where the command does not."""
    if recording.mv is None:
        return 0.0
    mv, op = recording.mv.values, recording.op.values
    drawn = interpolated(mv) & ~interpolated(op)
    moving = np.abs(np.gradient(mv)) > 0 if mv.size > 1 else drawn
    usable = np.isfinite(mv) & moving
    return float(drawn[usable].mean()) if usable.sum() > 20 else 0.0


def _same_signal(recording: Recording) -> bool:
    """True where the "position" is OP under another name, sample for sample."""
    assert recording.mv is not None
    pairs = recording.usable
    op, mv = recording.op.values[pairs], recording.mv.values[pairs]
    if op.size < 10 or swing(op) == 0.0:
        return False
    tolerance = 1e-6 * max(swing(op), 1.0)
    return float(np.mean(np.abs(mv - op) <= tolerance)) > 0.99


def _position_obstacles(recording: Recording) -> list[Obstacle]:
    if recording.mv is None:
        return [
            Obstacle(
                "no_position",
                "there is no valve position in this recording, and OP and PV alone cannot tell "
                "a sticking valve from a badly tuned loop or a disturbance",
                "Record the position (positioner feedback, limit transmitter), or do a "
                "stroke test: step OP by 1 % up and down and watch for the stem.",
            )
        ]
    if _same_signal(recording):
        return [
            Obstacle(
                "position_is_op",
                f"the position tag {recording.mv.tag} repeats OP sample for sample: it is the "
                "controller output under another name",
                "Map the tag of the stem position (ZT, POS, positioner feedback).",
            )
        ]
    if recording.mv.unit != PERCENT:
        return [
            Obstacle(
                "position_unit",
                f"{recording.mv.tag} is in {recording.mv.unit}, not in percent of travel, so it "
                "cannot be compared with OP",
                UNIT_REMEDY,
            )
        ]
    return _still_obstacles(recording)


def _still_obstacles(recording: Recording) -> list[Obstacle]:
    """A position that does not move while OP does."""
    assert recording.mv is not None
    mv, far = recording.mv.values, swing(recording.op.values)
    finite = mv[np.isfinite(mv)]
    if finite.size and float(np.ptp(finite)) == 0.0 and far > 2.0:
        return [
            Obstacle(
                "position_frozen",
                f"the position did not change by one digit while OP moved over {far:.1f} %: "
                "either the transmitter is frozen or the stem is stuck fast",
                "Look at the valve: a stroke test tells a stuck stem from a dead transmitter.",
            )
        ]
    return []


def _length_obstacles(recording: Recording, limits: Limits) -> list[Obstacle]:
    usable = int(recording.usable.sum())
    found = []
    if recording.duration_s < limits.min_duration_s or usable < limits.min_samples:
        found.append(
            Obstacle(
                "too_short",
                f"the recording is too short: {usable} usable samples in "
                f"{recording.duration_s / 60:.1f} minutes",
                f"Export at least {limits.min_samples:.0f} samples and "
                f"{limits.min_duration_s / 60:.0f} minutes; an hour at 1 s is good.",
            )
        )
    bad = 1.0 - usable / len(recording)
    if bad > limits.max_bad_share:
        found.append(
            Obstacle(
                "bad_samples",
                f"{bad:.0%} of the samples are missing or marked bad",
                "Mend the archive or the transmitter, or choose another time window.",
            )
        )
    return found


def _manual(recording: Recording) -> bool:
    mode = recording.get(Role.MODE)
    if mode is None:
        return False
    known = mode.values[np.isfinite(mode.values)]
    return bool(known.size and np.mean(known == 0.0) > 0.5)


def _movement_obstacles(recording: Recording, limits: Limits) -> list[Obstacle]:
    op = recording.op.values[np.isfinite(recording.op.values)]
    far = swing(op)
    threshold = max(0.1 * far, 4.0 * noise_sigma(op), 0.2)
    turns = int(reversals(op, threshold).size) if op.size else 0
    manual = "the loop was in manual and " if _manual(recording) else ""
    remedy = (
        "Screen a window in which the set point moved or the load changed, or step OP by 2 to "
        "5 % a few times each way."
    )
    if far < 2.0 * limits.watch_S_percent:
        reason = f"{manual}OP moved over {far:.1f} % only, so a sticking stem would not show"
        return [Obstacle("manual" if manual else "op_still", reason, remedy)]
    if turns < limits.min_reversals:
        reason = f"{manual}OP turned round {turns} times only; stiction shows at reversals"
        return [Obstacle("manual" if manual else "few_reversals", reason, remedy)]
    per_cycle = 2.0 * op.size / turns
    if per_cycle < limits.min_samples_per_cycle:
        return [
            Obstacle(
                "slow_sampling",
                f"sampling is too slow for this loop: {per_cycle:.1f} samples per cycle of OP",
                f"Record faster than every {recording.interval_s:g} s.",
            )
        ]
    return []


def _record_obstacles(frozen: float, drawn: float, limits: Limits) -> list[Obstacle]:
    found = []
    if frozen > 0.5:
        found.append(
            Obstacle(
                "position_frozen",
                f"the position reading was frozen for {frozen:.0%} of the time",
                "Check the position transmitter and its path to the historian.",
            )
        )
    if drawn > limits.max_interpolated_share:
        found.append(
            Obstacle(
                "compressed",
                f"the historian compressed the position: {drawn:.0%} of its moving samples were "
                "drawn between stored points, which hides when the stem slipped",
                "Export raw values with compression off (or its deviation below 0.1 %).",
            )
        )
    return found


def _remarks(recording: Recording, frozen: float, drawn: float) -> list[tuple[str, str]]:
    """(grade it costs, sentence) for what a verdict can live with."""
    remarks: list[tuple[str, str]] = []
    bad = 1.0 - float(recording.usable.mean())
    if bad > NEGLIGIBLE_SHARE:
        remarks.append(("C" if bad > 0.1 else "B", f"{bad:.1%} of the samples are unusable"))
    clock = recording.clock
    if clock.gaps:
        remarks.append(("B", f"{clock.gaps} gaps, the longest {clock.longest_gap_s:.0f} s"))
    if clock.repeated_times or clock.backward_steps:
        text = f"{clock.repeated_times} repeated times, {clock.backward_steps} steps backward"
        remarks.append(("B", text))
    if clock.jitter_s > 0.1 * recording.interval_s:
        remarks.append(("B", f"the clock jitters by {clock.jitter_s:.2g} s"))
    if frozen > 0.0:
        text = f"the position was frozen for {frozen:.1%} of the time; those samples are left out"
        remarks.append(("C", text))
    if drawn > 0.1:
        remarks.append(("C", f"{drawn:.0%} of the moving position samples lie on drawn lines"))
    for signal, name in ((recording.op, "OP"), (recording.mv, "position")):
        step = quantum(signal.values) if signal is not None else 0.0
        if step > 0.2:
            remarks.append(
                ("C" if step > 0.6 else "B", f"{name} is recorded in steps of {step:.2g} %")
            )
    saturated = np.mean((recording.op.values <= 0.0) | (recording.op.values >= 100.0))
    if recording.op.unit == PERCENT and saturated > 0.05:
        remarks.append(("C", f"OP is at its limit for {saturated:.0%} of the time"))
    return remarks


def assess(recording: Recording, limits: Limits) -> Assessment:
    """Mask what record effects spoilt, list the obstacles to a verdict, and grade the data.

    Grade A: nothing to remark; B, C: a verdict with care; D: none possible.
    """
    runs = frozen_runs(recording)
    frozen = sum(b - a - 1 for a, b in runs) / len(recording)
    drawn = _drawn_share(recording)
    obstacles = _position_obstacles(recording)
    if not obstacles:
        if runs:
            recording = _mask(recording, Role.MV, runs)
        obstacles += _record_obstacles(frozen, drawn, limits)
    obstacles += _length_obstacles(recording, limits)
    obstacles += _movement_obstacles(recording, limits)
    remarks = _remarks(recording, frozen, drawn)
    reasons = tuple(o.reason for o in obstacles) + tuple(text for _, text in remarks)
    grade = "D" if obstacles else max((letter for letter, _ in remarks), default="A")
    return Assessment(
        recording=recording,
        quality=DataQuality(grade=grade, reasons=reasons),
        obstacles=tuple(obstacles),
        frozen_share=frozen,
        interpolated_share=drawn,
    )
