"""A blind count on simulated valves: how often is a healthy one called sticky, and the reverse?"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from stemwatch.models.narx.example import NarxSettings
from stemwatch.models.screening.screen import Case, Options, screen
from stemwatch.models.screening_result import Screening
from stemwatch.models.studies.simulator import (
    PlantLoop,
    Truth,
    draw_healthy,
    draw_sticky,
    simulate_loop,
)
from stemwatch.models.verdict import Shape, Verdict
from stemwatch.service.executors import Executor, map_in_order

BATCH = 12


@dataclass(frozen=True)
class Marked:
    """One simulated valve: its truth and the result of its screening."""

    truth: Truth
    verdict: Verdict
    reason: str
    shape: str | None
    S: tuple[float, float, float] | None  # value, low, high; percent
    J: tuple[float, float, float] | None
    seconds: float


@dataclass(frozen=True)
class TrialBatch:
    """Loops that one worker simulates and screens."""

    loops: tuple[tuple[PlantLoop, int], ...]
    narx: bool


def mark_batch(batch: TrialBatch) -> list[Marked]:
    """Simulate, screen the recordings alone, and put each truth beside its verdict."""
    loops = [simulate_loop(loop, seed) for loop, seed in batch.loops]
    cases = [Case(recording=loop.recording) for loop in loops]
    # On the CPU, so that the counts are the same on every machine.
    screenings = screen(cases, Options(narx=batch.narx, narx_settings=NarxSettings(device="cpu")))
    return [_mark(loop.truth, valve) for loop, valve in zip(loops, screenings, strict=True)]


def _mark(truth: Truth, screening: Screening) -> Marked:
    return Marked(
        truth=truth,
        verdict=screening.verdict,
        reason=screening.reason,
        shape=screening.shape.value if screening.shape else None,
        S=screening.S.with_interval,
        J=screening.J.with_interval,
        seconds=screening.seconds,
    )


def run_trial(
    loops: int,
    seed: int,
    executor: Executor,
    on_progress: Callable[[int], None],
    *,
    narx: bool = True,
) -> list[Marked]:
    """Screen ``loops`` healthy and half as many sticking valves, drawn with ``seed``."""
    valves_drawn = [*draw_healthy(loops, seed), *draw_sticky(loops // 2, seed)]
    seeded = [(loop, 1000 * seed + index) for index, loop in enumerate(valves_drawn)]
    batches = [
        TrialBatch(tuple(seeded[first : first + BATCH]), narx)
        for first in range(0, len(seeded), BATCH)
    ]
    return map_in_order(executor, mark_batch, batches, on_progress)


def rates(marks: Sequence[Marked]) -> Iterator[tuple[str, str, int, int]]:
    """(group of loops, verdict, how many, of how many)."""
    all_stories = sorted({valve.truth.story for valve in marks})
    for name, group in [
        ("all healthy", [m for m in marks if m.truth.healthy]),
        ("all sticking", [m for m in marks if not m.truth.healthy]),
        *[
            (story_name, [m for m in marks if m.truth.story == story_name])
            for story_name in all_stories
        ],
    ]:
        counts = Counter(valve.verdict for valve in group)
        for verdict in Verdict:
            if counts[verdict]:
                yield name, verdict.value, counts[verdict], len(group)


@dataclass(frozen=True)
class Accuracy:
    """S or J of the sticking valves: median absolute error, and how often the interval holds."""

    name: str
    median_error: float
    within: int
    of: int


def accuracy(marks: Sequence[Marked]) -> list[Accuracy]:
    """Errors in percent of span over the sticking valves for which there is a number."""
    figures = []
    for name in ("S", "J"):
        pairs = [
            (getattr(valve.truth, name), getattr(valve, name))
            for valve in marks
            if not valve.truth.healthy and getattr(valve, name) is not None
        ]
        errors = [abs(truth - value) for truth, (value, _, _) in pairs]
        within = sum(low <= truth <= high for truth, (_, low, high) in pairs)
        median = float(np.median(errors)) if errors else float("nan")
        figures.append(Accuracy(name, median, within, len(pairs)))
    return figures


def shapes(marks: Sequence[Marked]) -> list[tuple[str, int, int]]:
    """(true shape, how many were given it, of how many sticking valves that were given a shape)."""
    named = [valve for valve in marks if valve.truth.shape is not None and valve.shape is not None]
    return [
        (
            shape.value,
            sum(valve.truth.shape is shape and valve.shape == shape.value for valve in named),
            sum(valve.truth.shape is shape for valve in named),
        )
        for shape in Shape
    ]
