"""Can this recording carry a verdict? Obstacles, each with what would help, and a grade.

Record effects come first: a frozen transmitter is not stiction, and what a historian drew between
its stored points is not a measurement.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from stemwatch.models.excitation import reversals, swing
from stemwatch.models.findings import DataQuality
from stemwatch.models.forensics import interpolated, noise_sigma, quantum, repeat_share
from stemwatch.models.limits import Limits
from stemwatch.models.recording import PERCENT, Bools, Floats, Quality, Recording, Role, Signal
from stemwatch.models.stickslip.problem import WARM_UP_S, scored_samples

FROZEN_S = 30.0  # a noisy transmitter does not repeat itself to the last bit for this long
FROZEN_SAMPLES = 20
MOST_REPEATS = 0.3  # a reading that repeats itself less often than this has noise
# White noise turns round at two samples of three, a moving stem hardly ever.
NOISE_TURNS = 0.4
NEGLIGIBLE_SHARE = 0.005
# The range of white noise from its 1st to its 99th percentile is 4.7 standard deviations.
NOISE_SWING = 6.0
# A sticking stem may lag by a quarter of a cycle and more, which gives 0 or a little less.
AGAINST = -0.8
STUCK_REMEDY = "Look at the valve: a stroke test tells a stuck stem from a dead transmitter."
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


def _run_edges(flags: Bools) -> NDArray[np.int64]:
    """(m, 2) first and last + 1 of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], flags.astype(np.int8), [0]))))
    return np.asarray(edges.reshape(-1, 2), dtype=np.int64)


def frozen_runs(recording: Recording) -> list[tuple[int, int]]:
    """Runs in which the position reading was frozen: bit-exact repeats that friction cannot make.

    Where the reading has noise, any long exact repeat is frozen. A coarse reading repeats itself
    whenever the stem rests, so there a run counts only while OP moves four times as far as in the
    valve's other rests, each rest weighed by how long it lasts.
    """
    if recording.mv is None:
        return []
    mv, op = recording.mv.values, recording.op.values
    same = np.concatenate(([False], np.diff(mv) == 0.0))
    runs = _run_edges(same) - (1, 0)  # the sample that is repeated belongs to the run
    length = runs[:, 1] - runs[:, 0]
    runs, length = runs[length > 3], length[length > 3]
    long = length >= max(FROZEN_SAMPLES, round(FROZEN_S / recording.interval_s))
    if not long.any():
        return []
    if not _noisy(mv, runs[long]):
        moved = _way(op, runs)
        long &= moved > np.maximum(4.0 * _usual_of_others(moved, length), 6.0)
    return [(int(a), int(b)) for a, b in runs[long]]


def _noisy(mv: Floats, runs: NDArray[np.int64]) -> bool:
    """True where the reading, outside its long repeats, turns round at every other sample.

    A reading that seldom repeats itself at all has noise too, however fast the stem moves.
    """
    if repeat_share(mv) < MOST_REPEATS:
        return True
    outside = mv.copy()
    for first, last in runs:
        outside[first:last] = np.nan
    steps = np.diff(outside)
    turning = steps[1:] * steps[:-1]
    turning = turning[np.isfinite(turning)]
    return bool(turning.size >= 100 and np.mean(turning < 0.0) > NOISE_TURNS)


def _way(op: Floats, runs: NDArray[np.int64]) -> Floats:
    """(m,) range of OP within each run."""
    edges, padded = runs.ravel(), np.append(op, np.nan)
    high, low = (f.reduceat(padded, edges)[::2] for f in (np.fmax, np.fmin))
    return np.asarray(high - low)


def _usual_of_others(moved: Floats, length: NDArray[np.int64]) -> Floats:
    """(m,) for each run the median of ``moved`` over the others, weighted by ``length``."""
    order = np.argsort(moved, kind="stable")
    total = np.cumsum(length[order])
    own = length[order]
    half = 0.5 * (total[-1] - own)
    before = np.searchsorted(total, half)
    after = np.searchsorted(total, half + own)
    place = np.where(before < np.arange(order.size), before, np.minimum(after, order.size - 1))
    usual = np.empty(order.size)
    usual[order] = np.where(total[-1] > own, moved[order][place], 0.0)
    return usual


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
    return _still_obstacles(recording) or _reversed_obstacles(recording)


def _reversed_obstacles(recording: Recording) -> list[Obstacle]:
    """A position that runs against OP: a fit would read the whole swing as sticking."""
    assert recording.mv is not None
    pairs = recording.usable
    op, mv = recording.op.values[pairs], recording.mv.values[pairs]
    if op.size < 10 or swing(op) == 0.0 or swing(mv) == 0.0:
        return []
    together = float(np.corrcoef(op, mv)[0, 1])
    if together > AGAINST:
        return []
    return [
        Obstacle(
            "position_reversed",
            f"the position falls when OP rises (correlation {together:.2f}): it counts the other "
            "way, so S and J cannot be read from the two as they are",
            "Give the position's values at 0 % and 100 % of OP (low, high) the other way round.",
        )
    ]


def _command_obstacles(recording: Recording) -> list[Obstacle]:
    """A command that is not in percent, by its unit or by its values."""
    op = recording.op.values[np.isfinite(recording.op.values)]
    if recording.op.unit != PERCENT:
        reason = f"OP ({recording.op.tag}) is in {recording.op.unit or 'an unknown unit'}"
    elif op.size and np.mean((op < -10.0) | (op > 110.0)) > 0.5:
        reason = f"OP ({recording.op.tag}) runs from {op.min():.4g} to {op.max():.4g}"
    else:
        return []
    return [Obstacle("op_unit", f"{reason}, not in percent of span", UNIT_REMEDY)]


def _still_obstacles(recording: Recording) -> list[Obstacle]:
    """A position that does not move while OP does, or by its noise only."""
    assert recording.mv is not None
    mv, far = recording.mv.values, swing(recording.op.values)
    finite = mv[np.isfinite(mv)]
    if far <= 2.0 or not finite.size:
        return []
    if float(np.ptp(finite)) == 0.0:
        return [
            Obstacle(
                "position_frozen",
                f"the position did not change by one digit while OP moved over {far:.1f} %: "
                "either the transmitter is frozen or the stem is stuck fast",
                STUCK_REMEDY,
            )
        ]
    if swing(mv) <= NOISE_SWING * noise_sigma(mv):
        return [
            Obstacle(
                "position_still",
                f"the position shows nothing but its noise while OP moved over {far:.1f} %: either "
                "the stem is stuck fast or this is not the position of this valve",
                STUCK_REMEDY,
            )
        ]
    return []


def _length_obstacles(recording: Recording, limits: Limits) -> list[Obstacle]:
    usable = int(recording.usable.sum())
    if not len(recording):
        return [Obstacle("empty", "the recording holds no sample", "Choose another time window.")]
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
    fitted = int(np.sum(scored_samples(recording)))
    if not found and fitted < limits.min_samples:
        found.append(
            Obstacle(
                "broken_up",
                f"holes break the recording into pieces too short to fit: {fitted} samples are "
                f"more than {WARM_UP_S:.0f} s after a hole",
                f"Export at least {limits.min_samples:.0f} samples without holes, or mend the "
                "archive.",
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
    if not len(recording):
        return remarks
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
    frozen = sum(b - a - 1 for a, b in runs) / max(len(recording), 1)
    drawn = _drawn_share(recording)
    obstacles = _command_obstacles(recording) + _position_obstacles(recording)
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
