"""How often a stop is seen where there is one, and where a stem only sticks or follows.

    python tests/benchmarks/bench_on_a_stop.py [--valves N] [--seed N]

Valves simulated by force balance, as they are and with a stop 2 to 6 % of travel inside what they
reached, kept every 1, 5 and 10 s.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from stemwatch.models.record_checks.on_a_stop import find_stop
from stemwatch.models.recording import Recording, Signal
from stemwatch.models.studies.simulator import PlantLoop, draw_healthy, draw_sticky, simulate_loop
from stemwatch.models.studies.simulator.defects import BodyDefects

KEPT_S = (1, 5, 10)


def kept_every(recording: Recording, step: int) -> Recording:
    """The ``recording`` with every ``step``-th sample."""
    signals = {
        role: Signal(
            signal.values[::step],
            quality=signal.quality[::step],
            tag=signal.tag,
            unit=signal.unit,
        )
        for role, signal in recording.signals.items()
    }
    return replace(recording, signals=signals, interval_s=step * recording.interval_s)


def with_stop(loop: PlantLoop, highest: float, rng: np.random.Generator) -> PlantLoop:
    """``loop`` with a stop 2 to 6 % below the ``highest`` place that it reached."""
    body = BodyDefects(high_percent=highest - float(rng.uniform(2.0, 6.0)))
    return replace(loop, valve=replace(loop.valve, body=body))


def main() -> None:
    """Draw, look, print a line for each kind of valve."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--valves", type=int, default=30)
    parser.add_argument("--seed", type=int, default=6161)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    for name, draw in (("healthy", draw_healthy), ("sticking", draw_sticky)):
        found = {"no stop": 0, "a stop": 0}
        for number, loop in enumerate(draw(options.valves, options.seed)):
            free = simulate_loop(loop, options.seed + number).recording
            assert free.mv is not None
            highest = float(np.percentile(free.mv.values, 99.0))
            stopped = simulate_loop(with_stop(loop, highest, rng), options.seed + number).recording
            for what, recording in (("no stop", free), ("a stop", stopped)):
                seen = [find_stop(kept_every(recording, step)) is not None for step in KEPT_S]
                found[what] += sum(seen)
        of = len(KEPT_S) * options.valves
        counts = ", ".join(f"{what}: {count} of {of} told" for what, count in found.items())
        print(f"{name}, {counts}", flush=True)


if __name__ == "__main__":
    main()
