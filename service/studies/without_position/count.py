"""Training and evaluation, on simulated loops, of the networks for valves without a position."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from hashlib import sha256

import numpy as np

from stemwatch.models.recording import Recording, Role, Signal
from stemwatch.models.studies.loops.draws import DrawnLoop, draw_loop
from stemwatch.models.studies.loops.examples import (
    LoopExample,
    WindowsExample,
    example,
    windows_example,
)
from stemwatch.models.studies.loops.quantile_regression import quantile_regression
from stemwatch.models.studies.simulator.draws import draw_healthy, draw_sticky
from stemwatch.models.studies.simulator.simulate import simulate_loop
from stemwatch.models.without_position.features import Evidence
from stemwatch.models.without_position.network import LoopNetwork, LoopScore, packed
from stemwatch.models.without_position.no_sign import NoSignLimit, columns, logit
from stemwatch.models.without_position.suspicion import (
    ENOUGH_PERIODS,
    LEAST_S_PERCENT,
    Judge,
    SeenLoop,
    Suspicion,
    SuspicionLimits,
    estimated_S,
    look_at_loop,
    predicts_better,
    sticking_score,
)
from stemwatch.service.executors import Executor, map_in_order
from stemwatch.service.studies.roc import area_under_roc, sensitivity

FALSE_ALARMS = 0.02  # share of sound loops that may be suspected, of those that can be judged
MISSED = 0.1  # share of sticking loops that may be told that their S would have shown
WINDOWS_ONLY = "own, windows only"
_MORE = 16  # times as many loops for the convolutional network, which need a tenth of the time
_LINE = 200  # characters of the weights in a line
_FEWEST = 10  # sticking loops for the limit of "no sign"


@dataclass(frozen=True)
class LoopToDraw:
    """One loop to draw: seed, place, and the family it is of."""

    seed: int
    place: int
    family: str = "own"


def example_item(item: LoopToDraw) -> list[LoopExample | WindowsExample | None]:
    """The example of one drawn loop."""
    if item.family == WINDOWS_ONLY:
        return [windows_example(item.seed, item.place)]
    return [example(item.seed, item.place)]


def items_of_training(loops: int, seed: int) -> tuple[list[LoopToDraw], list[LoopToDraw]]:
    """What is drawn to train on, and what gives the limits: half as many of the next seed, and
    sound valves of the force-balance plant."""
    examples = [LoopToDraw(seed, index) for index in range(loops)]
    examples += [LoopToDraw(seed, index, WINDOWS_ONLY) for index in range(loops, loops * _MORE)]
    judged = [LoopToDraw(seed + 1, index) for index in range(loops // 2)]
    judged += [LoopToDraw(seed + 1, 2 * index + 1, "plant") for index in range(loops // 10)]
    return examples, judged


def run_training(
    loops: int, seed: int, executor: Executor, on_progress: Callable[[int], None]
) -> Judge:
    """Train on ``loops`` loops of ``seed``, the convolutional network on ``_MORE`` times as many;
    ``items_of_training`` says what gives the limits."""
    from stemwatch.models.studies.loops.training import train  # torch takes two seconds to import

    examples, judged = items_of_training(loops, seed)
    items = map_in_order(executor, example_item, examples, on_progress)
    network = train(
        [item for item in items if isinstance(item, LoopExample)],
        seed=seed,
        windows_examples=[item for item in items if isinstance(item, WindowsExample)],
    )
    items_done = len(examples)
    seen = map_in_order(executor, look_item, judged, lambda n: on_progress(items_done + n))
    return Judge(network=network, limits=limits_of(seen, network))


@dataclass(frozen=True, kw_only=True)
class _JudgedLoop:
    """A loop that gives the limits. ``S_share`` is its true S over OP's amplitude, 0 for a sound
    one; ``range_share`` OP's range over that ``amplitude``; ``alarm`` the score where all else lets
    it be suspected, else 0."""

    is_own: bool
    S_share: float
    swings: float
    range_share: float
    amplitude: float
    score: float
    alarm: float


def limits_of(draws: Sequence[SeenDraw], network: LoopNetwork) -> SuspicionLimits:
    """The limits by loops that no network was trained on. At most ``FALSE_ALARMS`` of the sound
    loops of each simulator may be suspected."""
    loops = [loop for loop in (_judged(draw, network) for draw in draws) if loop is not None]
    of_each_simulator = (
        [loop.alarm for loop in loops if loop.S_share <= 0.0 and loop.is_own is own]
        for own in (True, False)
    )
    suspected = max(
        float(np.quantile(alarms, 1.0 - FALSE_ALARMS)) for alarms in of_each_simulator if alarms
    )
    return SuspicionLimits(
        suspected_from=suspected, no_sign=_no_sign([loop for loop in loops if loop.S_share > 0.0])
    )


def _judged(draw: SeenDraw, network: LoopNetwork) -> _JudgedLoop | None:
    shown, windows = draw.seen.shown, draw.seen.windows
    if shown is None or windows is None or draw.seen.doubt is not None:
        return None
    answer = network.answer(shown.values, windows)
    return _JudgedLoop(
        is_own=draw.place.family == "own",
        S_share=draw.S / shown.amplitude,
        swings=draw.seen.samples / shown.period,
        range_share=float(shown.sizes[-1]) / shown.amplitude,
        amplitude=shown.amplitude,
        score=sticking_score(shown, answer, draw.seen.unit),
        alarm=_alarm(draw.seen, shown, answer),
    )


def _alarm(seen: SeenLoop, shown: Evidence, answer: LoopScore) -> float:
    """The score where all other rules let a loop be suspected, else 0."""
    may_alarm = predicts_better(shown) and estimated_S(shown, answer) >= LEAST_S_PERCENT
    return sticking_score(shown, answer, seen.unit) if may_alarm else 0.0


def _no_sign(sticking: Sequence[_JudgedLoop]) -> NoSignLimit:
    """The limit by loops that stick. By too few nothing is "no sign"."""
    if len(sticking) < _FEWEST:
        return NoSignLimit(0.0, 0.0, 0.0, by_S=0.0, beyond=0.0, by_amplitude=0.0)
    seen = np.array(
        [(loop.S_share, loop.swings, loop.range_share, loop.amplitude) for loop in sticking]
    )
    scores = np.array([loop.score for loop in sticking])
    weights = quantile_regression(columns(*seen.T), logit(scores), MISSED)
    return NoSignLimit(*(round(float(weight), 4) for weight in weights))


def module_of(judge: Judge, loops: int, seed: int) -> str:
    """The Python module that ships ``judge`` with the program (``trained_weights.py``)."""
    shapes, text = packed(judge.network.arrays)
    return "\n".join(
        [
            '"""The networks for valves without a position, as trained; not to be edited by hand.',
            "",
            "``stemwatch study-without-position --save FILE`` writes this file.",
            '"""',
            "",
            "from __future__ import annotations",
            "",
            f'COMMAND = "stemwatch study-without-position --train {loops} --train-seed {seed}"',
            "# SHA-256 of PACKED in one line",
            f'DIGEST = "{sha256(text.encode()).hexdigest()}"',
            f"SUSPECTED_FROM = {judge.limits.suspected_from:.4f}",
            "NO_SIGN: dict[str, float] = {",
            *(
                f'    "{name}": {value:.4f},'
                for name, value in asdict(judge.limits.no_sign).items()
            ),
            "}",
            "SHAPES: dict[str, tuple[int, ...]] = {",
            *(f'    "{name}": {shape},' for name, shape in shapes.items()),
            "}",
            'PACKED = """',
            *(text[begin : begin + _LINE] for begin in range(0, len(text), _LINE)),
            '"""',
            "",
        ]
    )


@dataclass(frozen=True, kw_only=True)
class StudiedLoop:
    """What was said of one simulated loop, and the truth. ``S`` is 0 where nothing sticks."""

    family: str
    story: str
    S: float
    swings: float  # periods of the loop in its record; 0 where there was nothing to judge
    verdict: Suspicion
    score: float | None
    apparent_S: tuple[float, float, float] | None  # value, low, high
    shows_from: float | None = None  # the S that would have shown, with "no sign"
    alarm: float = 0.0  # the score where all other rules let it be suspected

    @property
    def sticky(self) -> bool:
        """Whether the valve sticks."""
        return self.S > 0.0

    @property
    def should_have_shown(self) -> bool:
        """Whether it sticks by the S, or more, that is said to have shown."""
        return self.shows_from is not None and self.S >= self.shows_from


@dataclass(frozen=True, kw_only=True)
class SeenDraw:
    """A simulated loop as it is seen, and its truth."""

    place: LoopToDraw
    story: str
    S: float
    seen: SeenLoop


def look_item(item: LoopToDraw) -> list[SeenDraw]:
    """Draw one loop, leave out what it has of a position, and look."""
    recording, S, story = FAMILIES[item.family](item)
    return [SeenDraw(place=item, story=story, S=S, seen=look_at_loop(recording))]


def studied(judge: Judge, seen_draw: SeenDraw) -> StudiedLoop:
    """What ``judge`` says of a simulated loop, beside its truth."""
    suspicion = judge.says(seen_draw.seen)
    estimate, shown, windows = suspicion.apparent_S, seen_draw.seen.shown, seen_draw.seen.windows
    numbers = None
    if estimate.value is not None and estimate.low is not None and estimate.high is not None:
        numbers = (estimate.value, estimate.low, estimate.high)
    alarm = 0.0
    if shown is not None and windows is not None and seen_draw.seen.doubt is None:
        alarm = _alarm(seen_draw.seen, shown, judge.network.answer(shown.values, windows))
    return StudiedLoop(
        family=seen_draw.place.family,
        story=seen_draw.story,
        S=seen_draw.S,
        swings=0.0 if shown is None else seen_draw.seen.samples / shown.period,
        verdict=suspicion.verdict,
        score=suspicion.score,
        apparent_S=numbers,
        shows_from=suspicion.shows_from,
        alarm=alarm,
    )


def _own_loop(item: LoopToDraw, story: str = "") -> tuple[Recording, float, str]:
    loop = draw_loop(item.seed, item.place, story)
    return recording_of(loop, f"LOOP-{item.place}"), loop.S, loop.story


def _wave(item: LoopToDraw) -> tuple[Recording, float, str]:
    return _own_loop(item, "wave")


def _plant(item: LoopToDraw) -> tuple[Recording, float, str]:
    """The force-balance plant of ``stemwatch trial``, without its position."""
    sticks = item.place % 2 == 0
    loop = (draw_sticky if sticks else draw_healthy)(item.place // 2 + 1, item.seed)[-1]
    recording = simulate_loop(loop, item.seed * 1_000 + item.place).recording
    signals = dict(recording.signals)
    del signals[Role.MV]
    S = loop.valve.S_read if sticks else 0.0
    return replace(recording, signals=signals), S, loop.story


def recording_of(loop: DrawnLoop, valve: str) -> Recording:
    """A simulated loop as a recording of OP, PV and SP."""
    return Recording(
        valve=valve,
        signals={
            Role.OP: Signal.good(loop.op, "OP"),
            Role.PV: Signal.good(loop.pv, "PV"),
            Role.SP: Signal.good(loop.sp, "SP"),
        },
        interval_s=loop.interval_s,
    )


FAMILIES: Mapping[str, Callable[[LoopToDraw], tuple[Recording, float, str]]] = {
    "own": _own_loop,
    "plant": _plant,
    "wave": _wave,
}


def run_study(
    judge: Judge, loops: int, seed: int, executor: Executor, on_progress: Callable[[int], None]
) -> list[StudiedLoop]:
    """What ``judge`` says of ``loops`` loops of each family, every other one sticking."""
    items = [LoopToDraw(seed, index, family) for family in FAMILIES for index in range(loops)]
    return [
        studied(judge, seen_draw)
        for seen_draw in map_in_order(executor, look_item, items, on_progress)
    ]


@dataclass(frozen=True, kw_only=True)
class FamilyRow:
    """What came out for one family: counts, and shares of 0 to 1.

    ``auc`` and ``sensitivity`` (at 2 and 5 % false alarms) are of the score, all loops counted, a
    missing score as 0; ``found`` is the sensitivity of suspicions, where a loop that another rule
    keeps from being suspected is no false alarm and is not found. ``missed`` counts the sticking
    ones whose S should have shown by what was said. ``error`` is the median error of
    S of the suspected, percent; ``held`` how many of their intervals hold the truth.
    """

    family: str
    sticking: int
    sound: int
    suspected: tuple[int, int]  # sticking, sound
    no_sign: tuple[int, int]
    cannot_tell: tuple[int, int]
    missed: int
    auc: float
    sensitivity: tuple[float, float]
    found: tuple[float, float]
    error: float
    held: tuple[int, int]


def family_rows(answers: Sequence[StudiedLoop]) -> Iterator[FamilyRow]:
    """One row for each family, in the order in which they were asked, and one for those of its
    loops whose record holds ``ENOUGH_PERIODS`` and more."""
    for family in dict.fromkeys(answer.family for answer in answers):
        of_family = [answer for answer in answers if answer.family == family]
        yield _family_row(family, of_family)
        long = [answer for answer in of_family if answer.swings >= ENOUGH_PERIODS]
        if {answer.sticky for answer in long} == {True, False}:
            yield _family_row(f"{family}, {ENOUGH_PERIODS} swings and more", long)


def _family_row(family: str, answers: Sequence[StudiedLoop]) -> FamilyRow:
    sticky = np.array([answer.sticky for answer in answers])
    score = np.array([answer.score or 0.0 for answer in answers])
    good, bad = score[sticky], score[~sticky]
    alarm = np.array([answer.alarm for answer in answers])
    alarms = alarm[sticky], alarm[~sticky]
    right = [a for a in answers if a.sticky and a.apparent_S is not None]
    errors = [abs(a.apparent_S[0] - a.S) for a in right if a.apparent_S]
    covered = sum(a.apparent_S[1] <= a.S <= a.apparent_S[2] for a in right if a.apparent_S)

    def count(verdict: Suspicion) -> tuple[int, int]:
        is_verdict = np.array([answer.verdict is verdict for answer in answers])
        return int(np.sum(is_verdict & sticky)), int(np.sum(is_verdict & ~sticky))

    return FamilyRow(
        family=family,
        sticking=int(sticky.sum()),
        sound=int(np.sum(~sticky)),
        suspected=count(Suspicion.SUSPECTED),
        no_sign=count(Suspicion.NO_SIGN),
        cannot_tell=count(Suspicion.CANNOT_TELL),
        missed=sum(answer.should_have_shown for answer in answers),
        auc=area_under_roc(good, bad),
        sensitivity=(sensitivity(good, bad, 0.02), sensitivity(good, bad, 0.05)),
        found=(sensitivity(*alarms, 0.02), sensitivity(*alarms, 0.05)),
        error=float(np.median(errors)) if errors else float("nan"),
        held=(int(covered), len(right)),
    )
