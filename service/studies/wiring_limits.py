"""The limits of the wiring checks, on recordings whose tags are right and on others.

Valves of `miswiring` (routine loops and loops of all kinds), with and without hidden effects, are
wired up rightly and stored in several ways, whole and in pieces: the nulls, none of which may meet
all limits of a check. Mixed up as `miswiring` does, the same valves show how many lie beyond.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from stemwatch.models.preparation.own_clock import on_own_clock
from stemwatch.models.record_checks import pv_answers, validity_checks, wiring_checks
from stemwatch.models.record_checks.validity_checks import related
from stemwatch.models.record_checks.wiring_checks import WiringEvidence
from stemwatch.models.recording import Floats, Recording, Role, Signal
from stemwatch.models.signals import signal_pairing
from stemwatch.models.signals.excitation import swing
from stemwatch.models.signals.signal_pairing import (
    copied_share,
    lag_one_correlation,
    moved_without_command,
    summed_command,
    to_and_fro_at_the_end,
)
from stemwatch.models.stickslip import stored_range
from stemwatch.models.stickslip.clock_shift import brought_forward, late_evidence
from stemwatch.models.stickslip.stored_range import fitting_ranges, in_percent
from stemwatch.models.studies.simulator import simulate_loop
from stemwatch.models.studies.simulator.hidden import draw_hidden
from stemwatch.service.executors import Executor, results_in_order
from stemwatch.service.studies.limit_beside_nulls import (
    JointCondition,
    Limit,
    Tested,
    every_second_piece,
)
from stemwatch.service.studies.miswiring import (
    AS_IT_IS,
    KINDS,
    MiswiredValve,
    draw_miswired,
    record,
)
from stemwatch.service.studies.robustness import WAYS

MAY_PASS = 0.0  # of the nulls: no valve that is wired up rightly may lose its verdict by a check
PIECE_SAMPLES = 900
NO_OTHER = 100.0  # percent off OP, of a range that does not fit at all
CURVES = tuple(way for way, stored in WAYS.items() if stored.strokes)
STORED = ("OP stored 5 s late", "position stored 5 s late", "stored every 5 s", "averages of 10 s")
HIDDEN, PIECE = "with hidden effects", "fifteen minutes"
OF_ANOTHER = ("MV of another loop", "OP of another loop", "OP of the cascade's master")
FOR_ANOTHER = ("PV for OP", "PV for MV", "SP for OP", "SP for MV")
APART = ("MV 60 s late", "MV 60 s early", "MV 300 s late", "MV 300 s early")
SAME_POINTS = "MV of another loop with the same set points"
SPLIT = "OP of the split range's other valve"
SWAPPED, MANUAL = "OP and MV swapped", "OP of a manual station that does not track"
EXCHANGED, COPY = "every second sample of OP and MV exchanged", "MV a copy of OP, rounded to 0.1"
RANGES = (
    "MV in mA, 4 to 20",
    "MV a fraction, 0 to 1",
    "OP in mA, 4 to 20",
    "OP a fraction, 0 to 1",
)
SPEED, SPEED_OVER, SPEED_PERCENT = "OP a speed", 10, 20.0  # samples; standard deviation
MIXED_UP = (
    *OF_ANOTHER,
    *FOR_ANOTHER,
    *APART,
    SWAPPED,
    MANUAL,
    EXCHANGED,
    COPY,
    *RANGES,
    SAME_POINTS,
    SPLIT,
)


@dataclass(frozen=True)
class WiringShown:
    """The values of the wiring checks on one recording; NaN where a check does not apply, or where
    a curve from OP to stroke would be sought first.

    ``left`` is what OP leaves of the loss of a stem that never moves, the others what something
    else leaves as a share of what is left as it is mapped; ``told`` where its slips show that the
    stem is this command's.
    """

    way: str
    rightly: bool
    related: float
    moved_alone: float
    turned_alone: float
    neighbours: float
    copied: float
    summed: float
    towards_command: float
    range_off: float
    range_margin: float
    told: bool
    left: float
    exchanged: float
    sticks: float
    sticks_here: float
    op_alone: float
    op_evident: float
    of_position: bool
    op_plainly: bool
    another: float
    far: float
    far_left: float
    as_mapped: float

    @property
    def then_of_now(self) -> float:
        """What OP at another time leaves, of what friction or a slow actuator leaves now."""
        return self.far_left / self.as_mapped if self.as_mapped else np.nan


def shown(way: str, rightly: bool, recording: Recording) -> WiringShown:
    """The values of the checks on a ``recording``, stored in the way ``way``."""
    offsets = [offset for offset, _, _ in fitting_ranges(recording)]
    recording = on_own_clock(in_percent(recording))
    summed = summed_command(recording)
    late = late_evidence(recording).late_s(recording.interval_s)
    as_stored = recording if late else None
    seen = None
    if way not in CURVES:
        seen = WiringEvidence.of(brought_forward(recording, late), as_stored)
    numbers = dict.fromkeys(
        (
            *("left", "exchanged", "sticks", "sticks_here", "op_alone", "op_evident"),
            *("another", "far", "far_left", "as_mapped"),
        ),
        np.nan,
    )
    if seen is not None:
        others = [left for _, _, left in seen.by_another]
        numbers = {
            "left": seen.nearest.left,
            "exchanged": seen.exchanged.left / seen.as_mapped / _times_simpler(seen),
            "sticks": seen.sticks_either_way,
            "sticks_here": seen.at_most.S,
            "op_alone": seen.pv_answers.op_alone,
            "op_evident": seen.pv_answers.evident,
            "another": min(others, default=np.inf) / seen.as_mapped,
            "far": seen.far_away.left / seen.nearest.left,
            "far_left": seen.far_away.left,
            "as_mapped": seen.left_now,
        }
    return WiringShown(
        way=way,
        rightly=rightly,
        related=related(recording) if swing(recording.op.values) > 2.0 else np.nan,
        moved_alone=moved_without_command(recording),
        turned_alone=to_and_fro_at_the_end(recording),
        neighbours=lag_one_correlation(recording),
        copied=copied_share(recording),
        summed=summed.explained,
        towards_command=summed.towards_command,
        range_off=offsets[0] if offsets else np.nan,
        range_margin=[*offsets, NO_OTHER][1] - offsets[0] if offsets else np.nan,
        told=seen is not None and seen.pairing.slips_to_its_command,
        of_position=seen is not None and seen.rests.of_position,
        op_plainly=seen is not None and seen.op_plainly,
        **numbers,
    )


def _times_simpler(seen: WiringEvidence) -> float:
    """By how much more may be left than where nothing speaks for an exchange."""
    return seen.simpler / wiring_checks.SURELY_SWAPPED


def shown_by_valve(valve: MiswiredValve | Recording) -> list[WiringShown]:
    """A valve rightly wired and stored in several ways, in pieces, and mixed up; one with hidden
    effects as it is."""
    if isinstance(valve, Recording):
        return [shown(HIDDEN, True, valve)]
    recorded = record(valve)
    recording = recorded.recording
    rightly = [(AS_IT_IS, recording)]
    rightly += [(way, WAYS[way].change(recording)) for way in (*STORED, *CURVES)]
    rightly += [(PIECE, piece) for piece in every_second_piece(recording, PIECE_SAMPLES)]
    mixed_up = [(kind, KINDS[kind](recorded)) for kind in MIXED_UP]
    mixed_up.append((SPEED, _speed_for_op(recording)))
    return [
        *(shown(way, True, stored) for way, stored in rightly),
        *(shown(way, False, wired) for way, wired in mixed_up),
    ]


def _speed_for_op(recording: Recording) -> Recording:
    """The position with its speed, as a mean over some samples, in the place of OP."""
    assert recording.mv is not None
    speed: Floats = np.gradient(
        np.convolve(recording.mv.values, np.full(SPEED_OVER, 1.0 / SPEED_OVER), mode="same")
    )
    speed = 50.0 + SPEED_PERCENT * np.clip(speed / max(float(speed.std()), 1e-9), -2.0, 2.0)
    signal = Signal.good(speed, recording.op.tag, recording.op.unit)
    return replace(recording, signals={**recording.signals, Role.OP: signal})


def run_wiring_limits(
    valves: int, seed: int, executor: Executor, on_progress: Callable[[int], None]
) -> list[WiringShown]:
    """``valves`` of `miswiring` in all ways, and as many with hidden effects as they are."""
    items: list[MiswiredValve | Recording] = [*draw_miswired(valves, seed)]
    items += [simulate_loop(case.loop, case.seed).recording for case in draw_hidden(valves, seed)]
    return list(chain(*results_in_order(executor, shown_by_valve, items, on_progress)))


def _checks_of_signals() -> Sequence[tuple[str, tuple[str, ...], list[JointCondition]]]:
    """Name, kinds it is there for, and limits of each check that is asked of every recording."""
    v, p, r = validity_checks, signal_pairing, stored_range
    least, most = p.TOWARDS_COMMAND
    return (
        ("a copy", (COPY,), [JointCondition("share", "copied", p.COPIED_SHARE)]),
        (
            "samples exchanged",
            (EXCHANGED,),
            [JointCondition("neighbours", "neighbours", p.EXCHANGED, above=False)],
        ),
        (
            "moves as fast as OP says",
            (SPEED,),
            [
                JointCondition("explained", "summed", p.SUMMED),
                JointCondition("towards OP, least", "towards_command", least),
                JointCondition("towards OP, most", "towards_command", most, above=False),
            ],
        ),
        (
            "moves alone",
            (MANUAL,),
            [JointCondition("share of its way", "moved_alone", v.MOVED_WITHOUT_OP)],
        ),
        (
            "turns round alone",
            (SPLIT,),
            [JointCondition("share of its way", "turned_alone", v.TURNED_AT_THE_END)],
        ),
        (
            "PV does not answer it",
            (SAME_POINTS,),
            [
                JointCondition("OP alone tells", "op_alone", pv_answers.OP_ALONE),
                JointCondition("evident", "op_evident", pv_answers.EVIDENT),
                JointCondition("S", "sticks_here", pv_answers.STICKS_PERCENT),
            ],
        ),
        (
            "does not go with OP",
            OF_ANOTHER,
            [JointCondition("correlation", "related", v.UNRELATED, above=False)],
        ),
        (
            "stored in another range",
            RANGES,
            [
                JointCondition("off OP", "range_off", r.OFF_PERCENT, above=False),
                JointCondition("next range", "range_margin", r.WORSE_PERCENT),
            ],
        ),
    )


def wiring_limits(seen: Sequence[WiringShown]) -> Iterator[Limit]:
    """Each limit of the checks with the nulls and the recordings that it tells apart."""
    w = wiring_checks
    nulls = [valve for valve in seen if valve.rightly]

    def beside(*kinds: str) -> Tested[WiringShown]:
        return Tested(nulls, [valve for valve in seen if valve.way in kinds], MAY_PASS)

    doubted = JointCondition("left as mapped", "left", w.DOUBTED)
    for name, kinds, limits in _checks_of_signals():
        yield from beside(*kinds).together(name, limits)
    exchanged = [
        doubted,
        JointCondition("left exchanged", "exchanged", w.SURELY_SWAPPED, above=False),
        JointCondition("S either way", "sticks", w.STICKS_PERCENT),
    ]
    yield from beside(SWAPPED).together(
        "OP and position exchanged",
        exchanged,
        lambda valve: not (valve.told or valve.of_position or valve.op_plainly),
    )
    another = [doubted, JointCondition("left by another", "another", w.BY_ANOTHER, above=False)]
    far = [
        doubted,
        JointCondition("left, of that now", "far", w.ANOTHER_TIME, above=False),
        JointCondition("left then", "far_left", w.RELATED, above=False),
    ]
    plainly = [
        JointCondition("left as mapped", "left", w.FOLLOWS_ENOUGH),
        JointCondition(
            "left then, of that now", "then_of_now", w.PLAINLY_ANOTHER_TIME, above=False
        ),
    ]
    unrelated = [JointCondition("left as mapped", "as_mapped", w.UNRELATED_LEFT)]
    for name, kinds, limits in (
        ("another tag", FOR_ANOTHER, another),
        ("another time", APART, far),
        ("plainly another time", APART, plainly),
        ("unexplained", OF_ANOTHER, unrelated),
    ):
        yield from beside(*kinds).together(name, limits, lambda valve: not valve.told)
