"""Mixed-up tags, or clocks that are minutes apart: what else explains the position.

Which command a position follows is decided from the fit of a sticking stem
(``stickslip.best_pairing``), from the rests of the stem (``rests``), from the controller's law
(``clock_shift``), and from what PV answers (``pv_answers``).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stemwatch.models.preparation.own_clock import duration
from stemwatch.models.record_checks.data_quality import Obstacle
from stemwatch.models.record_checks.pv_answers import STICKS_PERCENT as STICKS_SO_THAT_PV_TELLS
from stemwatch.models.record_checks.pv_answers import PvAnswers
from stemwatch.models.recording import Recording, Role, Signal
from stemwatch.models.signals.excitation import swing
from stemwatch.models.signals.forensics import quantum
from stemwatch.models.signals.percent import POSSIBLE_PERCENT
from stemwatch.models.stickslip.best_pairing import AFTER, BEFORE, BestShift, Pairing, paired
from stemwatch.models.stickslip.clock_shift import BehindController, behind_controller
from stemwatch.models.stickslip.first_look import FirstLook
from stemwatch.models.stickslip.rests import Rests
from stemwatch.models.verdict import NoVerdict
from stemwatch.models.words import share

# Share of the loss of a stem that never moves (``best_pairing``). `stemwatch calibrate-wiring`
# derives these and the next limits from recordings whose tags are right. 93 simulated valves that
# moved, with and without hidden effects (seeds 5151 and 8181), leave 0.03 to 0.81, 0.49 at most
# without effects and 0.25 in the middle; a command of another time leaves them 1.03 times as much
# and more, OP read as the position 0.35 times (a valve with a rough force on its stem, which 0.3
# keeps out), PV or SP in the place of OP or position 0.5 times.
DOUBTED, RELATED, UNRELATED_LEFT = 0.3, 0.7, 0.85
ANOTHER_TIME, BY_ANOTHER = 0.85, 0.5
# A minute's delay in a loop that moves slowly looks like a large S, which leaves less than 0.3: a
# healthy valve (`miswiring`, seed 2098, number 7) leaves 0.28, and 0.01 at its own time. From 0.1
# on another time is believed where it leaves so little of what friction and a slow actuator leave.
FOLLOWS_ENOUGH, PLAINLY_ANOTHER_TIME = 0.1, 0.5
# A valve that hardly sticks agrees with its command either way round, and is healthy either way.
# Either way round, S of 76 sticking ones is 2.1 % and more, of 92 healthy ones 1.6 % and less, of
# all but two 1.5 % (`draw_valves`, seeds 6161, 8383, 9393; `draw_sticky`, `draw_healthy`, 5151).
SURELY_SWAPPED, STICKS_PERCENT = 0.5, 1.5
# A command that seems stored late may be the position: then a slightly smaller loss the other way
# round is enough.
SWAPPED_AND_LATE = 0.9
# Where OP rests as a stem does (``rests``), the loss the other way round may even be larger.
SWAPPED_BY_RESTS = 1.5
# The controller's law confirms OP (or PV) where it leaves so many times less of OP's moves than it
# would with the position in the place of OP (or of PV). Where the two are exchanged it is the other
# way round. This is not checked where the position follows OP so badly that it may be another
# valve's.
OP_PLAINLY, PV_PLAINLY, FOLLOWS = 3.0, 10.0, 0.5
# The law fits the position better than an OP in coarse steps, too: of five simulated loops by up to
# 6 times in steps of 1 %, and by up to 2 in steps of 0.5 %.
FINEST_STEP_TOLD = 0.25  # percent of OP
LEAST_LEAD = 1.0  # samples by which the position moves first, from which this is said
LEAST_SWING_PERCENT = 0.5
# Which is exchanged for which, and what then is the command and what the position.
OTHERS = (
    (Role.OP, Role.PV, Role.PV, Role.MV),
    (Role.MV, Role.PV, Role.OP, Role.PV),
    (Role.OP, Role.SP, Role.SP, Role.MV),
)
# Samples by which a PV comes after the position that it answers.
ANSWERS = (1.0, 3.0, 5.0, 8.0, 12.0, 20.0)
UNEXPLAINED = BestShift(np.inf, 0.0)
SPOKEN = {Role.OP: "OP", Role.MV: "the position", Role.PV: "PV", Role.SP: "SP"}


@dataclass(frozen=True)
class WiringEvidence:
    """How well the position follows its command, and how well other signals explain it; each is
    computed only when needed. ``as_stored`` is the recording before an OP that seemed late was
    shifted.
    """

    recording: Recording
    as_stored: Recording | None
    pairing: Pairing

    @classmethod
    def of(
        cls,
        recording: Recording,
        as_stored: Recording | None = None,
        first_look: FirstLook | None = None,
    ) -> WiringEvidence | None:
        """The evidence from a recording, with arguments as in ``wiring_obstacles``; ``None`` where
        OP or position hardly moves.
        """
        pairing = Pairing.of(recording, first_look)
        return None if pairing is None else cls(recording, as_stored, pairing)

    @cached_property
    def at_once(self) -> float:
        """Share of the loss of a stem that never moves which OP at its own time leaves."""
        return self.pairing.explained(BEFORE[:1]).left

    @cached_property
    def at_most(self) -> BestShift:
        """OP at its own time or a few samples before: no stem moves first."""
        return self.pairing.explained(BEFORE)

    @cached_property
    def nearest(self) -> BestShift:
        """``at_most``, or OP a few samples after."""
        return min(self.at_most, self.pairing.explained(AFTER), key=lambda shift: shift.left)

    @cached_property
    def far_away(self) -> BestShift:
        """OP many samples earlier or later, as of clocks that differ or of another time."""
        return self.pairing.far_away()

    @cached_property
    def as_mapped(self) -> float:
        """Share of the loss that is left with the tags as mapped, by friction or by a slow
        actuator.
        """
        return min(self.at_most.left, self.pairing.by_a_slow_actuator())

    @property
    def left_now(self) -> float:
        """``as_mapped``, or what OP a few samples off leaves."""
        return min(self.nearest.left, self.as_mapped)

    @property
    def plainly_at_another_time(self) -> bool:
        """Whether OP many samples earlier or later leaves less than half of what friction or a slow
        actuator leaves at OP's own time, and the slips do not show that the clocks agree.
        """
        if self.nearest.left < FOLLOWS_ENOUGH or self.pairing.slips_to_its_command:
            return False
        return self.far_away.left < PLAINLY_ANOTHER_TIME * self.left_now

    @cached_property
    def controller(self) -> BehindController:
        """How late OP answers PV and set point."""
        return behind_controller(self.recording)

    @cached_property
    def op_plainly(self) -> bool:
        """Whether OP follows the controller's law, and the position does not."""
        as_position = behind_controller(self.recording, output=Role.MV)
        return self.controller.rather_than(as_position, OP_PLAINLY)

    @cached_property
    def pv_plainly(self) -> bool:
        """Whether the controller answers PV, and not the position: PV is then correlated with OP
        because of the controller. Checked only for a position that follows OP.
        """
        if self.nearest.left > FOLLOWS:
            return False
        as_pv = behind_controller(self.recording, answering=Role.MV)
        return self.controller.rather_than(as_pv, PV_PLAINLY)

    @property
    def far_off_at_a_top_speed(self) -> bool:
        """Whether the position follows OP, too slowly for friction to explain half of it. A PV that
        follows OP as well is near it.
        """
        return self.nearest.left > FOLLOWS and self.pairing.has_top_speed

    @cached_property
    def pv_answers(self) -> PvAnswers:
        """Whether PV answers the position or OP alone, with the clocks as they were stored."""
        return PvAnswers.of(self.as_stored or self.recording)

    @property
    def of_another_loop(self) -> bool:
        """Whether the position seems to stick, follows OP no better than another valve's does, and
        PV answers OP and not where the position is. Beside loads that move the loop as much as the
        set point does, OP alone tells much of PV with the valve's own position as well.
        """
        sticks = self.at_most.S >= STICKS_SO_THAT_PV_TELLS
        return sticks and self.at_most.left >= DOUBTED and self.pv_answers.of_op_only

    @cached_property
    def rests(self) -> Rests:
        """Which of OP and position rests while the other goes on."""
        return Rests.of(self.pairing.evaluator.problem)

    @cached_property
    def exchanged(self) -> BestShift:
        """OP and position the other way round, as they were stored."""
        return _explained(self.as_stored or self.recording, Role.MV, Role.OP)

    @property
    def simpler(self) -> float:
        """The ratio to ``as_mapped`` that OP and position exchanged may leave at most."""
        if self.rests.of_command:
            return SWAPPED_BY_RESTS
        return SURELY_SWAPPED if self.as_stored is None else SWAPPED_AND_LATE

    @cached_property
    def position_is_plainly_the_output(self) -> bool:
        """Whether the position follows the controller's law and OP does not, and OP follows the
        position as well as the position follows OP: the two are exchanged, even where the valve
        does not stick. Asked of the clocks as they were stored.
        """
        stored = self.as_stored or self.recording
        if quantum(stored.op.values[stored.op.usable]) > FINEST_STEP_TOLD:
            return False
        as_position = behind_controller(stored, output=Role.MV)
        if not as_position.rather_than(behind_controller(stored), OP_PLAINLY):
            return False
        return self.exchanged.left <= self.at_most.left

    @property
    def perhaps_exchanged(self) -> bool:
        """Whether an OP that was stored late may as well be the position: the controller does not
        tell, no stem is seen to rest, and OP follows the position about as well.
        """
        if self.as_stored is None or self.op_plainly or self.rests.of_position:
            return False
        return self.exchanged.left <= SWAPPED_BY_RESTS * self.at_most.left

    @property
    def sticks_either_way(self) -> float:
        """The larger S of both ways round, percent."""
        return max(self.nearest.S, self.exchanged.S)

    @property
    def swapped(self) -> float:
        """The ratio of the loss with OP and position exchanged to that as mapped. There is no case
        for an exchange where OP follows the controller's law, where the position rests as a stem
        does, or where the valve hardly sticks either way round.
        """
        if self.op_plainly or self.rests.of_position or self.sticks_either_way < STICKS_PERCENT:
            return np.inf
        return self.exchanged.left / self.simpler

    @cached_property
    def by_another(self) -> list[tuple[Role, Role, float]]:
        """What is left with PV or SP in the place of OP or the position."""
        return [
            (role, instead_role, _explained(self.recording, command, position).left)
            for role, instead_role, command, position in OTHERS
            if not (role is Role.MV and self.pv_plainly) and self._may_be_output(command)
        ]

    def _may_be_output(self, role: Role) -> bool:
        """Whether a signal may be the controller's output that was mapped as ``role``. A PV that
        tells more of the position some samples later answers the position; and what a person sets
        changes less often than a controller's output.
        """
        signal = self.recording.get(role)
        if role is Role.OP or signal is None:
            return True
        if role is Role.SP:
            return _changes(signal) >= _changes(self.recording.op)
        pairing = paired(self.recording, role, Role.MV)
        if pairing is None:
            return True
        return pairing.explained(BEFORE).left <= pairing.explained(ANSWERS).left


def wiring_obstacles(
    recording: Recording, as_stored: Recording | None = None, first_look: FirstLook | None = None
) -> list[Obstacle]:
    """Mixed-up tags, or clocks that are minutes apart: what else explains the position.

    ``recording`` in percent of travel, read through its curve; ``as_stored`` the recording before
    an OP that seemed late was shifted; ``first_look`` saves time where it has been made already.
    """
    seen = WiringEvidence.of(recording, as_stored, first_look)
    if seen is None:
        return []
    if seen.position_is_plainly_the_output:
        return [_exchanged()]
    obstacles = _otherwise_explained(recording, seen)
    if not obstacles and seen.of_another_loop:
        return [_not_answered(seen.pv_answers)]
    return obstacles


def perhaps_exchanged(
    recording: Recording, as_stored: Recording, late_s: float, first_look: FirstLook | None = None
) -> bool:
    """Whether an OP that was brought forward by ``late_s`` in ``recording`` may be the position,
    and the position OP: a stem that answers late looks so. ``as_stored`` is the recording before.
    """
    if late_s < LEAST_LEAD * as_stored.interval_s:
        return False
    seen = WiringEvidence.of(recording, as_stored, first_look)
    return seen is not None and seen.perhaps_exchanged


def _otherwise_explained(recording: Recording, seen: WiringEvidence) -> list[Obstacle]:
    """Where the position follows OP badly: what explains it better, or that nothing does."""
    # Most valves need no further check.
    if seen.at_once < FOLLOWS_ENOUGH:
        return []
    if seen.at_once < DOUBTED or seen.nearest.left < DOUBTED:
        apart = seen.plainly_at_another_time
        return [_clocks_apart(recording, seen.far_away.samples)] if apart else []
    if seen.pairing.slips_to_its_command or seen.far_off_at_a_top_speed:
        return []
    far = seen.far_away
    mixed_up = [(Role.OP, Role.MV, seen.swapped)]
    mixed_up += [(role, other, left / BY_ANOTHER) for role, other, left in seen.by_another]
    role, instead_role, other = min(mixed_up, key=lambda candidate: candidate[2])
    at_most, nearest = seen.at_most.left, seen.nearest.left
    if min(far.left, other) >= at_most and nearest <= UNRELATED_LEFT:
        return []
    # With a slow actuator, friction alone leaves much of the loss.
    before = seen.as_mapped
    if far.left < min(ANOTHER_TIME * nearest, RELATED, before, other):
        return [_clocks_apart(recording, far.samples)]
    if other < before:
        return [_swapped(role, instead_role)]
    return [_unrelated(before)] if seen.left_now > UNRELATED_LEFT else []


def _explained(recording: Recording, command: Role, position: Role) -> BestShift:
    for role in (command, position):
        signal = recording.get(role)
        if signal is None or swing(signal.values) < LEAST_SWING_PERCENT:
            return UNEXPLAINED
        if np.nanmax(np.abs(signal.values)) > max(POSSIBLE_PERCENT):
            return UNEXPLAINED  # in a unit of its own
    pairing = paired(recording, command, position)
    return UNEXPLAINED if pairing is None else pairing.explained(BEFORE)


def _changes(signal: Signal) -> int:
    """How often the stored value of a signal changes from one sample to the next."""
    return int(np.count_nonzero(np.diff(signal.values[signal.usable])))


def _swapped(role: Role, instead_role: Role) -> Obstacle:
    first, second = SPOKEN[role], SPOKEN[instead_role]
    remedy = f"Check which tag is {first} and which is {second}, and map them the other way round."
    if role is Role.MV:
        return Obstacle(
            NoVerdict.TAGS_SWAPPED,
            "PV goes with OP and the position does not: the two seem swapped, or the position is "
            "another valve's",
            f"{remedy} If they are right, look for this valve's position.",
        )
    if instead_role is Role.MV:
        return Obstacle(
            NoVerdict.TAGS_SWAPPED,
            f"{first} and {second} seem swapped, or {first} is stored late: the position moves "
            "first, and the recording makes more sense the other way round",
            f"{remedy} If they are right, compare the times of a step in both.",
        )
    return Obstacle(
        NoVerdict.TAGS_SWAPPED,
        f"{first} and {second} seem swapped: the recording makes sense the other way round, and "
        "not as it is mapped",
        remedy,
    )


def _exchanged() -> Obstacle:
    return Obstacle(
        NoVerdict.TAGS_SWAPPED,
        "OP and the position seem swapped: it is the position that answers PV and set point as a "
        "controller's output does, and OP follows it",
        "Check which tag is OP and which is the position, and map them the other way round.",
    )


def _clocks_apart(recording: Recording, samples: float) -> Obstacle:
    difference_text = duration(abs(samples) * recording.interval_s, recording.unit_s)
    direction = "after OP, later than a stem answers" if samples < 0.0 else "before OP"
    return Obstacle(
        NoVerdict.CLOCKS_APART,
        f"the position moves about {difference_text} {direction}: their clocks differ, or one "
        "of the two was exported for another time",
        "Export OP and position for the same time from one archive, and compare a step.",
    )


def _not_answered(answers: PvAnswers) -> Obstacle:
    return Obstacle(
        NoVerdict.POSITION_UNANSWERED,
        f"PV answers OP, and not where the position is: of what the two tell of PV, OP alone tells "
        f"{share(min(answers.op_alone, 1.0))}. The position may be that of another valve with the "
        "same set points",
        "Check which tag is this valve's position; step OP and see whether it answers.",
    )


def _unrelated(unexplained: float) -> Obstacle:
    return Obstacle(
        NoVerdict.POSITION_UNRELATED,
        "neither friction nor a slow actuator explains how the position follows OP "
        f"({share(min(unexplained, 1.0))} is left): it may be another valve's",
        "Check which tag is this valve's position; step OP and see whether it answers.",
    )
