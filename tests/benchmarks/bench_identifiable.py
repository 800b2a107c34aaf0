"""How many of the plays and dwells that are missed could any method name?

    python -m tests.benchmarks.bench_identifiable [--seed S] [--cases N]

The valves of ``stemwatch prove`` that hide one of the two, and whose record shows it, are
explained. Beside that stands what an observer finds who has the plant's own equations and all of
its numbers but those of the friction (``tests.benchmarks.true_stem``): the logarithm by which the
record is more likely with the effect, begun at the truth, than at the best without it. Of
compressed records he sees the readings before the archive. One line for each, and a table.
"""

from __future__ import annotations

import argparse
from collections import Counter

import numpy as np

from stemwatch.models.mismatch.explain import explain
from stemwatch.models.mismatch.likelihood.likelihood_evidence import LEAST_GAIN
from stemwatch.models.studies.simulator.hidden import draw_hidden, simulate_hidden
from tests.benchmarks.bench_ceiling import stored
from tests.benchmarks.true_stem import DWELL, PLAY, gain_of

EFFECTS = {"lost_motion": PLAY, "dwell_dependent_breakaway": DWELL}
BY_CHANCE = 4.5  # one number more: a score of 3
NOT_FOLLOWED = -5.0  # a gain below which his own courses have left the stem
COLUMNS = ("beyond the limit", "beyond chance", "not seen", "not followed")


def seen_as(gain: float) -> str:
    """How well the observer sees an effect that gains this."""
    if gain >= LEAST_GAIN:
        return "beyond the limit"
    if gain < NOT_FOLLOWED:
        return "not followed"
    return "beyond chance" if gain >= BY_CHANCE else "not seen"


def table(counts: Counter[tuple[str, bool, str]]) -> str:
    """How many were named and missed, by what the observer sees."""
    lines = [f"{'effect':26s}{'':8s}" + "".join(f"{head:>18s}" for head in COLUMNS)]
    for slug in EFFECTS:
        for named in (True, False):
            numbers = (counts[slug, named, column] for column in COLUMNS)
            of_row = "".join(f"{number:18d}" for number in numbers)
            lines.append(f"{slug:26s}{'named' if named else 'missed':8s}{of_row}")
    return "\n".join(lines)


def main() -> None:
    """Explain the valves, and let the observer see them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=4090)
    parser.add_argument("--cases", type=int, default=400)
    requested = parser.parse_args()
    counts: Counter[tuple[str, bool, str]] = Counter()
    for number, drawn in enumerate(draw_hidden(requested.cases, requested.seed), start=1):
        if len(drawn.hidden) != 1 or drawn.hidden[0] not in EFFECTS:
            continue
        case, run = simulate_hidden(drawn)
        if not case.excited:
            continue
        slug = case.hidden[0]
        mismatch = explain(stored(run.recording))
        named = any(slug in effect.members for effect in mismatch.effects)
        # A stem on bristles creeps before it lets go: these are not its equations.
        bristles = case.loop.valve.packing.presliding_percent > 0.0
        gain = -np.inf if bristles else gain_of(case, EFFECTS[slug])
        counts[slug, named, seen_as(gain)] += 1
        said = " and ".join(effect.slug for effect in mismatch.effects) or str(mismatch.finding)
        seen = f"{seen_as(gain)} ({gain:.0f})"
        print(f"{number:4d} {slug}, {case.concealment}: said {said}; {seen}", flush=True)
    print(table(counts))


if __name__ == "__main__":
    main()
