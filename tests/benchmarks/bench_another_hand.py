"""Names, S and false alarms on valves that were simulated by other equations (``another_hand``).

    python -m tests.benchmarks.bench_another_hand [--draw N] [--valves N] [--nulls N] [--only SLUG]

Of each effect it prints how often it is named: as the first name or in its class, as a further
name, only another effect, ``unknown`` or nothing; of valves with nothing hidden, how many are given
a name, how many of these a name that asks for work, and how many are ``unknown``. The level is that
of breakaway, (S + J)/2, which the air in the chamber does not change; it shortens the slips.
Valves whose positioner has an integral part are counted apart: it is not in the catalogue.
"""

from __future__ import annotations

import argparse
from collections import Counter, defaultdict

import numpy as np

from stemwatch.models.mismatch.explain import explain
from stemwatch.models.mismatch.findings import Finding, Mismatch
from tests.benchmarks.another_hand import EFFECTS, NOTHING, HandValve, draw_hand_valve

FIRST, FURTHER, OTHER, UNKNOWN, NONE = "first", "further", "another", "unknown", "none"
NO_WORK = "no work"


def outcome(valve: HandValve, said: Mismatch) -> str:
    """How a valve ended, by what was hidden and what was said."""
    if not said.effects:
        return UNKNOWN if said.finding is Finding.UNKNOWN else NONE
    if valve.hidden == NOTHING:
        return NO_WORK if all(effect.inherent for effect in said.effects) else OTHER
    holds = [valve.hidden in effect.members for effect in said.effects]
    if holds[0]:
        return FIRST
    return FURTHER if any(holds) else OTHER


def main() -> None:
    """Draw, explain, count."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draw", type=int, default=1)
    parser.add_argument("--valves", type=int, default=4)
    parser.add_argument("--nulls", type=int, default=24)
    parser.add_argument("--only", action="append")
    options = parser.parse_args()
    counts, off = defaultdict[str, Counter[str]](Counter), defaultdict[str, list[float]](list)
    for hidden in options.only or (NOTHING, *EFFECTS):
        for number in range(options.nulls if hidden == NOTHING else options.valves):
            valve = draw_hand_valve(hidden, 1000 * options.draw + number)
            said = explain(valve.recording)
            row = f"{hidden} beside integral action" if valve.positioner else hidden
            counts[row][outcome(valve, said)] += 1
            S, J = said.restated.S.value, said.restated.J.value
            if S is not None and J is not None:
                off[row].append(abs(S + J - valve.S - valve.J) / (valve.S + valve.J))
            names = ", ".join("/".join(effect.members) for effect in said.effects)
            print(f"  {row} {number}: {said.finding.value} {names}", flush=True)
    words = (FIRST, FURTHER, OTHER, UNKNOWN, NONE, NO_WORK)
    print(f"{'hidden':52s}" + "".join(f"{word:>9s}" for word in words) + "  level off, median")
    for row, count in counts.items():
        middle = f"{100.0 * np.median(off[row]):.0f} %" if off[row] else "-"
        print(f"{row:52s}" + "".join(f"{count[word]:9d}" for word in words) + f"  {middle}")


if __name__ == "__main__":
    main()
