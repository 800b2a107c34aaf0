"""Does the baseline ratio tell growing stiction from a valve that stays as it is?

Counted on simulated valves. A loop is drawn with a healthy valve; a network is trained on its
first window; then six later windows are scored against that network, with the valve as it was or
with stiction that grows from window to window.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from enum import StrEnum
from typing import Any

import numpy as np

from stemwatch.models.estimate import Estimate
from stemwatch.models.limits import Limits
from stemwatch.models.narx.baseline import BaselineScore, score_baseline
from stemwatch.models.narx.example import NarxExample, NarxSettings
from stemwatch.models.narx.network import NarxNetwork
from stemwatch.models.recording import Recording
from stemwatch.models.studies.simulator import (
    PlantLoop,
    SimulatedValve,
    draw_healthy,
    simulate_loop,
)
from stemwatch.models.studies.simulator.draw_parts import draw_setpoints
from stemwatch.service.executors import Executor, map_in_order
from stemwatch.service.studies.detection_rates import area_estimate, wilson

WINDOWS, WINDOW_S = 6, 600.0
TARGET = 0.95  # area under the curve that the indicator is meant to reach
FALSE_ALARMS = (0.05, 0.02)  # shares of healthy valves that calibrated limits let raise an alarm
JUDGED = 3  # the last scored windows, whose median ratio is the valve's score
BATCH = 12

_TRAINED_SHARE = 0.6  # of the baseline window, as in a screening
_FEWEST_JUDGED = 2
_BANDS = ((1.5, 2.5), (2.5, 4.0), (4.0, float("inf")))  # S in the last window, percent of span
_GROWN_S_PERCENT = (1.5, 8.0)
# Above this friction, in percent of the spring range, the air supply could not move the stem.
_MOST_FRICTION_PERCENT = 40.0


class ValveFate(StrEnum):
    """What becomes of a valve after its baseline window."""

    UNCHANGED = "unchanged"
    OPERATED = "unchanged, run differently"
    GROWING = "growing stiction"


class OperatingChange(StrEnum):
    """How a loop can be run differently with the same valve."""

    OPENING = "other opening"
    LOAD = "stronger disturbance"
    TUNING = "other tuning"
    SETPOINTS = "set points moved"


HEALTHY = (ValveFate.UNCHANGED, ValveFate.OPERATED)


@dataclass(frozen=True, kw_only=True)
class Followed:
    """One valve and one fate: the ratio in each later window, ``None`` where the baseline refused.

    ``S`` and ``J`` (percent of span) are those of the last window. ``reason`` is set where no
    baseline could be trained.
    """

    tag: str
    story: str
    fate: ValveFate
    operation: OperatingChange | None
    S_before: float
    S: float
    J: float
    ratios: tuple[float | None, ...] = ()
    reason: str = ""

    @property
    def score(self) -> float | None:
        """Median ratio of the last three scored windows; ``None`` where fewer than two were."""
        scored = [ratio for ratio in self.ratios if ratio is not None]
        return float(np.median(scored[-JUDGED:])) if len(scored) >= _FEWEST_JUDGED else None

    @property
    def refused(self) -> int:
        """How many later windows the baseline would not score."""
        return sum(ratio is None for ratio in self.ratios)


@dataclass(frozen=True)
class DriftBatch:
    """Loops whose baselines one worker trains together, each with its place in the draw."""

    loops: tuple[tuple[int, PlantLoop], ...]
    seed: int
    fates: tuple[ValveFate, ...]


def run_drift(
    valves: int,
    seed: int,
    executor: Executor,
    on_progress: Callable[[int], None],
    fates: Sequence[ValveFate] = tuple(ValveFate),
) -> list[Followed]:
    """Follow ``valves`` loops, drawn healthy with ``seed``, in each of ``fates``.

    The fates of a loop share its baseline. ``on_progress`` is called with the number of loops done.
    """
    valves_drawn = list(enumerate(draw_healthy(valves, seed)))
    batches = [
        DriftBatch(tuple(valves_drawn[first : first + BATCH]), seed, tuple(fates))
        for first in range(0, valves, BATCH)
    ]
    return map_in_order(
        executor, follow_batch, batches, lambda count: on_progress(count // len(fates))
    )


def follow_batch(batch: DriftBatch) -> list[Followed]:
    """Simulate the baseline windows, train on them, simulate the later windows and score them."""
    from stemwatch.models.narx.training import train

    first = [
        simulate_loop(loop, _chance(batch.seed, place_in_draw)).recording
        for place_in_draw, loop in batch.loops
    ]
    # On the CPU, so that the counts are the same on every machine.
    settings = NarxSettings(device="cpu")
    fits = train([_example(recording) for recording in first], settings)
    return [
        _follow(batch.seed, place_in_draw, loop, fate, fit.network, fit.reason or "")
        for (place_in_draw, loop), fit in zip(batch.loops, fits, strict=True)
        for fate in batch.fates
    ]


def _chance(seed: int, *path: int) -> int:
    return int(np.random.default_rng([seed, *path]).integers(2**31))


def _example(recording: Recording) -> NarxExample:
    return NarxExample.of(recording, int(_TRAINED_SHARE * len(recording)))


def _follow(
    seed: int,
    place_in_draw: int,
    loop: PlantLoop,
    fate: ValveFate,
    baseline: NarxNetwork | None,
    reason: str,
) -> Followed:
    number = tuple(ValveFate).index(fate)
    rng = np.random.default_rng([seed, place_in_draw, number, 0])
    operation = (
        tuple(OperatingChange)[place_in_draw % len(OperatingChange)]
        if fate is ValveFate.OPERATED
        else None
    )
    later = [
        _window(_operated(loop, operation, rng), valve, rng)
        for valve in _valves(loop.valve, fate, rng)
    ]
    followed = Followed(
        tag=loop.tag,
        story=loop.story,
        fate=fate,
        operation=operation,
        S_before=loop.valve.S_read,
        S=later[-1].valve.S_read,
        J=later[-1].valve.J_read,
        reason=reason,
    )
    if baseline is None:
        return followed
    seeds = [_chance(seed, place_in_draw, number, 1 + window) for window in range(WINDOWS)]
    scores = [_score(baseline, window, chance) for window, chance in zip(later, seeds, strict=True)]
    return replace(followed, ratios=tuple(score.ratio for score in scores))


def _valves(
    valve: SimulatedValve, fate: ValveFate, rng: np.random.Generator
) -> list[SimulatedValve]:
    """The valve in each later window; growing stiction rises in equal steps."""
    if fate is not ValveFate.GROWING:
        return [valve] * WINDOWS
    ratio = float(rng.uniform(0.0, 1.0))
    low, high = _GROWN_S_PERCENT
    # A positioner divides what its packing shows by 1 + gain, so that less can be seen of it.
    largest_S = _MOST_FRICTION_PERCENT / ((1.0 + valve.positioner_gain) * (1.0 + ratio))
    end = float(np.exp(rng.uniform(np.log(low), np.log(max(min(high, largest_S), low)))))
    shares = np.arange(1, WINDOWS + 1) / WINDOWS
    return [
        SimulatedValve.showing(
            float(valve.S_read + share * (end - valve.S_read)),
            float(valve.J_read + share * (ratio * end - valve.J_read)),
            positioner_gain=valve.positioner_gain,
            scatter=valve.scatter,
            actuator=valve.actuator,
        )
        for share in shares
    ]


def _operated(
    loop: PlantLoop, operation: OperatingChange | None, rng: np.random.Generator
) -> PlantLoop:
    """The loop operated differently, with the same valve, transmitter and process."""
    controller = loop.controller
    if operation is OperatingChange.OPENING:
        offset = 12.0 if controller.output < 50.0 else -12.0
        return replace(loop, controller=replace(controller, output=controller.output + offset))
    if operation is OperatingChange.LOAD:
        loads = tuple(replace(load, size=2.5 * load.size) for load in loop.loads)
        return replace(loop, loads=loads)
    if operation is OperatingChange.TUNING:
        slower = replace(controller, gain=0.5 * controller.gain, reset_s=1.5 * controller.reset_s)
        return replace(loop, controller=slower)
    if operation is OperatingChange.SETPOINTS:
        return replace(loop, setpoints=_steps(loop, (2.0, 10.0), rng))
    return loop


def _window(loop: PlantLoop, valve: SimulatedValve, rng: np.random.Generator) -> PlantLoop:
    """One later window: set points, where the loop has any, move anew by steps of their size."""
    window = replace(loop, valve=valve, duration_s=WINDOW_S)
    if not loop.setpoints:
        return window
    heights = [loop.controller.set_point, *(height for _, height in loop.setpoints)]
    moves = np.abs(np.diff(heights)) / _per_travel(loop)
    moves = moves[moves > 0]
    if not moves.size:
        return window
    return replace(window, setpoints=_steps(window, (moves.min(), moves.max()), rng))


def _steps(
    loop: PlantLoop, travel: tuple[float, float], rng: np.random.Generator
) -> tuple[tuple[float, float], ...]:
    return draw_setpoints(
        loop.process, loop.controller, rng, duration_s=loop.duration_s, travel=travel
    )


def _per_travel(loop: PlantLoop) -> float:
    """Percent of set point that moves the valve by one percent, as ``draw_setpoints`` counts."""
    return 1.0 / loop.controller.gain if loop.process.integrating else loop.process.gain


def _score(baseline: NarxNetwork, window: PlantLoop, chance: int) -> BaselineScore:
    recording = simulate_loop(window, chance).recording
    assert recording.mv is not None
    return score_baseline(
        baseline,
        recording.op.values,
        recording.mv.values,
        recording.usable,
        interval_s=recording.interval_s,
    )


def scores(followed: Sequence[Followed], *fates: ValveFate) -> list[float]:
    """The scores of the valves with one of these fates, where they have one."""
    return [valve.score for valve in followed if valve.fate in fates and valve.score is not None]


def calibrated_limit(healthy: Sequence[float], share: float) -> float | None:
    """The lowest limit, in tenths, that at most ``share`` of ``healthy`` exceed.

    ``None`` where there is no healthy score. A small share rests on few scores: with 200 of them,
    2 % are the four highest.
    """
    if not healthy:
        return None
    limit = float(np.quantile(healthy, 1.0 - share, method="higher"))
    return float(np.ceil(10.0 * limit - 1e-9) / 10.0)


def areas(followed: Sequence[Followed]) -> dict[str, Estimate]:
    """The area under the curve of growing stiction against each kind of healthy valve.

    The last one leaves out nothing: a valve that could not be scored raises no alarm, so it ranks
    below all that were.
    """
    growing = scores(followed, ValveFate.GROWING)
    estimates = {fate.value: area_estimate(growing, scores(followed, fate)) for fate in HEALTHY}
    estimates["both"] = area_estimate(growing, scores(followed, *HEALTHY))
    ranked = [(valve.fate, valve.score or 0.0) for valve in followed]
    estimates["both, a refusal being no alarm"] = area_estimate(
        [score for fate, score in ranked if fate is ValveFate.GROWING],
        [score for fate, score in ranked if fate in HEALTHY],
    )
    return estimates


def limits(calibration: Sequence[Followed]) -> dict[str, float]:
    """The limits that alarms are counted with: name, ratio."""
    healthy = scores(calibration, *HEALTHY)
    limits = {
        f"calibrated, {share:.0%}": calibrated_limit(healthy, share) for share in FALSE_ALARMS
    }
    named = {name: limit for name, limit in limits.items() if limit is not None}
    return {**named, "watch limit": Limits().baseline_ratio_watch}


def alarms(followed: Sequence[Followed], limit: float) -> list[tuple[str, int, int]]:
    """Rows of (group of valves, number of alarms, number of scored valves)."""
    groups = [(fate.value, scores(followed, fate)) for fate in ValveFate]
    grown = [valve for valve in followed if valve.fate is ValveFate.GROWING]
    for low, high in _BANDS:
        band = [valve for valve in grown if low <= round(valve.S, 6) < high]
        upto = f"{low:g} to {high:g} %" if high < 100.0 else f"{low:g} % and more"
        groups.append((f"growing, to S of {upto}", scores(band, ValveFate.GROWING)))
    rows = [(name, sum(score > limit for score in group), len(group)) for name, group in groups]
    alarmed = sum((valve.score or 0.0) > limit for valve in grown)
    return [*rows, ("growing, with those refused", alarmed, len(grown))]


def as_json(followed: Sequence[Followed], calibration: Sequence[Followed]) -> dict[str, Any]:
    """The complete result as JSON."""
    return {
        "target_auc": TARGET,
        "auc": {name: asdict(area) for name, area in areas(followed).items()},
        "limits": {
            name: {
                "ratio": limit,
                "alarms": [
                    {
                        "of": group,
                        "alarms": count,
                        "scored": total,
                        "interval": wilson(count, total),
                    }
                    for group, count, total in alarms(followed, limit)
                ],
            }
            for name, limit in limits(calibration).items()
        },
        "followed": [_as_row(valve) for valve in followed],
        "calibration": [_as_row(valve) for valve in calibration],
    }


def _as_row(valve: Followed) -> dict[str, Any]:
    row = asdict(valve) | {"score": valve.score}
    # As files that were written earlier call it.
    row["way"] = row.pop("fate")
    return row
