"""``explain`` per valve: seconds of processor time for an hour at 1 s, by what is in it.

    python tests/benchmarks/bench_explain.py [--valves 8] [--seed 6161] [--json FILE]

Loops with nothing hidden, with one effect of the catalogue, and with two; as many of each as
``--valves`` says, an hour with set-point moves. Medians and the slowest, on one core, without
networks and without pictures. Target: at most 1.0 s a valve.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import numpy as np

from stemwatch.models.mismatch.explain import explain
from stemwatch.models.recording import Recording
from stemwatch.models.studies.simulator.hidden import (
    PHYSICS,
    draw_effect,
    draw_hidden,
    draw_nulls,
)

ASKED_S = 1.0


def recordings(count: int, seed: int) -> dict[str, list[Recording]]:
    """``count`` recordings of each kind, an hour at 1 s with set-point moves."""
    pairs = [case for case in draw_hidden(80 * count, seed) if len(case.hidden) == 2]
    kinds = {
        "nothing hidden": draw_nulls(count, seed, "routine"),
        "one effect": [draw_effect(PHYSICS[n % len(PHYSICS)], 1, seed)[0] for n in range(count)],
        "two effects": [case for case in pairs if case.concealment == "routine"][:count],
    }
    return {name: [case.simulated().recording for case in cases] for name, cases in kinds.items()}


def measure(count: int, seed: int) -> list[dict[str, object]]:
    """One row for each kind of recording."""
    some = recordings(count, seed)
    explain(next(iter(some.values()))[0])  # compiled before the clock runs
    rows: list[dict[str, object]] = []
    for name, several in some.items():
        seconds = []
        for recording in several:
            started = time.process_time()
            explain(recording)
            seconds.append(time.process_time() - started)
        rows.append(
            {
                "recordings": name,
                "count": len(several),
                "median_s": round(float(np.median(seconds)), 2),
                "slowest_s": round(max(seconds), 2),
                "within_asked": sum(second <= ASKED_S for second in seconds),
            }
        )
    return rows


def main() -> None:
    """Read the options, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--valves", type=int, default=8)
    parser.add_argument("--seed", type=int, default=6161)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    rows = measure(arguments.valves, arguments.seed)
    print("".join(f"{name.replace('_', ' '):>18}" for name in rows[0]))
    for row in rows:
        print("".join(f"{cell:>18}" for cell in row.values()))
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
