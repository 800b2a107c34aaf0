"""In how few samples loops that have nothing to do with each other look alike, and plants with a
source still show it.

    python -m tests.benchmarks.bench_short_groups [--sets N] [--seed N]

Sets of loops that are each of another plant, at 10 s and (healthy valves) at 1 s, and plants of
interacting loops, by the number of samples that were recorded. ``FEWEST`` of ``plant_groups`` is
the shortest record at 10 s from which on no set has a group, ``SHORTEST_S`` that at 1 s.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from datetime import UTC, datetime

from stemwatch.models.oscillation_groups import plant_groups as whole_plant
from stemwatch.models.studies.interacting_loops.score_plant import (
    UNRELATED,
    first_hours,
    plant_of,
    score_plant,
    unrelated_of,
)
from stemwatch.models.studies.simulator import draw_healthy, simulate_loop

SAMPLES = (180, 240, 360, 480, 720, 1440)
LONGEST_S = 1800.0
QUICK_SEEDS = range(4060, 4080)  # of development; a set of unrelated valves at 1 s each
AT = datetime(2026, 1, 1, tzinfo=UTC)


def at_ten_seconds(seed: int, number: int) -> list[bool]:
    """Whether a set of unrelated loops has a group, by the samples that were recorded."""
    plant = unrelated_of(seed, number)
    hours = [samples * plant.interval_s / 3600.0 for samples in SAMPLES]
    return [bool(score_plant(first_hours(plant, each)).groups) for each in hours]


def of_a_plant(seed: int, number: int) -> tuple[bool, list[bool]]:
    """Whether nothing oscillates in a plant, and whether it has a group, by the samples."""
    plant = plant_of(seed, number)
    hours = [samples * plant.interval_s / 3600.0 for samples in SAMPLES]
    scored = [score_plant(first_hours(plant, each)) for each in hours]
    return scored[-1].quiet, [bool(each.groups) for each in scored]


def at_one_second(seed: int) -> list[bool]:
    """The same of ``UNRELATED`` healthy valves, each simulated by itself, as a run groups them."""
    recordings = [
        simulate_loop(loop.lasting(LONGEST_S), 100 * seed + number).recording
        for number, loop in enumerate(draw_healthy(UNRELATED, seed))
    ]
    found = []
    for samples in SAMPLES:
        loops = []
        for number, recording in enumerate(recordings):
            thinned = whole_plant.thinned_loop(recording.part(0, samples))
            if thinned is not None:
                loops.append(replace(thinned, loop=f"L{number}", source="plc-1", start=AT))
        found.append(bool(whole_plant.plant_groups(loops)))
    return found


def main() -> None:
    """Draw, look, print a line for each number of samples."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sets", type=int, default=80)
    parser.add_argument("--seed", type=int, default=5151)
    options = parser.parse_args()
    whole_plant.FEWEST, whole_plant.SHORTEST_S = SAMPLES[0], 0.0  # to see what is left out
    unrelated = [at_ten_seconds(options.seed, number) for number in range(options.sets)]
    quick = [at_one_second(seed) for seed in QUICK_SEEDS]
    plants = [of_a_plant(options.seed, number) for number in range(options.sets)]
    quiet = [found for is_quiet, found in plants if is_quiet]
    moved = [found for is_quiet, found in plants if not is_quiet]
    print("samples | unrelated loops, 10 s | the same, 1 s | quiet plants | plants with a source")
    for place, samples in enumerate(SAMPLES):
        counts = [
            f"{sum(found[place] for found in group)} of {len(group)}"
            for group in (unrelated, quick, quiet, moved)
        ]
        print(" | ".join([f"{samples:>7}", *counts]))


if __name__ == "__main__":
    main()
