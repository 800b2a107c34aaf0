"""Obstacles to a verdict on a recording, each with a remedy."""

from __future__ import annotations

import numpy as np

from stemwatch.models.limits import Limits
from stemwatch.models.preparation.own_clock import duration, is_of_seconds
from stemwatch.models.record_checks.data_quality import Obstacle
from stemwatch.models.recording import PERCENT, Bools, Quality, Recording, Role
from stemwatch.models.signals.excitation import reversals, swing
from stemwatch.models.signals.forensics import noise_sigma, quantum
from stemwatch.models.signals.percent import not_percent
from stemwatch.models.signals.runs_of_samples import long_runs
from stemwatch.models.signals.signal_pairing import (
    LONGEST_DELAY_S,
    command_is,
    copied_from,
    correlation,
    delayed_correlation,
    is_copy,
    is_limit_switch,
    moved_without_command,
    samples_exchanged,
    sums_its_command,
    to_and_fro_at_the_end,
)
from stemwatch.models.stickslip.best_pairing import Pairing
from stemwatch.models.stickslip.curve_signs import AGAINST
from stemwatch.models.stickslip.problem import LONGEST_BRIDGE_SAMPLES, WARM_UP_S, scored_samples
from stemwatch.models.stickslip.stored_range import may_be_stored_in
from stemwatch.models.verdict import NoVerdict
from stemwatch.models.words import only_times, share

# Where the plant file does not set how long a recording must last.
LEAST_SAMPLES, GOOD_SAMPLES = 300, 3600
# The range of white noise from its 1st to its 99th percentile is 4.7 standard deviations.
NOISE_SWING = 6.0
# 140 simulated valves that moved gave 0.37 and above, positions of other valves mostly below 0.3.
UNRELATED = 0.3
# Share of the position's travel; 80 simulated valves (seed 8181) make at most 0.06 of it without
# OP.
MOVED_WITHOUT_OP = 0.15
# The same while OP rests at its end, and only moves to and fro. Of OPs that are stored as they are
# none shows any, of those stored by exceptions of 1 % 0.03 at most (`draw_miswired`, 80 valves of
# seeds 5151 to 9393).
TURNED_AT_THE_END = 0.05
# Obstacles of an OP that moved too little to show a sticking stem, with or without a position.
OP_AT_REST = (NoVerdict.OP_STILL, NoVerdict.MANUAL, NoVerdict.FEW_REVERSALS)
COARSEST_PERCENT = 3.0  # steps of a position, twice the S of a sticky valve
MOSTLY_HELD = 0.5  # of the unusable samples
MAP_POSITION = "Map the tag of the stem position (ZT, POS, positioner feedback)."
STUCK_REMEDY = "Look at the valve: a stroke test tells a stuck stem from a dead transmitter."
UNCHANGED = "the position did not change by one digit"
ONLY_NOISE = "the position shows nothing but its noise"
FROZEN_FOR = "the position reading was frozen for"
UNIT_REMEDY = "Give its values at 0 % and 100 % (low, high) so that it can be read as percent."


def position_obstacles(recording: Recording) -> list[Obstacle]:
    """No position, or one that is not the stem's."""
    if recording.mv is None:
        return [
            Obstacle(
                NoVerdict.NO_POSITION,
                "there is no valve position in this recording, and what OP and PV alone say "
                "is no verdict",
                "Record the position (positioner feedback, position transmitter), or do a "
                "stroke test: step OP by 1 % up and down and watch the stem.",
            )
        ]
    return (
        _copy_obstacles(recording) or _still_obstacles(recording) or _content_obstacles(recording)
    )


def _copy_obstacles(recording: Recording) -> list[Obstacle]:
    """A position that is a copy of another tag."""
    assert recording.mv is not None
    tag = recording.mv.tag
    if is_copy(recording):
        return [
            Obstacle(
                NoVerdict.POSITION_IS_OP,
                f"the position tag {tag} repeats OP sample for sample: it is the "
                "controller output under another name",
                MAP_POSITION,
            )
        ]
    source = copied_from(recording)
    if source is Role.OP:
        return [
            Obstacle(
                NoVerdict.POSITION_IS_OP,
                f"the position tag {tag} is computed from OP (on another scale, late or filtered), "
                "without the noise that every measured stem has",
                MAP_POSITION,
            )
        ]
    if source is not None:
        return [
            Obstacle(
                NoVerdict.POSITION_IS_PV if source is Role.PV else NoVerdict.POSITION_IS_SP,
                f"the position tag {tag} repeats {source.value.upper()}, so it is not the stem's",
                MAP_POSITION,
            )
        ]
    command = command_is(recording)
    if command is not None:
        return [
            Obstacle(
                NoVerdict.OP_IS_PV if command is Role.PV else NoVerdict.OP_IS_SP,
                f"the tag of OP, {recording.op.tag}, repeats {command.value.upper()}, so it is not "
                "the controller output",
                "Map the tag of the controller output (OP, OUT, CO).",
            )
        ]
    return []


def _content_obstacles(recording: Recording) -> list[Obstacle]:
    """A position that holds end positions, steps or another signal's samples instead of the stem's
    travel.
    """
    assert recording.mv is not None
    mv = recording.mv
    if is_limit_switch(recording):
        values = np.unique(mv.values[mv.usable])
        seen = " and ".join(f"{value:g}" for value in values)
        return [
            Obstacle(
                NoVerdict.POSITION_SWITCH,
                f"the position tag {mv.tag} knows only the values {seen}: it is a limit switch or "
                "a state, not a position",
                MAP_POSITION,
            )
        ]
    if samples_exchanged(recording):
        return [
            Obstacle(
                NoVerdict.SAMPLES_EXCHANGED,
                "OP and position change places from sample to sample",
                "Export the two tags again, each by itself, and compare.",
            )
        ]
    step = quantum(mv.values)
    if mv.unit == PERCENT and step > COARSEST_PERCENT:
        return [
            Obstacle(
                NoVerdict.POSITION_COARSE,
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
            NoVerdict.POSITION_REVERSED,
            f"the position falls when OP rises (correlation {correlated:.2f}), and no curve "
            "from OP to stroke follows it",
            "Check which tag is this valve's position; if it counts the other way, give its values "
            "at 0 % and 100 % of OP (low, high) the other way round.",
        )
    ]


def related(recording: Recording) -> float:
    """The correlation of the position with OP, -1 to 1, with a delay or with the sign reversed: a
    reversed position is related all the same.
    """
    return max(delayed_correlation(recording), -correlation(recording))


def foreign_obstacles(recording: Recording) -> list[Obstacle]:
    """A position that is not correlated with OP: a fit would call it sticking."""
    if sums_its_command(recording):
        return [
            Obstacle(
                NoVerdict.POSITION_SUMS_OP,
                "the position moves as fast as OP says, wherever it is: OP is a speed, a force or "
                "the pulses of an electric actuator, and not the position that the valve is told",
                "Check that OP is what this valve is told: map the position that its positioner or "
                "drive is given.",
            )
        ]
    moves_alone, turns_alone = moved_without_command(recording), to_and_fro_at_the_end(recording)
    if moves_alone > MOVED_WITHOUT_OP or turns_alone > TURNED_AT_THE_END:
        where = f"{share(moves_alone)} of its way while OP stands still"
        if moves_alone <= MOVED_WITHOUT_OP:
            where = f"{share(turns_alone)} of its way to and fro while OP stands at its end"
        return [
            Obstacle(
                NoVerdict.OP_NOT_FOLLOWED,
                f"the position makes {where}: something else moves this valve",
                "Map the output that goes to this valve: not that of a manual station that does "
                "not track, nor of the other valve of a split range.",
            )
        ]
    correlated = related(recording)
    if correlated >= UNRELATED or swing(recording.op.values) <= 2.0:
        return []
    pairing = Pairing.of(recording)
    if pairing is not None and pairing.has_top_speed:
        return []  # too slow to be correlated
    unit_s = recording.unit_s
    later = "two minutes" if is_of_seconds(unit_s) else duration(LONGEST_DELAY_S, unit_s)
    return [
        Obstacle(
            NoVerdict.POSITION_UNRELATED,
            f"the position does not go with OP (correlation {max(correlated, 0.0):.2f} at best, up "
            f"to {later} later): it may be another valve's",
            "Check which tag is this valve's position; step OP and see whether it answers.",
        )
    ]


def unit_obstacles(recording: Recording) -> list[Obstacle]:
    """A command or a position that is not in percent, so that they cannot be compared."""
    obstacles = []
    for signal, slug, noun in (
        (recording.op, NoVerdict.OP_UNIT, "of span"),
        (recording.mv, NoVerdict.POSITION_UNIT, "of travel"),
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
                NoVerdict.POSITION_FROZEN,
                f"{UNCHANGED} while OP moved over {op_swing:.1f} %: "
                "either the transmitter is frozen or the stem is stuck fast",
                STUCK_REMEDY,
            )
        ]
    # A position that is sampled too slowly looks like noise as well, but is correlated with OP.
    if swing(mv) <= NOISE_SWING * noise_sigma(mv) and abs(correlation(recording)) < -AGAINST:
        return [
            Obstacle(
                NoVerdict.POSITION_STILL,
                f"{ONLY_NOISE} while OP moved over {op_swing:.1f} %: "
                "either the stem is stuck fast or this is not the position of this valve",
                STUCK_REMEDY,
            )
        ]
    return []


def _many_bad(recording: Recording, bad: float) -> Obstacle:
    """A share ``bad`` of unusable samples; of an archive that compresses, most repeat an older
    value, and nothing is broken."""
    held = recording.op.quality == Quality.HELD
    if recording.mv is not None:
        held = held | (recording.mv.quality == Quality.HELD)
    if float(np.mean(held)) < MOSTLY_HELD * bad:
        return Obstacle(
            NoVerdict.BAD_SAMPLES,
            f"{share(bad)} of the samples are missing or marked bad",
            "Repair the archive or the transmitter, or choose another time window.",
        )
    return Obstacle(
        NoVerdict.BAD_SAMPLES,
        f"{share(bad)} of the samples are missing or repeat an older value: OP or position is "
        "stored at uneven times only, as by an archive that compresses",
        "Have OP and position archived at even times, without compression, and screen it again.",
    )


def length_obstacles(recording: Recording, limits: Limits) -> list[Obstacle]:
    """Too few samples, too many bad ones, or too many holes between them."""
    usable = int(recording.usable.sum())
    if not len(recording):
        choose = "Choose another time window."
        return [Obstacle(NoVerdict.EMPTY, "the recording holds no sample", choose)]
    obstacles = []
    least_s = limits.min_duration_s or LEAST_SAMPLES * recording.interval_s * recording.unit_s
    if recording.duration_s * recording.unit_s < least_s or usable < limits.min_samples:
        obstacles.append(_too_short(recording, usable, least_s, limits))
    bad = 1.0 - usable / max(len(recording) - int(np.sum(between_pieces(recording))), 1)
    if bad > limits.max_bad_share:
        obstacles.append(_many_bad(recording, bad))
    fitted = int(np.sum(scored_samples(recording)))
    if not obstacles and fitted < limits.min_samples:
        obstacles.append(
            Obstacle(
                NoVerdict.BROKEN_UP,
                f"holes break the recording into pieces too short to fit: {fitted} samples are "
                f"more than {duration(WARM_UP_S, recording.unit_s)} after a hole",
                f"Export at least {limits.min_samples:.0f} samples without holes, or repair "
                "the archive.",
            )
        )
    return obstacles


def between_pieces(recording: Recording) -> Bools:
    """(n,) the samples in the holes of a recording that was joined from pieces: where nothing at
    all was recorded for longer than a fit bridges. Each piece is fitted from its own start, and
    these samples do not count as bad.
    """
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
        NoVerdict.TOO_SHORT,
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
    # An OP that is sampled too slowly looks like noise; its reversals must count all the same.
    threshold = max(0.1 * op_swing, min(4.0 * noise_sigma(op), 0.5 * op_swing), 0.2)
    turns = int(reversals(op, threshold).size) if op.size else 0
    manual = "the loop was in manual and " if _manual(recording) else ""
    remedy = (
        "Screen a window in which the set point moved or the load changed, or step OP by 2 to "
        "5 % a few times each way."
    )
    if op_swing < 2.0 * limits.watch_S_percent:
        reason = f"{manual}OP moved over {op_swing:.1f} % only, so a sticking stem would not show"
        stored = may_be_stored_in(recording.op)
        if stored is not None and stored.times * op_swing >= 2.0 * limits.watch_S_percent:
            in_range = f"{stored.low:g} to {stored.high:g}{f' {stored.unit}'.rstrip()}"
            reason += (
                f"; it stays within {in_range}, and if it is stored so it moved over "
                f"{stored.times * op_swing:.0f} %"
            )
            remedy = (
                f"Check whether OP is in percent. If it is stored as {in_range}, give low = "
                f"{stored.low:g}, high = {stored.high:g} for it in the plant file, and the range "
                f"of the position likewise. If it is in percent: {remedy}"
            )
        kind = NoVerdict.MANUAL if manual else NoVerdict.OP_STILL
        return [Obstacle(kind, reason, remedy)]
    if turns < limits.min_reversals:
        how_often = f"turned round {only_times(turns)}" if turns else "never turned round"
        reason = f"{manual}OP {how_often}; stiction shows at reversals"
        kind = NoVerdict.MANUAL if manual else NoVerdict.FEW_REVERSALS
        return [Obstacle(kind, reason, remedy)]
    per_cycle = 2.0 * op.size / turns
    if per_cycle < limits.min_samples_per_cycle:
        interval = duration(recording.interval_s, recording.unit_s, "g")
        return [
            Obstacle(
                NoVerdict.SLOW_SAMPLING,
                f"sampling is too slow for this loop: {per_cycle:.1f} samples per cycle of OP",
                f"Record faster than every {interval}.",
            )
        ]
    return []


def record_obstacles(frozen: float, drawn_share: float, limits: Limits) -> list[Obstacle]:
    """A position that the transmitter froze or the historian interpolated for too long."""
    obstacles = []
    if frozen > limits.max_bad_share:
        obstacles.append(
            Obstacle(
                NoVerdict.POSITION_FROZEN,
                f"{FROZEN_FOR} {share(frozen)} of the time",
                "Check the position transmitter and its path to the historian.",
            )
        )
    if drawn_share > limits.max_interpolated_share:
        obstacles.append(
            Obstacle(
                NoVerdict.COMPRESSED,
                f"the historian compressed the position: {share(drawn_share)} of its moving "
                "samples were drawn between stored points, which hides when the stem slipped",
                "Export raw values with compression off (or its deviation below 0.1 %).",
            )
        )
    return obstacles
