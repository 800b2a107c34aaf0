"""Training of the networks for valves without a position, on simulated loops, and the limits of
what is said by them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from hashlib import sha256

import numpy as np

from stemwatch.models.statistics.quantile_regression import quantile_regression
from stemwatch.models.studies.loops.examples import (
    LoopExample,
    WindowsExample,
    example,
    windows_example,
)
from stemwatch.models.without_position.network import LoopNetwork, packed
from stemwatch.models.without_position.no_sign import NoSignLimit, columns, logit
from stemwatch.models.without_position.suspicion import (
    Judge,
    SuspicionLimits,
    sticking_score,
)
from stemwatch.service.executors import Executor, map_in_order
from stemwatch.service.studies.without_position.draw import (
    LoopToDraw,
    SeenDraw,
    alarm_score,
    look_item,
)

FALSE_ALARMS = 0.02  # share of sound loops that may be suspected, of those that can be judged
MISSED = 0.1  # share of sticking loops that may be told that their S would have shown
WINDOWS_ONLY = "own, windows only"
_MORE = 16  # times as many loops for the convolutional network, which need a tenth of the time
_LINE = 200  # characters of the weights in a line
_FEWEST = 10  # sticking loops for the limit of "no sign"


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
        alarm=alarm_score(draw.seen, shown, answer),
    )


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
