"""How often the steps of a slow archive show a dead band, on valves that stick and on slow ones.

    python tests/benchmarks/bench_dead_band.py [--valves N] [--seed N]

Six hours of valves simulated by force balance at 1 s, kept every 5, 10 and 30 s: healthy ones,
also behind lags of up to a minute, which must show none, and sticking ones.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import numpy as np

from stemwatch.models.decision.shaken_loose import WIDE, is_sure
from stemwatch.models.recording import Recording
from stemwatch.models.signals.dead_band import find_dead_bands
from stemwatch.models.studies.simulator import PlantLoop, draw_healthy, draw_sticky, simulate_loop
from stemwatch.models.studies.simulator.hidden.hidden_effect import with_actuator

HOURS = 6
KEPT_S = (5, 10, 30)
LAGS_S = (0.0, 4.0, 12.0, 30.0, 60.0)


def hours_of(loop: PlantLoop, lag_s: float, seed: int) -> Recording:
    """Six hours of ``loop`` behind a lag, its set points again and again."""
    longer = loop.lasting(HOURS * 3600.0)
    return simulate_loop(
        with_actuator(longer, air_lag_s=lag_s) if lag_s else longer, seed
    ).recording


def is_seen(recording: Recording) -> Iterator[bool]:
    """Whether a band is sure in the recording kept every 5, 10 and 30 s."""
    assert recording.mv is not None
    usable = recording.usable & np.isfinite(recording.mv.values)
    mv = np.where(usable, recording.mv.values, 0.0)
    for step in KEPT_S:
        bands = find_dead_bands(recording.op.values[::step], mv[::step], usable[::step])
        yield is_sure([band for band in bands if band.percent >= WIDE])


def main() -> None:
    """Draw, look, print a line for each kind of valve."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--valves", type=int, default=8)
    parser.add_argument("--seed", type=int, default=6161)
    options = parser.parse_args()
    kinds = [
        *(("healthy", draw_healthy, lag_s) for lag_s in LAGS_S),
        ("sticking", draw_sticky, 0.0),
    ]
    for name, draw, lag_s in kinds:
        seen = [
            sure
            for number, loop in enumerate(draw(options.valves, options.seed))
            for sure in is_seen(hours_of(loop, lag_s, options.seed + number))
        ]
        print(f"{name}, lag of {lag_s:g} s: sure in {sum(seen)} of {len(seen)}", flush=True)


if __name__ == "__main__":
    main()
