"""How often a reading that wanders is told, and one that is true is not.

    python tests/benchmarks/bench_wandering_reading.py [--valves N] [--seed N]

Six hours of valves simulated by force balance, healthy and sticking, kept every 5 and 30 s, as they
are and with a wave of 2 % of travel, from lowest to highest, of 20, 60 and 120 minutes on the
position.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from stemwatch.models.record_checks.wandering_reading import find_wander
from stemwatch.models.recording import Recording, Role
from stemwatch.models.studies.simulator import draw_healthy, draw_sticky
from tests.benchmarks.bench_on_a_stop import kept_every
from tests.benchmarks.bench_shaken_band import hours_of

KEPT_S = (5, 30)
MINUTES = (20.0, 60.0, 120.0)
PERCENT = 2.0


def with_wave(recording: Recording, minutes: float) -> Recording:
    """The ``recording`` with a wave on its position."""
    assert recording.mv is not None
    time_s = np.arange(len(recording)) * recording.interval_s
    wave = 0.5 * PERCENT * np.sin(2.0 * np.pi * time_s / (60.0 * minutes))
    mv = replace(recording.mv, values=recording.mv.values + wave)
    return replace(recording, signals={**recording.signals, Role.MV: mv})


def main() -> None:
    """Draw, look, print a line for each kind of valve."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--valves", type=int, default=12)
    parser.add_argument("--seed", type=int, default=6161)
    options = parser.parse_args()
    for name, draw in (("healthy", draw_healthy), ("sticking", draw_sticky)):
        true, told = 0, dict.fromkeys(MINUTES, 0)
        for number, loop in enumerate(draw(options.valves, options.seed)):
            hours = hours_of(loop, 0.0, options.seed + number)
            for step in KEPT_S:
                recording = kept_every(hours, step)
                true += find_wander(recording) is not None
                for minutes in MINUTES:
                    told[minutes] += find_wander(with_wave(recording, minutes)) is not None
        of = len(KEPT_S) * options.valves
        waves = ", ".join(f"{minutes:g} min {count}" for minutes, count in told.items())
        print(f"{name}, of {of}: true readings told {true}; waves told {waves}", flush=True)


if __name__ == "__main__":
    main()
