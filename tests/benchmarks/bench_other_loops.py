"""Valves without a position in loops by another hand than those of the networks' training.

    python -m tests.benchmarks.bench_other_loops [--loops N] [--seed N]

Judges the loops of `other_loops.py` with the networks and limits that screening uses: what is said,
and what each part of the score separates by itself.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from stemwatch.models.without_position.features import NAMES
from stemwatch.models.without_position.suspicion import (
    Judge,
    Suspicion,
    look_at_loop,
    trained_judge,
)
from stemwatch.service.executors import choose_executor, map_in_order
from stemwatch.service.studies.detection_rates import area_under_roc
from stemwatch.service.studies.without_position.count import StudiedLoop, family_rows, studied
from stemwatch.service.studies.without_position.draw import LoopToDraw, SeenDraw
from tests.benchmarks.other_loops import draw

FAMILY = "by another hand"
GAIN = NAMES.index("gain of both at 25 to a period")
BEYOND = NAMES.index("gain of both beyond its surrogates")


@dataclass(frozen=True)
class Judged:
    """What is said of one loop, and the parts of its score."""

    kind: str
    said: StudiedLoop
    parts: dict[str, float]


def look_at(place: LoopToDraw) -> list[tuple[str, SeenDraw]]:
    """One loop as it is seen, and its kind."""
    loop = draw(place.seed, place.place)
    seen = look_at_loop(loop.recording)
    return [(loop.kind, SeenDraw(place=place, story=loop.cause, S=loop.S, seen=seen))]


def judged(judge: Judge, kind: str, seen_draw: SeenDraw) -> Judged:
    """One loop judged; without parts where OP and PV show nothing at all."""
    shown, windows = seen_draw.seen.shown, seen_draw.seen.windows
    said = studied(judge, seen_draw)
    if shown is None or windows is None:
        return Judged(kind, said, {})
    answer = judge.network.answer(shown.values, windows)
    parts = {
        "the element's gain": float(shown.values[GAIN]),
        "the gain beyond its surrogates": float(shown.values[BEYOND]),
        "network of the numbers": float(judge.network.dense(shown.values)[0]),
        "network of the curves": judge.network.by_curves(windows),
        "both networks": answer.score,
        "score": said.score or 0.0,
    }
    return Judged(kind, said, parts)


def report(loops: Sequence[Judged]) -> Iterator[str]:
    """Counts of sticking + sound loops, of all and by cause and kind; the AUC of each part."""
    row = next(iter(family_rows([loop.said for loop in loops])))
    yield _counts(f"all, {row.sticking} + {row.sound}", [loop.said for loop in loops])
    yield (
        f"score AUC {row.auc:.2f}, found at 2 and 5 % {row.sensitivity[0]:.2f}, "
        f"{row.sensitivity[1]:.2f}, by all rules {row.found[0]:.2f}, {row.found[1]:.2f}; "
        f"S off by {row.error:.2f} %, {row.held[0]} of {row.held[1]} intervals hold"
    )
    with_parts = [loop for loop in loops if loop.parts]
    sticky = np.array([loop.said.sticky for loop in with_parts])
    for part in with_parts[0].parts:
        values = np.array([loop.parts[part] for loop in with_parts])
        yield f"AUC {area_under_roc(values[sticky], values[~sticky]):.3f} {part}"
    for group in dict.fromkeys(loop.said.story for loop in loops):
        yield _counts(group, [loop.said for loop in loops if loop.said.story == group])
    for group in dict.fromkeys(loop.kind for loop in loops):
        yield _counts(group, [loop.said for loop in loops if loop.kind == group])


def _counts(name: str, said: Sequence[StudiedLoop]) -> str:
    counts = (
        f"{verdict.value} {sum(loop.sticky for loop in of_it)} + "
        f"{sum(not loop.sticky for loop in of_it)}"
        for verdict in Suspicion
        for of_it in [[loop for loop in said if loop.verdict is verdict]]
    )
    return f"{name}: {', '.join(counts)}; missed {sum(loop.should_have_shown for loop in said)}"


def main() -> None:
    """Draw, judge and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--loops", type=int, default=1200)
    parser.add_argument("--seed", type=int, default=4070)
    parser.add_argument("--workers", type=int, default=None)
    given = parser.parse_args()
    judge = trained_judge()
    places = [LoopToDraw(given.seed, place, FAMILY) for place in range(given.loops)]
    executor = choose_executor(given.workers)
    found = map_in_order(executor, look_at, places, lambda _: None)
    for line in report([judged(judge, kind, seen_draw) for kind, seen_draw in found]):
        print(line)


if __name__ == "__main__":
    main()
