"""Recordings whose tags or ranges are mixed up: is the answer ever confidently wrong?

Sticking and healthy valves of both simulators are recorded once, and each recording is then wired
up wrongly in one way at a time: the position in milliamperes or counts, OP and position swapped,
the position of another valve, a copy of OP, clocks minutes apart. An answer is wrong where a
healthy valve is called sticky or watched, or a sticking one healthy.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stemwatch.models.recording import Floats, Quality, Recording, Role, Signal
from stemwatch.models.screening.screen import Case, Options, screen
from stemwatch.models.screening_result import Screening
from stemwatch.models.signals.first_order_lag import first_order_lag
from stemwatch.models.studies.simulator import (
    PlantLoop,
    draw_healthy,
    draw_sticky,
    simulate_loop,
)
from stemwatch.models.verdict import Verdict
from stemwatch.service.executors import Executor, map_in_order
from stemwatch.service.studies.robustness import draw_valves

CONFIDENT = 0.8
HEALTHY_STORY = "set points"  # one of ``draw_healthy`` in which OP moves
CASCADE_S = 5.0  # how often the master of a cascade moves its slave's set point
MANUAL_S, MANUAL_STEP = 300.0, 5.0  # an operator's moves of the manual station
NOISE_PERCENT = 0.1
STROKE_MM = 38.0
AS_IT_IS = "as it is"


@dataclass(frozen=True)
class RecordedValve:
    """One valve's recording, and those it can be mixed up with, all equally long."""

    valve: str
    sticking: bool
    recording: Recording
    other_kind: Recording  # of a valve of the other kind: healthy for a sticking one
    same_programme: Recording  # of that valve under this loop's set points
    slave: Recording  # this valve where the other loop's OP moves its set point
    other_day: Recording  # this valve, with other noise and the other loop's set points


Change = Callable[[RecordedValve], Recording]


def _signal(signal: Signal, values: Floats) -> Signal:
    return Signal.good(values, signal.tag, signal.unit)


def _wired(
    recording: Recording, *, op: Floats | None = None, mv: Floats | None = None
) -> Recording:
    """``recording`` with these values (n,) for OP and position."""
    signals = dict(recording.signals)
    for role, values in ((Role.OP, op), (Role.MV, mv)):
        if values is not None:
            signals[role] = _signal(signals[role], values)
    return replace(recording, signals=signals)


def _op(change: Callable[[Floats], Floats]) -> Change:
    return lambda seen: _wired(seen.recording, op=change(seen.recording.op.values))


def _mv(change: Callable[[Floats], Floats]) -> Change:
    return lambda seen: _wired(seen.recording, mv=change(_values(seen.recording, Role.MV)))


def _values(recording: Recording, role: Role) -> Floats:
    return recording.signals[role].values


def _scaled(low: float, high: float) -> Callable[[Floats], Floats]:
    return lambda values: low + values * (high - low) / 100.0


def _from(role: Role, source: Role) -> Change:
    """``role`` is read from the tag of ``source``."""

    def change(recorded: RecordedValve) -> Recording:
        values = _values(recorded.recording, source)
        return _wired(recorded.recording, **{role.value: values})

    return change


def _swapped(recorded: RecordedValve) -> Recording:
    op, mv = (_values(recorded.recording, role) for role in (Role.OP, Role.MV))
    return _wired(recorded.recording, op=mv, mv=op)


def _copied(change: Callable[[Floats], Floats]) -> Change:
    return lambda seen: _wired(seen.recording, mv=change(seen.recording.op.values))


def _take_from(name: str, *, role: Role = Role.MV) -> Change:
    """``role`` is that of another recording."""

    def change(recorded: RecordedValve) -> Recording:
        other: Recording = getattr(recorded, name)
        return _wired(recorded.recording, **{role.value: _values(other, role)})

    return change


def _cascade(recorded: RecordedValve) -> Recording:
    """OP is the master's, which is the set point of this valve's own controller."""
    return _wired(recorded.slave, op=_values(recorded.slave, Role.SP))


def _moved(seconds: float) -> Callable[[Floats], Floats]:
    """Later by so many seconds of a clock of one second; the edge is held."""

    def move(values: Floats) -> Floats:
        shifted_index = np.arange(values.size) - round(seconds)
        return np.asarray(values[np.clip(shifted_index, 0, values.size - 1)])

    return move


def _lagged(lag_s: float) -> Callable[[Floats], Floats]:
    """Through a lag of so many seconds of a clock of one second."""
    return lambda values: first_order_lag(values, lag_s)


def _every_second_exchanged(recorded: RecordedValve) -> Recording:
    op, mv = (_values(recorded.recording, role).copy() for role in (Role.OP, Role.MV))
    op[::2], mv[::2] = mv[::2].copy(), op[::2].copy()
    return _wired(recorded.recording, op=op, mv=mv)


def _manual_station(recorded: RecordedValve) -> Recording:
    """OP of a station that does not track: an operator's moves, which the valve never got."""
    op = recorded.recording.op.values
    rng = np.random.default_rng(op.size)
    samples_in_manual = round(MANUAL_S)
    moves = np.cumsum(rng.uniform(-MANUAL_STEP, MANUAL_STEP, op.size // samples_in_manual + 1))
    return _wired(
        recorded.recording, op=np.repeat(np.median(op) + moves, samples_in_manual)[: op.size]
    )


def _split_partner(values: Floats) -> Floats:
    """What the other valve of a split range is sent: full travel over the upper half of OP."""
    low, high = np.percentile(values, (1.0, 99.0))
    middle = (low + high) / 2.0
    return np.asarray(np.clip(2.0 * (values - middle), 0.0, 100.0))


def _limit_switch(closed: float, opened: float) -> Callable[[Floats], Floats]:
    return lambda values: np.where(values > np.median(values), opened, closed)


def _clipped(values: Floats) -> Floats:
    return np.clip(values, *np.percentile(values, (20.0, 80.0)))


def _dropouts(values: Floats) -> Floats:
    """Zero for a sample or some, a twentieth of the time."""
    rng = np.random.default_rng(values.size)
    broken = values.copy()
    for first in rng.choice(values.size, values.size // 80, replace=False):
        broken[first : first + int(rng.integers(1, 8))] = 0.0
    return broken


def _noise(values: Floats) -> Floats:
    rng = np.random.default_rng(values.size)
    return np.asarray(np.median(values) + NOISE_PERCENT * rng.standard_normal(values.size))


def _as_states(recorded: RecordedValve) -> Recording:
    """A position of words: opening, closing, in between. No number is left of it."""
    mv = recorded.recording.signals[Role.MV]
    empty = Signal(
        np.full(mv.values.size, np.nan),
        np.full(mv.values.size, Quality.CODE, dtype=np.uint8),
        mv.tag,
        mv.unit,
    )
    return replace(recorded.recording, signals={**recorded.recording.signals, Role.MV: empty})


def _both_ranges(low: float, high: float) -> Change:
    def change(recorded: RecordedValve) -> Recording:
        op, mv = (_values(recorded.recording, role) for role in (Role.OP, Role.MV))
        scaled = _scaled(low, high)
        return _wired(recorded.recording, op=scaled(op), mv=scaled(mv))

    return change


KINDS: dict[str, Change] = {
    AS_IT_IS: lambda seen: seen.recording,
    "MV in mA, 4 to 20": _mv(_scaled(4.0, 20.0)),
    "MV in mA, 20 to 4": _mv(_scaled(20.0, 4.0)),
    "MV a fraction, 0 to 1": _mv(_scaled(0.0, 1.0)),
    "MV in V, 0 to 10": _mv(_scaled(0.0, 10.0)),
    "MV in V, 1 to 5": _mv(_scaled(1.0, 5.0)),
    "MV in counts, 0 to 27648": _mv(_scaled(0.0, 27648.0)),
    "MV in counts, 0 to 4095": _mv(_scaled(0.0, 4095.0)),
    "MV percent of another range, 0 to 50": _mv(_scaled(0.0, 50.0)),
    "MV in mm, 0 to 38": _mv(_scaled(0.0, STROKE_MM)),
    "MV inverted": _mv(_scaled(100.0, 0.0)),
    "OP in mA, 4 to 20": _op(_scaled(4.0, 20.0)),
    "OP a fraction, 0 to 1": _op(_scaled(0.0, 1.0)),
    "OP in counts, 0 to 27648": _op(_scaled(0.0, 27648.0)),
    "OP in counts, 0 to 4095": _op(_scaled(0.0, 4095.0)),
    "OP and MV in mA, 4 to 20": _both_ranges(4.0, 20.0),
    "OP and MV fractions, 0 to 1": _both_ranges(0.0, 1.0),
    "OP and MV swapped": _swapped,
    "PV for OP": _from(Role.OP, Role.PV),
    "SP for OP": _from(Role.OP, Role.SP),
    "PV for MV": _from(Role.MV, Role.PV),
    "SP for MV": _from(Role.MV, Role.SP),
    "MV of another loop": _take_from("other_kind"),
    "MV of another loop with the same set points": _take_from("same_programme"),
    "OP of another loop": _take_from("other_kind", role=Role.OP),
    "OP of the cascade's master": _cascade,
    "OP of a manual station that does not track": _manual_station,
    "OP of the split range's other valve": _op(_split_partner),
    "MV a copy of OP": _copied(lambda op: op),
    "MV a copy of OP, rounded to 0.1": _copied(lambda op: np.round(op, 1)),
    "MV a copy of OP in mA": _copied(_scaled(4.0, 20.0)),
    "MV a copy of OP, inverted": _copied(_scaled(100.0, 0.0)),
    "MV a copy of OP, a sample late": _copied(_moved(1.0)),
    "MV a copy of OP, 10 s late": _copied(_moved(10.0)),
    "MV a copy of OP, filtered by 5 s": _copied(_lagged(5.0)),
    "MV a copy of OP, filtered by 30 s": _copied(_lagged(30.0)),
    "MV frozen": _mv(lambda mv: np.full(mv.size, mv[0])),
    "MV at 0": _mv(np.zeros_like),
    "MV at 100": _mv(lambda mv: np.full(mv.size, 100.0)),
    "MV only noise": _mv(_noise),
    **{f"MV {s} s late": _mv(_moved(float(s))) for s in (5, 20, 60, 300)},
    **{f"MV {s} s early": _mv(_moved(-float(s))) for s in (5, 20, 60, 300)},
    "MV of another day": _take_from("other_day"),
    "every second sample of OP and MV exchanged": _every_second_exchanged,
    "MV a limit switch, 0 or 1": _mv(_limit_switch(0.0, 1.0)),
    "MV a limit switch, 0 or 100": _mv(_limit_switch(0.0, 100.0)),
    "MV clipped at both ends": _mv(_clipped),
    "MV a flow, the square root": _mv(lambda mv: 10.0 * np.sqrt(np.clip(mv, 0.0, None))),
    "MV in steps of 5 %": _mv(lambda mv: 5.0 * np.round(mv / 5.0)),
    "MV a counter of travel": _mv(lambda mv: np.cumsum(np.abs(np.diff(mv, prepend=mv[0])))),
    "MV with dropouts to 0": _mv(_dropouts),
    "MV as words": _as_states,
}


@dataclass(frozen=True)
class MiswiredValve:
    """A valve to be simulated, with those it is mixed up with."""

    name: str
    loop: PlantLoop
    other_loop: PlantLoop
    seed: int
    sticking: bool


@dataclass(frozen=True)
class WiringAnswer:
    """What was said of one valve wired up in one way."""

    kind: str
    valve: str
    sticking: bool
    verdict: Verdict
    confidence: float | None
    reason: str
    advice: str
    corrections: tuple[str, ...]  # signals that were corrected before they were used
    S: float | None

    @property
    def wrong(self) -> bool:
        """A healthy valve called sticky or watched, a sticking one called healthy."""
        if self.sticking:
            return self.verdict is Verdict.HEALTHY
        return self.verdict in (Verdict.STICKY, Verdict.WATCH)

    @property
    def confidently_wrong(self) -> bool:
        """Wrong with a confidence of ``CONFIDENT`` or more."""
        return self.wrong and self.confidence is not None and self.confidence >= CONFIDENT


def draw_miswired(loops: int, seed: int) -> list[MiswiredValve]:
    """``loops`` valves, sticking and healthy in turn: the routine loops of ``draw_valves``
    (Karnopp's packing and LuGre's), and those of ``draw_sticky`` and ``draw_healthy``.

    Each is mixed up with a valve of the other kind that comes from the same draw.
    """
    loops_each = loops // 4 + 2
    valves = draw_valves(loops_each, seed)
    with_story = [
        drawn_valve
        for drawn_valve in draw_healthy(6 * loops_each, seed)
        if HEALTHY_STORY in drawn_valve.story
    ]
    pools: list[list[tuple[PlantLoop, bool]]] = [
        [(valve.case.loop, valve.sticking) for valve in valves if valve.sticking],
        [(valve.case.loop, valve.sticking) for valve in valves if not valve.sticking],
        [(loop, True) for loop in draw_sticky(loops_each, seed)],
        [(loop, False) for loop in with_story],
    ]
    pairs = []
    for index in range(loops):
        pool = index % 4
        loop, sticking = pools[pool][index // 4]
        other, _ = pools[pool ^ 1][index // 4 + 1]
        pairs.append(MiswiredValve(f"{index} {loop.tag}", loop, other, seed + index, sticking))
    return pairs


def record(valve: MiswiredValve) -> RecordedValve:
    """Simulate the valve and all that it can be mixed up with."""
    loop, other = valve.loop, replace(valve.other_loop, duration_s=valve.loop.duration_s)
    mine, theirs = (simulate_loop(part, valve.seed).recording for part in (loop, other))
    master = theirs.op.values
    moves = tuple(
        (float(time_s), float(master[int(time_s)]))
        for time_s in np.arange(0.0, master.size, CASCADE_S)
    )
    following = replace(other, setpoints=loop.setpoints)
    return RecordedValve(
        valve=valve.name,
        sticking=valve.sticking,
        recording=mine,
        other_kind=theirs,
        same_programme=simulate_loop(following, valve.seed + 1).recording,
        slave=simulate_loop(replace(loop, setpoints=moves), valve.seed + 2).recording,
        other_day=simulate_loop(replace(loop, setpoints=other.setpoints), valve.seed + 3).recording,
    )


def answers_of(recorded: RecordedValve, kinds: Sequence[str]) -> Iterator[WiringAnswer]:
    """The valve screened in each of ``kinds``."""
    for kind in kinds:
        wired = KINDS[kind](recorded)
        (screening,) = screen([Case(recording=wired)], Options(narx=False))
        yield _answer(kind, recorded, screening)


def _answer(kind: str, recorded: RecordedValve, screening: Screening) -> WiringAnswer:
    recording = screening.recording
    return WiringAnswer(
        kind=kind,
        valve=recorded.valve,
        sticking=recorded.sticking,
        verdict=screening.verdict,
        confidence=screening.confidence,
        reason=screening.reason,
        advice=screening.advice,
        corrections=() if recording is None else recording.provenance.decisions,
        S=screening.S.value,
    )


@dataclass(frozen=True)
class MiswiringItem:
    """A valve that one worker simulates and screens in all ``kinds``."""

    valve: MiswiredValve
    kinds: tuple[str, ...]


def answer_item(item: MiswiringItem) -> list[WiringAnswer]:
    """All answers of one valve."""
    return list(answers_of(record(item.valve), item.kinds))


def run_miswiring(
    loops: int,
    seed: int,
    kinds: Sequence[str],
    executor: Executor,
    on_progress: Callable[[int], None],
) -> list[WiringAnswer]:
    """``loops`` valves in each of ``kinds``; raises ``KeyError`` for one that is not known."""
    for kind in kinds:
        KINDS[kind]
    items = [MiswiringItem(valve, tuple(kinds)) for valve in draw_miswired(loops, seed)]
    return map_in_order(executor, answer_item, items, on_progress)


@dataclass(frozen=True)
class WiringRow:
    """What came out for one kind of mis-wiring, numbers of valves."""

    kind: str
    valves: int
    confidently_wrong: int
    wrong: int
    undetermined: int
    right: int  # neither wrong nor undetermined
    converted: int  # of those: a sentence says what was read otherwise
    highest: float | None  # confidence of a wrong answer
    reason: str  # what most of the undetermined were told


def rows(answers: Sequence[WiringAnswer]) -> Iterator[WiringRow]:
    """One row for each kind, in the order in which they were asked for."""
    for kind in dict.fromkeys(answer.kind for answer in answers):
        yield _row(kind, [answer for answer in answers if answer.kind == kind])


def _row(kind: str, answers: Sequence[WiringAnswer]) -> WiringRow:
    undetermined = [a for a in answers if a.verdict is Verdict.UNDETERMINED]
    wrong = [a for a in answers if a.wrong]
    right = [a for a in answers if not a.wrong and a.verdict is not Verdict.UNDETERMINED]
    reasons = [answer.reason for answer in undetermined]
    return WiringRow(
        kind=kind,
        valves=len(answers),
        confidently_wrong=sum(answer.confidently_wrong for answer in answers),
        wrong=len(wrong),
        undetermined=len(undetermined),
        right=len(right),
        converted=sum(bool(answer.corrections) for answer in right),
        highest=max((a.confidence or 0.0 for a in wrong), default=None),
        reason=max(reasons, key=reasons.count, default=""),
    )
