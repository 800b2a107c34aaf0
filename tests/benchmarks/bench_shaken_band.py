"""Whether the S that noise of OP hides from a slow archive is doubted, and no more than that.

    python tests/benchmarks/bench_shaken_band.py [--valves N] [--seed N]

Six hours of valves simulated by force balance at 1 s, with the noise of OP as drawn and with 0.3,
0.6 and 1.2 % of it, kept every 5, 10, 30 and 60 s. Of sticking valves the S that may be there must
reach the sticky limit wherever the S that is seen does not; healthy ones in loops as they are drawn
should stay below it.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from stemwatch.models.decision.shaken_loose import S_unseen
from stemwatch.models.limits import Limits
from stemwatch.models.recording import Recording
from stemwatch.models.stickslip.fit import fit_stickslip
from stemwatch.models.studies.simulator import PlantLoop, draw_healthy, draw_sticky, simulate_loop
from tests.benchmarks.bench_on_a_stop import kept_every

HOURS = 6
KEPT_S = (5, 10, 30, 60)
NOISES = (0.0, 0.3, 0.6, 1.2)  # percent of OP; 0: as it is drawn


def hours_of(loop: PlantLoop, noise: float, seed: int) -> Recording:
    """Six hours of ``loop``, its set points again and again, with so much ``noise`` on OP."""
    transmitters = loop.transmitters
    if noise:
        pv_noise = noise / max(loop.controller.gain, 1e-6)
        transmitters = replace(transmitters, pv_noise=pv_noise)
    longer = replace(loop.lasting(HOURS * 3600.0), transmitters=transmitters)
    return simulate_loop(longer, seed).recording


def seen_and_unseen(recording: Recording) -> Iterator[tuple[float, float]]:
    """The S that is seen and the S that may be there, percent, of the recording kept every 5, 10,
    30 and 60 s."""
    for step in KEPT_S:
        kept = kept_every(recording, step)
        fit = fit_stickslip(kept)
        yield fit.S, S_unseen(fit, fit.S)


def main() -> None:
    """Draw, look, print a line for each kind of valve and each noise."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--valves", type=int, default=8)
    parser.add_argument("--seed", type=int, default=6161)
    options = parser.parse_args()
    limit = Limits().sticky_S_percent
    for name, draw in (("healthy", draw_healthy), ("sticking", draw_sticky)):
        for noise in NOISES:
            levels = np.array(
                [
                    pair
                    for number, loop in enumerate(draw(options.valves, options.seed))
                    for pair in seen_and_unseen(hours_of(loop, noise, options.seed + number))
                ]
            )
            small = levels[:, 0] < limit
            doubted = small & (levels[:, 1] >= limit)
            print(
                f"{name}, noise of OP {f'{noise:g} %' if noise else 'as drawn'}: S below "
                f"{limit:g} % in {small.sum()} of {small.size}, doubted {doubted.sum()}",
                flush=True,
            )


if __name__ == "__main__":
    main()
