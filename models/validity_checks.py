"""What can stand between a recording and a verdict, each with what would help."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stemwatch.models.excitation import reversals, swing
from stemwatch.models.forensics import noise_sigma, quantum
from stemwatch.models.limits import Limits
from stemwatch.models.own_clock import duration, is_of_seconds
from stemwatch.models.percent import POSSIBLE_PERCENT, not_percent
from stemwatch.models.recording import PERCENT, Bools, Quality, Recording, Role
from stemwatch.models.runs_of_samples import long_runs
from stemwatch.models.signal_pairing import (
    LONGEST_DELAY_S,
    command_is,
    copied_from,
    correlation,
    delayed_correlation,
    is_copy,
    moved_without_command,
    samples_exchanged,
    sums_its_command,
    tells_two_places,
)
from stemwatch.models.stickslip.best_pairing import AFTER, BEFORE, BestShift, Pairing, paired
from stemwatch.models.stickslip.clock_shift import BehindController, behind_controller
from stemwatch.models.stickslip.find_stroke_curve import AGAINST
from stemwatch.models.stickslip.fit import FirstLook
from stemwatch.models.stickslip.problem import LONGEST_BRIDGE_SAMPLES, WARM_UP_S, scored_samples
from stemwatch.models.stickslip.rests import Rests
from stemwatch.models.words import share, times

# Where the plant does not say how long a recording must last.
LEAST_SAMPLES, GOOD_SAMPLES = 300, 3600
# The range of white noise from its 1st to its 99th percentile is 4.7 standard deviations.
NOISE_SWING = 6.0
# 140 simulated valves that moved gave 0.37 and above, positions of other valves mostly below 0.3.
UNRELATED = 0.3
# What is left of a stem that never moves (``best_pairing``). 93 simulated valves that moved, with
# and without hidden effects (seeds 5151 and 8181), leave 0.03 to 0.81, 0.49 at most without effects
# and 0.25 in the middle; a command of another time leaves them 1.03 times as much and more, OP read
# as the position 0.5 times, PV or SP in the place of OP or position 0.66 times.
DOUBTED, RELATED, UNRELATED_LEFT = 0.3, 0.7, 0.85
ANOTHER_TIME, BY_ANOTHER = 0.85, 0.5
# A valve that hardly sticks goes with its command either way round, and is healthy either way.
# Either way round, S of 76 sticking ones is 2.1 % and more, of 92 healthy ones 1.6 % and less, of
# all but two 1.5 % (`draw_valves`, seeds 6161, 8383, 9393; `draw_sticky`, `draw_healthy`, 5151).
SURELY_SWAPPED, SWAPPED_FROM, STICKS_PERCENT = 0.5, 0.2, 1.5
# A command that seems stored late may be the position: then a little simpler the other way round is
# enough.
SWAPPED_AND_LATE = 0.9
# Where OP rests as a stem does (``rests``), the other way round need not even be the simpler one.
SWAPPED_BY_RESTS = 1.5
# By the controller's law OP and PV are what they are called where it leaves so many times less of
# OP's moves than of those of the position that answered PV, or of OP's that answered the position.
# Where OP and position, or position and PV, are exchanged it is the other way round; nothing of the
# kind is asked where the position follows OP so badly that it may be another valve's.
OP_PLAINLY, PV_PLAINLY, FOLLOWS = 3.0, 10.0, 0.5
# Share of the position's way; 80 simulated valves (seed 8181) make 0.06 of it at most.
MOVED_WITHOUT_OP = 0.15
LEAST_SWING_PERCENT = 0.5
COARSEST_PERCENT = 3.0  # steps of a position, twice the S of a sticky valve
# Which is exchanged for which, and what then is the command and what the position.
OTHERS = (
    (Role.OP, Role.PV, Role.PV, Role.MV),
    (Role.MV, Role.PV, Role.OP, Role.PV),
    (Role.OP, Role.SP, Role.SP, Role.MV),
)
UNEXPLAINED = BestShift(np.inf, 0.0)
SPOKEN = {Role.OP: "OP", Role.MV: "the position", Role.PV: "PV", Role.SP: "SP"}
SUMS_OP = "the position moves as fast as OP says"
MAP_POSITION = "Map the tag of the stem position (ZT, POS, positioner feedback)."
STUCK_REMEDY = "Look at the valve: a stroke test tells a stuck stem from a dead transmitter."
UNIT_REMEDY = "Give its values at 0 % and 100 % (low, high) so that it can be read as percent."


@dataclass(frozen=True)
class Obstacle:
    """Why there can be no verdict, and what would make one possible; a sentence each."""

    slug: str
    reason: str
    remedy: str


def position_obstacles(recording: Recording) -> list[Obstacle]:
    """No position, or one that is not the stem's."""
    if recording.mv is None:
        return [
            Obstacle(
                "no_position",
                "there is no valve position in this recording, and OP and PV alone cannot tell "
                "a sticking valve from a badly tuned loop or a disturbance",
                "Record the position (positioner feedback, position transmitter), or do a "
                "stroke test: step OP by 1 % up and down and watch for the stem.",
            )
        ]
    return (
        _copy_obstacles(recording) or _still_obstacles(recording) or _content_obstacles(recording)
    )


def _copy_obstacles(recording: Recording) -> list[Obstacle]:
    """A position that is another tag under its own name, and no stem's."""
    assert recording.mv is not None
    tag = recording.mv.tag
    if is_copy(recording):
        return [
            Obstacle(
                "position_is_op",
                f"the position tag {tag} repeats OP sample for sample: it is the "
                "controller output under another name",
                MAP_POSITION,
            )
        ]
    source = copied_from(recording)
    if source is Role.OP:
        return [
            Obstacle(
                "position_is_op",
                f"the position tag {tag} is computed from OP (on another scale, late or filtered), "
                "without the noise that every measured stem has",
                MAP_POSITION,
            )
        ]
    if source is not None:
        return [
            Obstacle(
                "position_is_" + source.value,
                f"the position tag {tag} repeats {source.value.upper()}, so it is not the stem's",
                MAP_POSITION,
            )
        ]
    command = command_is(recording)
    if command is not None:
        return [
            Obstacle(
                "op_is_" + command.value,
                f"the tag of OP, {recording.op.tag}, repeats {command.value.upper()}, so it is not "
                "the controller output",
                "Map the tag of the controller output (OP, OUT, CO).",
            )
        ]
    return []


def _content_obstacles(recording: Recording) -> list[Obstacle]:
    """A position that holds places, steps or another signal's samples instead of the stem's way."""
    assert recording.mv is not None
    mv = recording.mv
    if tells_two_places(recording):
        values = np.unique(mv.values[mv.usable])
        seen = " and ".join(f"{value:g}" for value in values)
        return [
            Obstacle(
                "position_switch",
                f"the position tag {mv.tag} knows only the values {seen}: it is a limit switch or "
                "a state, not a position",
                MAP_POSITION,
            )
        ]
    if samples_exchanged(recording):
        return [
            Obstacle(
                "samples_exchanged",
                "OP and position change places from sample to sample",
                "Export the two tags again, each by itself, and compare.",
            )
        ]
    step = quantum(mv.values)
    if mv.unit == PERCENT and step > COARSEST_PERCENT:
        return [
            Obstacle(
                "position_coarse",
                f"the position is recorded in steps of {step:.2g} %, wider than the sticking that "
                "matters",
                "Have the position archived finer, 0.1 % or better.",
            )
        ]
    return []


def reversed_obstacles(recording: Recording) -> list[Obstacle]:
    """A position that runs against OP, where no curve from OP to stroke explains why."""
    correlated = correlation(recording)
    if correlated > AGAINST:
        return []
    return [
        Obstacle(
            "position_reversed",
            f"the position falls when OP rises (correlation {correlated:.2f}), and no curve "
            "from OP to stroke follows it",
            "Check which tag is this valve's position; if it counts the other way, give its values "
            "at 0 % and 100 % of OP (low, high) the other way round.",
        )
    ]


def foreign_obstacles(recording: Recording) -> list[Obstacle]:
    """A position that does not go with OP at all: a fit would call it sticking."""
    if sums_its_command(recording):
        return [
            Obstacle(
                "position_sums_op",
                f"{SUMS_OP}, wherever it is: OP is a speed, a force or the pulses of an electric "
                "actuator, and not the position that the valve is told",
                "See that OP is what this valve is told: map the position that its positioner or "
                "drive is given.",
            )
        ]
    moves_alone = moved_without_command(recording)
    if moves_alone > MOVED_WITHOUT_OP:
        return [
            Obstacle(
                "op_not_followed",
                f"the position makes {share(moves_alone)} of its way while OP stands still: "
                "something else moves this valve",
                "Map the output that goes to this valve: not that of a manual station that does "
                "not track, nor of the other valve of a split range.",
            )
        ]
    # A position that counts the other way is related all the same.
    correlated = max(delayed_correlation(recording), -correlation(recording))
    if correlated >= UNRELATED or swing(recording.op.values) <= 2.0:
        return []
    unit_s = recording.unit_s
    later = "two minutes" if is_of_seconds(unit_s) else duration(LONGEST_DELAY_S, unit_s)
    return [
        Obstacle(
            "position_unrelated",
            f"the position does not go with OP (correlation {max(correlated, 0.0):.2f} at best, up "
            f"to {later} later): it may be another valve's",
            "Check which tag is this valve's position; step OP and see whether it answers.",
        )
    ]


def wiring_obstacles(
    recording: Recording, as_stored: Recording | None = None, first_look: FirstLook | None = None
) -> list[Obstacle]:
    """Tags that are mixed up, or clocks that are minutes apart: what else explains the position.

    ``recording`` in percent of travel both, read through its curve; ``as_stored`` what it was where
    its OP was taken for stored late and brought forward; ``first_look`` a first look at
    ``recording``.
    """
    pairing = Pairing.of(recording, first_look)
    # Most valves need no second look.
    if pairing is None or pairing.explained(BEFORE[:1]).left < SWAPPED_FROM:
        return []
    at_most = pairing.explained(BEFORE)
    nearest = min(at_most, pairing.explained(AFTER), key=lambda candidate: candidate.left)
    if nearest.left < SWAPPED_FROM or pairing.slips_to_its_command:
        return []
    controller = behind_controller(recording)
    exchanged = np.inf
    if not controller.rather_than(behind_controller(recording, output=Role.MV), OP_PLAINLY):
        exchanged = _exchanged(pairing, nearest, as_stored or recording, as_stored is not None)
    mixed_up = [(Role.OP, Role.MV, exchanged)]
    far_left = UNEXPLAINED
    if nearest.left >= DOUBTED:
        far_left = pairing.far_away()
        mixed_up += [
            (role, instead_role, _explained(recording, command, position).left / BY_ANOTHER)
            for role, instead_role, command, position in OTHERS
            if not (role is Role.MV and nearest.left <= FOLLOWS and _is_pv(recording, controller))
        ]
    role, instead_role, other = min(mixed_up, key=lambda candidate: candidate[2])
    if min(far_left.left, other) >= at_most.left and nearest.left <= UNRELATED_LEFT:
        return []
    # A valve with a slow actuator leaves much to friction alone.
    before = min(at_most.left, pairing.by_a_slow_actuator())
    if far_left.left < min(ANOTHER_TIME * nearest.left, RELATED, before, other):
        return [_clocks_apart(recording, far_left.samples)]
    if other < before:
        return [_swapped(role, instead_role)]
    return [_unrelated(before)] if min(nearest.left, before) > UNRELATED_LEFT else []


def _is_pv(recording: Recording, controller: BehindController) -> bool:
    """Whether PV is what the controller answers, and the position is not: that PV goes with OP is
    then the controller's doing."""
    return controller.rather_than(behind_controller(recording, answering=Role.MV), PV_PLAINLY)


def _exchanged(pairing: Pairing, nearest: BestShift, recording: Recording, late: bool) -> float:
    """What OP and MV of ``recording`` leave the other way round, as it compares with what is left
    as they are mapped; nothing speaks for it where the valve hardly sticks either way round.

    A position that rests while OP goes on is a stem, however late OP is; an OP that rests while the
    position goes on is one too, if the other way round explains about as much.
    """
    rests = Rests.of(pairing.evaluator.problem)
    if rests.of_position:
        return np.inf
    other = _explained(recording, Role.MV, Role.OP)
    if max(nearest.S, other.S) < STICKS_PERCENT:
        return np.inf
    simpler = SWAPPED_AND_LATE if late else SURELY_SWAPPED
    return other.left / (SWAPPED_BY_RESTS if rests.of_command else simpler)


def _explained(recording: Recording, command: Role, position: Role) -> BestShift:
    for role in (command, position):
        signal = recording.get(role)
        if signal is None or swing(signal.values) < LEAST_SWING_PERCENT:
            return UNEXPLAINED
        if np.nanmax(np.abs(signal.values)) > max(POSSIBLE_PERCENT):
            return UNEXPLAINED  # in a unit of its own
    pairing = paired(recording, command, position)
    return UNEXPLAINED if pairing is None else pairing.explained(BEFORE)


def _swapped(role: Role, instead_role: Role) -> Obstacle:
    first, second = SPOKEN[role], SPOKEN[instead_role]
    remedy = f"Check which tag is {first} and which is {second}, and map them the other way round."
    if role is Role.MV:
        return Obstacle(
            "tags_swapped",
            "PV goes with OP and the position does not: the two seem swapped, or the position is "
            "another valve's",
            f"{remedy} If they are right, look for this valve's position.",
        )
    if instead_role is Role.MV:
        return Obstacle(
            "tags_swapped",
            f"{first} and {second} seem swapped, or {first} is stored late: the position moves "
            "first, and the recording makes more sense the other way round",
            f"{remedy} If they are right, compare the times of a step in both.",
        )
    return Obstacle(
        "tags_swapped",
        f"{first} and {second} seem swapped: the recording makes sense the other way round, and "
        "not as it is mapped",
        remedy,
    )


def _clocks_apart(recording: Recording, samples: float) -> Obstacle:
    difference_text = duration(abs(samples) * recording.interval_s, recording.unit_s)
    direction = "after OP, later than a stem answers" if samples < 0.0 else "before OP"
    return Obstacle(
        "clocks_apart",
        f"the position moves about {difference_text} {direction}: their clocks differ, or one "
        "of the two was exported for another time",
        "Export OP and position for the same time from one archive, and compare a step.",
    )


def _unrelated(unexplained: float) -> Obstacle:
    return Obstacle(
        "position_unrelated",
        "neither friction nor a slow actuator explains how the position follows OP "
        f"({share(min(unexplained, 1.0))} is left): it may be another valve's",
        "Check which tag is this valve's position; step OP and see whether it answers.",
    )


def unit_obstacles(recording: Recording) -> list[Obstacle]:
    """A command or a position that is not in percent, so that they cannot be compared."""
    obstacles = []
    for signal, slug, noun in (
        (recording.op, "op_unit", "of span"),
        (recording.mv, "position_unit", "of travel"),
    ):
        other_range = None if signal is None else not_percent(signal)
        if signal is not None and other_range is not None:
            reason = (
                f"{signal.tag} {other_range}, not in percent {noun}, so OP and position cannot be "
                "compared"
            )
            obstacles.append(Obstacle(slug, reason, UNIT_REMEDY))
    return obstacles


def _still_obstacles(recording: Recording) -> list[Obstacle]:
    """A position that does not move while OP does, or by its noise only."""
    assert recording.mv is not None
    mv, op_swing = recording.mv.values, swing(recording.op.values)
    finite = mv[np.isfinite(mv)]
    if op_swing <= 2.0 or not finite.size:
        return []
    if float(np.ptp(finite)) == 0.0:
        return [
            Obstacle(
                "position_frozen",
                f"the position did not change by one digit while OP moved over {op_swing:.1f} %: "
                "either the transmitter is frozen or the stem is stuck fast",
                STUCK_REMEDY,
            )
        ]
    # A position that is sampled too slowly looks like noise as well, but goes with OP.
    if swing(mv) <= NOISE_SWING * noise_sigma(mv) and abs(correlation(recording)) < -AGAINST:
        return [
            Obstacle(
                "position_still",
                f"the position shows nothing but its noise while OP moved over {op_swing:.1f} "
                "%: either the stem is stuck fast or this is not the position of this valve",
                STUCK_REMEDY,
            )
        ]
    return []


def length_obstacles(recording: Recording, limits: Limits) -> list[Obstacle]:
    """Too few samples, too many bad ones, or too many holes between them."""
    usable = int(recording.usable.sum())
    if not len(recording):
        return [Obstacle("empty", "the recording holds no sample", "Choose another time window.")]
    obstacles = []
    least_s = limits.min_duration_s or LEAST_SAMPLES * recording.interval_s * recording.unit_s
    if recording.duration_s * recording.unit_s < least_s or usable < limits.min_samples:
        obstacles.append(_too_short(recording, usable, least_s, limits))
    bad = 1.0 - usable / max(len(recording) - int(np.sum(between_pieces(recording))), 1)
    if bad > limits.max_bad_share:
        obstacles.append(
            Obstacle(
                "bad_samples",
                f"{share(bad)} of the samples are missing or marked bad",
                "Mend the archive or the transmitter, or choose another time window.",
            )
        )
    fitted = int(np.sum(scored_samples(recording)))
    if not obstacles and fitted < limits.min_samples:
        obstacles.append(
            Obstacle(
                "broken_up",
                f"holes break the recording into pieces too short to fit: {fitted} samples are "
                f"more than {duration(WARM_UP_S, recording.unit_s)} after a hole",
                f"Export at least {limits.min_samples:.0f} samples without holes, or mend the "
                "archive.",
            )
        )
    return obstacles


def between_pieces(recording: Recording) -> Bools:
    """(n,) the samples in the holes of a recording that was put together from pieces: where nothing
    at all was recorded for longer than a fit bridges. Each piece is fitted from its own start, so
    that such samples are no fault of archive or transmitter."""
    missing = np.asarray(recording.op.quality == Quality.MISSING)
    if recording.mv is not None:
        missing = missing & (recording.mv.quality == Quality.MISSING)
    return long_runs(missing, LONGEST_BRIDGE_SAMPLES + 1)


def _too_short(recording: Recording, usable: int, least_s: float, limits: Limits) -> Obstacle:
    lasts_s, samples = recording.duration_s * recording.unit_s, f"{limits.min_samples:.0f} samples"
    if is_of_seconds(recording.unit_s):
        lasts, least = f"{lasts_s / 60:.1f} minutes", f"{samples} and {least_s / 60:.0f} minutes"
        good = "an hour at 1 s is good"
    else:
        lasts = duration(recording.duration_s, recording.unit_s)
        least = f"{samples} and {duration(least_s / recording.unit_s, recording.unit_s)}"
        good = f"{GOOD_SAMPLES} samples are good"
    return Obstacle(
        "too_short",
        f"the recording is too short: {usable} usable samples in {lasts}",
        f"Export at least {least}; {good}.",
    )


def _manual(recording: Recording) -> bool:
    mode = recording.get(Role.MODE)
    if mode is None:
        return False
    finite = mode.values[np.isfinite(mode.values)]
    return bool(finite.size and np.mean(finite == 0.0) > 0.5)


def movement_obstacles(recording: Recording, limits: Limits) -> list[Obstacle]:
    """An OP whose movement could not show a sticking stem."""
    op = recording.op.values[np.isfinite(recording.op.values)]
    op_swing = swing(op)
    # An OP that is sampled too slowly looks like noise; its turns must not be lost for that.
    threshold = max(0.1 * op_swing, min(4.0 * noise_sigma(op), 0.5 * op_swing), 0.2)
    turns = int(reversals(op, threshold).size) if op.size else 0
    manual = "the loop was in manual and " if _manual(recording) else ""
    remedy = (
        "Screen a window in which the set point moved or the load changed, or step OP by 2 to "
        "5 % a few times each way."
    )
    if op_swing < 2.0 * limits.watch_S_percent:
        reason = f"{manual}OP moved over {op_swing:.1f} % only, so a sticking stem would not show"
        return [Obstacle("manual" if manual else "op_still", reason, remedy)]
    if turns < limits.min_reversals:
        reason = f"{manual}OP turned round only {times(turns)}; stiction shows at reversals"
        return [Obstacle("manual" if manual else "few_reversals", reason, remedy)]
    per_cycle = 2.0 * op.size / turns
    if per_cycle < limits.min_samples_per_cycle:
        interval = duration(recording.interval_s, recording.unit_s, "g")
        return [
            Obstacle(
                "slow_sampling",
                f"sampling is too slow for this loop: {per_cycle:.1f} samples per cycle of OP",
                f"Record faster than every {interval}.",
            )
        ]
    return []


def record_obstacles(frozen: float, drawn_share: float, limits: Limits) -> list[Obstacle]:
    """A position that the transmitter froze or the historian drew for too long."""
    obstacles = []
    if frozen > 0.5:
        obstacles.append(
            Obstacle(
                "position_frozen",
                f"the position reading was frozen for {share(frozen)} of the time",
                "Check the position transmitter and its path to the historian.",
            )
        )
    if drawn_share > limits.max_interpolated_share:
        obstacles.append(
            Obstacle(
                "compressed",
                f"the historian compressed the position: {share(drawn_share)} of its moving "
                "samples were drawn between stored points, which hides when the stem slipped",
                "Export raw values with compression off (or its deviation below 0.1 %).",
            )
        )
    return obstacles
