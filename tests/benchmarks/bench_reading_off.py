"""Whether a reading that is off by several percent is named, on valves that follow closely.

    python tests/benchmarks/bench_reading_off.py [--valves N] [--seed N]

Six hours of healthy valves simulated by force balance, kept every 1, 5 and 10 s, with the reading
of the position moved by 0, 3, 5 and 7 % of travel up or down, and its span off by up to 1.5 %. A
zero that is off by 3 % and more is named where the valve page says so; one of 0 % must not be given
work.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from stemwatch.models.recording import Recording, Role
from stemwatch.models.screening.screen import Case, Options, screen
from stemwatch.models.studies.simulator import draw_healthy, simulate_loop
from stemwatch.models.verdict import Verdict

HOURS = 6
KEPT_S = (1, 5, 10)
OFF = (0.0, 3.0, 5.0, 7.0)  # percent of travel
SPAN = 0.015  # at most


def kept(recording: Recording, step: int, off: float, span: float) -> Recording:
    """Every ``step``-th sample, the position read ``off`` percent high with a ``span`` about
    mid-travel."""
    signals = {
        role: replace(signal, values=signal.values[::step], quality=signal.quality[::step])
        for role, signal in recording.signals.items()
    }
    mv = signals[Role.MV]
    signals[Role.MV] = replace(mv, values=50.0 + off + span * (mv.values - 50.0))
    return replace(recording, signals=signals, interval_s=step * recording.interval_s)


def main() -> None:
    """Draw, keep, screen, print a line for each zero."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--valves", type=int, default=8)
    parser.add_argument("--seed", type=int, default=6161)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    loops = draw_healthy(options.valves, options.seed)
    records = [
        simulate_loop(loop.lasting(HOURS * 3600.0), options.seed + number).recording
        for number, loop in enumerate(loops)
    ]
    for off in OFF:
        named = healthy = total = 0
        for record in records:
            for step in KEPT_S:
                moved = kept(record, step, rng.choice((-off, off)), 1.0 + rng.uniform(-SPAN, SPAN))
                (one,) = screen([Case(recording=moved)], Options(narx=False))
                effects = () if one.mismatch is None else one.mismatch.effects
                work = any(
                    effect.slug in ("zero_shift", "span_error") and not effect.inherent
                    for effect in effects
                )
                total += 1
                named += work
                healthy += one.verdict is Verdict.HEALTHY and not work
        print(
            f"off by {off:g} %: named {named} of {total}, healthy without it {healthy}", flush=True
        )


if __name__ == "__main__":
    main()
