"""A blind count on simulated valves: how often is a healthy one called sticky, and the reverse?"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from stemwatch.models.narx.example import NarxSettings
from stemwatch.models.screening import Case, Options, screen
from stemwatch.models.screening_result import Screening
from stemwatch.models.studies.simulator import (
    PlantLoop,
    Truth,
    draw_healthy,
    draw_sticky,
    simulate_loop,
)
from stemwatch.models.verdict import Shape, Verdict
from stemwatch.service.executors import Executor, map_items

BATCH = 12


@dataclass(frozen=True)
class Marked:
    """One simulated valve: what it was, and what was said of it."""

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
    """Simulate, screen (which sees recordings only), and set the truth beside the verdict."""
    loops = [simulate_loop(loop, seed) for loop, seed in batch.loops]
    cases = [Case(recording=loop.recording) for loop in loops]
    # On the CPU, so that the counts are the same on every machine.
    found = screen(cases, Options(narx=batch.narx, narx_settings=NarxSettings(device="cpu")))
    return [_marked(loop.truth, one) for loop, one in zip(loops, found, strict=True)]


def _marked(truth: Truth, found: Screening) -> Marked:
    numbers = [
        None
        if estimate.value is None or estimate.low is None or estimate.high is None
        else (estimate.value, estimate.low, estimate.high)
        for estimate in (found.S, found.J)
    ]
    shape = found.shape.value if found.shape else None
    return Marked(truth, found.verdict, found.reason, shape, numbers[0], numbers[1], found.seconds)


def run_trial(
    loops: int, seed: int, executor: Executor, tell: Callable[[int], None], *, narx: bool = True
) -> list[Marked]:
    """Screen ``loops`` healthy and half as many sticking valves, drawn with ``seed``."""
    drawn = [*draw_healthy(loops, seed), *draw_sticky(loops // 2, seed)]
    seeded = [(loop, 1000 * seed + place) for place, loop in enumerate(drawn)]
    batches = [
        TrialBatch(tuple(seeded[first : first + BATCH]), narx)
        for first in range(0, len(seeded), BATCH)
    ]
    done: dict[int, list[Marked]] = {}
    for place, marked in map_items(executor, mark_batch, batches):
        done[place] = marked
        tell(sum(map(len, done.values())))
    return [one for place in sorted(done) for one in done[place]]


def wilson(hits: int, of: int) -> tuple[float, float]:
    """95 % interval of ``hits`` in ``of``, as shares: Wilson (1927).

    doi:10.1080/01621459.1927.10502953. Nothing counted is 0 to 1.
    """
    if of == 0:
        return 0.0, 1.0
    z, share = 1.959964, hits / of
    middle = share + z * z / (2 * of)
    half = z * float(np.sqrt(share * (1 - share) / of + z * z / (4 * of * of)))
    return max((middle - half) / (1 + z * z / of), 0.0), min(
        (middle + half) / (1 + z * z / of), 1.0
    )


def rates(marked: Sequence[Marked]) -> Iterator[tuple[str, str, int, int]]:
    """(of which loops, what was said, how many, of how many)."""
    stories = sorted({one.truth.story for one in marked})
    for name, group in [
        ("all healthy", [m for m in marked if m.truth.healthy]),
        ("all sticking", [m for m in marked if not m.truth.healthy]),
        *[(story, [m for m in marked if m.truth.story == story]) for story in stories],
    ]:
        counts = Counter(one.verdict for one in group)
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


def accuracy(marked: Sequence[Marked]) -> list[Accuracy]:
    """Errors in percent of span over the sticking valves for which there is a number."""
    found = []
    for name in ("S", "J"):
        pairs = [
            (getattr(one.truth, name), getattr(one, name))
            for one in marked
            if not one.truth.healthy and getattr(one, name) is not None
        ]
        errors = [abs(truth - value) for truth, (value, _, _) in pairs]
        within = sum(low <= truth <= high for truth, (_, low, high) in pairs)
        median = float(np.median(errors)) if errors else float("nan")
        found.append(Accuracy(name, median, within, len(pairs)))
    return found


def shapes(marked: Sequence[Marked]) -> list[tuple[str, int, int]]:
    """(true shape, how many were given it, of how many sticking valves that were given a shape)."""
    named = [one for one in marked if one.truth.shape is not None and one.shape is not None]
    return [
        (
            shape.value,
            sum(one.truth.shape is shape and one.shape == shape.value for one in named),
            sum(one.truth.shape is shape for one in named),
        )
        for shape in Shape
    ]
