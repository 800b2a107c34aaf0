"""The same valves as other plants would have stored them: do verdict, S and J hold?

Sticking and healthy valves of the proof's plant (half with Karnopp's packing, half with LuGre's)
are simulated once, and each recording is changed in one way at a time: how OP strokes the valve,
how the archive keeps its samples, how late a clock is. Nothing is hidden in them, so every effect
that is named is named in error.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binom

from stemwatch.models.recording import Floats, Recording, Role, Signal
from stemwatch.models.screening.screen import Case, Options, screen
from stemwatch.models.screening_result import Screening
from stemwatch.models.studies.simulator import simulate_loop
from stemwatch.models.studies.simulator.defects import PackingDefects
from stemwatch.models.studies.simulator.hidden import HiddenCase, draw_nulls
from stemwatch.models.studies.simulator.loop import PlantLoop
from stemwatch.models.verdict import Verdict
from stemwatch.service.executors import Executor, map_in_order
from stemwatch.service.studies.detection_rates import wilson
from stemwatch.service.studies.partial_results import append_line, stored_lines

Change = Callable[[Recording], Recording]

STICKING_S = (3.0, 8.0)  # percent
HEALTHY_S = (0.1, 0.5)
RANGEABILITY = 40.0
LONG_HOURS = 8
FINE_S, SLIP_SAMPLES = 0.1, 5
# Shares of intervals that are to hold in each way; the middle of it, from which chance is counted.
HOLD, NOMINAL_SHARE = (0.88, 0.98), 0.93


def _changed(
    recording: Recording,
    *,
    op: Callable[[Floats], Floats] | None = None,
    mv: Callable[[Floats], Floats] | None = None,
    change_all: Callable[[Floats], Floats] | None = None,
    slower: int = 1,
) -> Recording:
    """``recording`` with OP, MV, or every signal changed; ``slower`` times the interval."""
    signals = {}
    for role, signal in recording.signals.items():
        values = signal.values
        for change, roles in ((op, Role.OP), (mv, Role.MV), (change_all, role)):
            if change is not None and role is roles:
                values = change(values)
        signals[role] = Signal.good(values, signal.tag, signal.unit)
    return replace(recording, signals=signals, interval_s=slower * recording.interval_s)


def _opening(values: Floats) -> Floats:
    return np.clip(values, 0.0, 100.0)


def _equal_percentage(travel: Floats) -> Floats:
    """OP at which an equal percentage of 1:40 asks for ``travel``."""
    share = _opening(travel) / 100.0 * (RANGEABILITY - 1.0)
    return np.asarray(100.0 * np.log1p(share) / np.log(RANGEABILITY))


def _shut_off(recording: Recording) -> Recording:
    """The valve is shut, and stays so, in the lowest 12 % of the record."""
    position = recording.signals[Role.MV].values
    seat = float(np.nanpercentile(position, 12.0))
    return _changed(recording, mv=lambda values: np.maximum(values, seat))


def _every_nth(samples: int) -> Change:
    return lambda r: _changed(r, change_all=lambda v: v[::samples].copy(), slower=samples)


def _late(samples: int) -> Callable[[Floats], Floats]:
    return lambda values: np.concatenate((np.full(samples, values[0]), values[:-samples]))


def _means(samples: int) -> Callable[[Floats], Floats]:
    def mean(values: Floats) -> Floats:
        whole_samples = values.size // samples * samples
        return np.asarray(values[:whole_samples].reshape(-1, samples).mean(axis=1))

    return mean


def _reported(deviation: float) -> Callable[[Floats], Floats]:
    """Report by exception: the last value is held until it is off by ``deviation``."""

    def reported_values(values: Floats) -> Floats:
        reported, last = values.copy(), values[0]
        for index, value in enumerate(values):
            last = value if abs(value - last) > deviation else last
            reported[index] = last
        return reported

    return reported_values


@dataclass(frozen=True)
class StoredAs:
    """How a recording is changed; ``strokes`` where OP then means other percents of travel.

    ``true`` are effects that the change really puts there: naming them is no error. ``hours`` are
    how long the loop is recorded: its set-point moves come again every hour.
    """

    change: Change
    strokes: bool = False
    hours: int = 1
    true: frozenset[str] = frozenset()


WAYS: dict[str, StoredAs] = {
    "as it is": StoredAs(lambda r: r),
    "split range: OP 50 to 100 % strokes 0 to 100 %": StoredAs(
        lambda r: _changed(r, op=lambda v: 50 + v / 2), strokes=True
    ),
    "split range: OP 0 to 50 % strokes 0 to 100 %": StoredAs(
        lambda r: _changed(r, op=lambda v: v / 2), strokes=True
    ),
    "OP 25 to 75 % strokes 0 to 100 %": StoredAs(
        lambda r: _changed(r, op=lambda v: 25 + v / 2), strokes=True
    ),
    "equal percentage between OP and stroke": StoredAs(
        lambda r: _changed(r, op=_equal_percentage), strokes=True
    ),
    "square root between OP and stroke": StoredAs(
        lambda r: _changed(r, op=lambda v: _opening(v) ** 2 / 100), strokes=True
    ),
    "square between OP and stroke": StoredAs(
        lambda r: _changed(r, op=lambda v: 10 * np.sqrt(_opening(v))), strokes=True
    ),
    "position reversed": StoredAs(lambda r: _changed(r, mv=lambda v: 100 - v)),
    # MV stands still while OP goes on: an end stop in the catalogue.
    "tight shut-off below 12 % of the record": StoredAs(_shut_off, true=frozenset({"travel_stop"})),
    "OP stored 5 s late": StoredAs(lambda r: _changed(r, op=_late(5))),
    "position stored 5 s late": StoredAs(
        lambda r: _changed(r, mv=_late(5)), true=frozenset({"dead_time"})
    ),
    "position in steps of 0.5 %": StoredAs(lambda r: _changed(r, mv=lambda v: np.round(2 * v) / 2)),
    "OP in steps of 0.5 %": StoredAs(lambda r: _changed(r, op=lambda v: np.round(2 * v) / 2)),
    "averages of 10 s": StoredAs(lambda r: _changed(r, change_all=_means(10), slower=10)),
    "stored every 5 s": StoredAs(_every_nth(5)),
    "stored every 10 s": StoredAs(_every_nth(10)),
    "stored every 30 s": StoredAs(_every_nth(30)),
    "8 hours, stored every 30 s": StoredAs(_every_nth(30), hours=LONG_HOURS),
    "8 hours, stored every 60 s": StoredAs(_every_nth(60), hours=LONG_HOURS),
    "exception reporting of 0.5 %": StoredAs(
        lambda r: _changed(r, op=_reported(0.5), mv=_reported(0.5))
    ),
    "exception reporting of 1 %": StoredAs(
        lambda r: _changed(r, op=_reported(1.0), mv=_reported(1.0))
    ),
}


@dataclass(frozen=True)
class StudiedValve:
    """A valve to be simulated, and what is true of it; S and J in percent of travel."""

    case: HiddenCase
    sticking: bool
    S: float
    J: float


@dataclass(frozen=True)
class StudyAnswer:
    """What was said of one valve stored in one way. S and J in percent of OP, truth as well.

    ``S_at_least`` where only that is said of S.
    """

    way: str
    sticking: bool
    verdict: Verdict
    reason: str
    S: tuple[float, float, float] | None  # value, low, high
    J: tuple[float, float, float] | None
    S_at_least: float | None
    true_S: float
    true_J: float
    named: tuple[str, ...]  # in error
    seconds: float

    def as_json(self) -> dict[str, Any]:
        """The answer as a JSON object."""
        return {**asdict(self), "verdict": self.verdict.value}

    @classmethod
    def of_json(cls, kept: dict[str, Any]) -> StudyAnswer:
        """The answer that was written as ``kept``."""
        kept |= {name: tuple(kept[name]) for name in ("S", "J") if kept[name] is not None}
        return cls(**{**kept, "verdict": Verdict(kept["verdict"]), "named": tuple(kept["named"])})


@dataclass(frozen=True)
class RobustnessBatch:
    """A valve that one worker simulates, changes and screens; the answers are kept in ``file``."""

    valve: StudiedValve
    ways: tuple[str, ...]
    file: Path | None = None


def draw_valves(valves_each: int, seed: int) -> list[StudiedValve]:
    """``valves_each`` sticking and as many healthy valves, an hour at 1 s with set-point moves."""
    cases = draw_nulls(4 * valves_each, seed, "routine")
    wide = [case for case in cases if STICKING_S[0] <= case.loop.valve.S <= STICKING_S[1]]
    rng = np.random.default_rng([seed, 17])
    sticking = [
        _with(case, case.loop.valve.S, case.loop.valve.J, index, True)
        for index, case in enumerate(wide[:valves_each])
    ]
    healthy = []
    for index, case in enumerate(draw_nulls(valves_each, seed + 1, "routine")):
        S = float(rng.uniform(*HEALTHY_S))
        healthy.append(_with(case, S, 0.3 * S, index, False))
    return [*sticking, *healthy]


def _with(case: HiddenCase, S: float, J: float, index: int, sticking: bool) -> StudiedValve:
    """The case with this S and J; two packings of four give a little before they let go.

    In the LuGre model the stem breaks away earlier the faster the force grows. So the S and J of a
    LuGre packing are those that it shows in its own loop, corrected by what a Karnopp packing with
    the same friction levels shows there.
    """
    valve = replace(case.loop.valve, S=S, J=J, packing=PackingDefects())
    stiff = replace(case.loop, valve=valve)
    if index % 4 < 2:
        return StudiedValve(replace(case, loop=stiff), sticking, S, J)
    packing = PackingDefects(presliding_percent=0.002)
    soft = replace(case.loop, valve=replace(valve, packing=packing))
    if sticking:
        soft_levels, stiff_levels = (_levels_shown(loop, case.seed, J) for loop in (soft, stiff))
        level, kinetic = soft_levels[0] - stiff_levels[0], soft_levels[1] - stiff_levels[1]
        S, J = S + level + kinetic, max(J + level - kinetic, 0.0)
    return StudiedValve(replace(case, loop=soft), sticking, S, J)


def _levels_shown(loop: PlantLoop, seed: int, J: float) -> tuple[float, float]:
    """How far OP is ahead of the stem before and after its slips, medians, percent: read off the
    loop without noise and without scatter, ten times a second."""
    quiet = replace(
        loop,
        valve=replace(loop.valve, scatter=0.0),
        transmitters=replace(loop.transmitters, position_noise=0.0),
        archive=replace(loop.archive, interval_s=FINE_S),
    )
    recording = simulate_loop(quiet, seed).recording
    assert recording.mv is not None
    op, mv = recording.op.values, recording.mv.values
    moving = np.abs(np.diff(mv)) > 0.02
    begins = 1 + np.flatnonzero(moving[1:] & ~moving[:-1])
    ends = np.minimum(begins + SLIP_SAMPLES, mv.size - 1)
    slips = np.abs(mv[ends] - mv[begins]) > 0.3 * J
    begins, ends = begins[slips], ends[slips]
    direction = np.sign(mv[ends] - mv[begins])
    before, after = direction * (op[begins] - mv[begins]), direction * (op[ends] - mv[ends])
    return float(np.median(before)), float(np.median(after))


def answer_batch(batch: RobustnessBatch) -> list[StudyAnswer]:
    """Simulate a valve once, store it in every way, and screen what was stored; what was kept is
    not done again."""
    kept = map(StudyAnswer.of_json, stored_lines(batch.file))
    answers = {answer.way: answer for answer in kept}
    recordings: dict[int, Recording] = {}
    for way in batch.ways:
        if way in answers:
            continue
        hours = WAYS[way].hours
        if hours not in recordings:
            recordings[hours] = recorded(batch.valve, hours)
        answers[way] = answered(batch.valve, recordings[hours], way)
        append_line(batch.file, answers[way].as_json())
    return [answers[way] for way in batch.ways]


def answered(valve: StudiedValve, recording: Recording, way: str) -> StudyAnswer:
    """What is said of the ``recording`` of a valve, stored in one way."""
    stored = WAYS[way].change(recording)
    (screening,) = screen([Case(recording=stored)], Options(narx=False))
    scale = _op_per_travel(recording, stored) if WAYS[way].strokes else 1.0
    return _answer(way, valve, screening, scale)


def recorded(valve: StudiedValve, hours: int = 1) -> Recording:
    """The valve's recording of so many hours; the set-point moves of the first come every hour."""
    loop = valve.case.loop
    return simulate_loop(loop.lasting(hours * loop.duration_s), valve.case.seed).recording


def _op_per_travel(recording: Recording, stored: Recording) -> float:
    """Percent of stored OP for a percent of travel, over the part of OP that was used."""
    before, after = (
        np.subtract(*np.percentile(form.op.values[form.op.usable], (99.5, 0.5)))
        for form in (recording, stored)
    )
    return float(after / before)


def _answer(way: str, valve: StudiedValve, screening: Screening, scale: float) -> StudyAnswer:
    effects = screening.mismatch.effects if screening.mismatch is not None else ()
    return StudyAnswer(
        way=way,
        sticking=valve.sticking,
        verdict=screening.verdict,
        reason=screening.reason,
        S=screening.S.with_interval,
        J=screening.J.with_interval,
        S_at_least=screening.S.at_least,
        true_S=scale * valve.S,
        true_J=scale * valve.J,
        named=tuple(effect.slug for effect in effects if effect.slug not in WAYS[way].true),
        seconds=screening.seconds,
    )


def run_robustness(
    valves_each: int,
    seed: int,
    ways: Sequence[str],
    executor: Executor,
    on_progress: Callable[[int], None],
    keep: Path | None = None,
) -> list[StudyAnswer]:
    """``valves_each`` sticking and healthy valves in each way. What is said of them is kept in the
    folder ``keep``, and is not asked again. Raises ``KeyError`` for an unknown way."""
    for way in ways:
        WAYS[way]
    batches = [
        RobustnessBatch(
            valve,
            tuple(ways),
            None if keep is None else keep / f"{seed}-{valves_each}-{number}.jsonl",
        )
        for number, valve in enumerate(draw_valves(valves_each, seed))
    ]
    return map_in_order(executor, answer_batch, batches, on_progress)


@dataclass(frozen=True)
class Row:
    """What came out in one way. Errors are medians of absolute errors in percent of OP."""

    way: str
    healthy: int
    called_sticky: int
    healthy_undetermined: int
    sticking: int
    missed: int  # sticking valves that are neither sticky nor watch
    with_numbers: int  # sticking valves with S and J
    S_error: float
    J_error: float
    S_held: int  # intervals that hold the truth
    J_held: int
    S_width: float
    S_at_least: int  # sticking valves with only a bound of S
    at_least_held: int
    named: int  # valves of either kind of which something was named


def rows(answers: Sequence[StudyAnswer]) -> Iterator[Row]:
    """One row for each way, in the order in which they were asked for."""
    for way in dict.fromkeys(answer.way for answer in answers):
        yield _row(way, [answer for answer in answers if answer.way == way])


def _row(way: str, answers: Sequence[StudyAnswer]) -> Row:
    healthy = [answer for answer in answers if not answer.sticking]
    sticking = [answer for answer in answers if answer.sticking]
    S = [(answer.true_S, *answer.S) for answer in sticking if answer.S is not None]
    J = [(answer.true_J, *answer.J) for answer in sticking if answer.J is not None]
    bounds = [answer for answer in sticking if answer.S_at_least is not None]
    return Row(
        way=way,
        healthy=len(healthy),
        called_sticky=sum(answer.verdict is Verdict.STICKY for answer in healthy),
        healthy_undetermined=sum(answer.verdict is Verdict.UNDETERMINED for answer in healthy),
        sticking=len(sticking),
        missed=sum(answer.verdict not in (Verdict.STICKY, Verdict.WATCH) for answer in sticking),
        with_numbers=len(S),
        S_error=_median([abs(value - truth) for truth, value, _, _ in S]),
        J_error=_median([abs(value - truth) for truth, value, _, _ in J]),
        S_held=sum(low <= truth <= high for truth, _, low, high in S),
        J_held=sum(low <= truth <= high for truth, _, low, high in J),
        S_width=_median([high - low for _, _, low, high in S]),
        S_at_least=len(bounds),
        at_least_held=sum((answer.S_at_least or 0.0) <= answer.true_S for answer in bounds),
        named=sum(bool(answer.named) for answer in answers),
    )


@dataclass(frozen=True)
class Coverage:
    """Intervals of S or of J in all ways together: ``held`` of ``of``.

    ``outside`` are those of ``ways`` with numbers in which, beyond chance, fewer or more hold than
    ``HOLD``: the 95 % interval of the way's share (Wilson) lies outside of it. ``by_chance`` is in
    how many ways of so many valves the bare share would, if each interval held with
    ``NOMINAL_SHARE``.
    """

    held: int
    of: int
    ways: int
    outside: int
    by_chance: float


def coverage(held: Sequence[int], of: Sequence[int]) -> Coverage:
    """Of the intervals that hold in each way, of how many."""
    counted = [(hits, total) for hits, total in zip(held, of, strict=True) if total]
    spans = [wilson(hits, total) for hits, total in counted]
    low, high = HOLD
    return Coverage(
        held=sum(hits for hits, _ in counted),
        of=sum(total for _, total in counted),
        ways=len(counted),
        outside=sum(top < low or bottom > high for bottom, top in spans),
        by_chance=sum(_outside_by_chance(total) for _, total in counted),
    )


def _outside_by_chance(valves: int) -> float:
    """How likely a share outside ``HOLD`` is, of so many independent intervals."""
    low, high = (share * valves for share in HOLD)
    inside = np.arange(math.ceil(low - 1e-9), math.floor(high + 1e-9) + 1)
    return float(1.0 - binom.pmf(inside, valves, NOMINAL_SHARE).sum())


def _median(values: Sequence[float]) -> float:
    return float(np.median(values)) if values else float("nan")
