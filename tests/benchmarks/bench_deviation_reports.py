"""What tells reports by a deviation from lines between stored points and from uneven scans.

    python tests/benchmarks/bench_deviation_reports.py [--valves N] [--seed N]

Two hours of valves simulated by force balance at 1 s. OP, position and PV are stored when they have
moved by 0.1 to 1 % of span since the last report, by swinging doors of the same width, and at scans
that come when they please; the position also rounded to 0.1 % before. Of each kind: the share of
changes that are less than twice the smallest (2nd percentile), and how many tags are taken for
reports by a deviation.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import numpy as np

from stemwatch.connectors.historian.times.deviation_reports import (
    FEW,
    by_deviation,
    share_near_smallest,
)
from stemwatch.connectors.historian.times.timeline import Timeline
from stemwatch.models.recording import Bools, Floats, Recording, Role
from stemwatch.models.studies.simulator import draw_healthy, draw_sticky, simulate_loop
from stemwatch.models.studies.simulator.historian import swinging_door

HOURS = 2
DEVIATIONS = (0.1, 0.25, 0.5, 1.0)  # percent
HEARTBEAT = 600  # samples


def exceptions(values: Floats, deviation: float) -> Bools:
    """(n,) True where a report is stored: after a move by more than ``deviation``, and every ten
    minutes."""
    stored = np.zeros(values.size, dtype=bool)
    stored[0], last = True, 0
    for place in range(1, values.size):
        if abs(values[place] - values[last]) > deviation or place - last >= HEARTBEAT:
            stored[place], last = True, place
    return stored


def scans(count: int, every: float, rng: np.random.Generator) -> Bools:
    """(count,) True at scans that come at random, every so many samples on average."""
    return np.asarray(rng.random(count) < 1.0 / every)


def tags_of(recording: Recording) -> Iterator[Floats]:
    """OP, position, position in steps of 0.1 %, and PV in percent of its swing."""
    mv, pv = recording.mv, recording.signals.get(Role.PV)
    yield recording.op.values
    if mv is not None:
        yield mv.values
        yield np.round(mv.values, 1)
    if pv is not None:
        yield 30.0 * pv.values / np.ptp(pv.values)


def ways(values: Floats, rng: np.random.Generator) -> Iterator[tuple[str, Bools]]:
    """Which samples each archive stores of ``values`` (n,)."""
    for deviation in DEVIATIONS:
        yield "reports by a deviation", exceptions(values, deviation)
        yield "swinging door", swinging_door(values, deviation)
        yield "uneven scans", scans(values.size, 10.0 * deviation + 1.0, rng)


def main() -> None:
    """Draw, store, print a line for each kind of archive."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--valves", type=int, default=8)
    parser.add_argument("--seed", type=int, default=6161)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    shares: dict[str, list[float]] = {}
    taken: dict[str, int] = {}
    asked: dict[str, int] = {}
    loops = [
        *draw_healthy(options.valves, options.seed),
        *draw_sticky(options.valves, options.seed),
    ]
    for number, loop in enumerate(loops):
        recording = simulate_loop(loop.lasting(HOURS * 3600.0), options.seed + number).recording
        for values in tags_of(recording):
            for kind, stored in ways(values, rng):
                times = Timeline(np.flatnonzero(stored).astype(np.int64) * 1_000_000_000)
                asked[kind] = asked.get(kind, 0) + 1
                taken[kind] = taken.get(kind, 0) + by_deviation(times, values[stored])
                near = share_near_smallest(times, values[stored])
                if near is not None:
                    few = ", few changes" if near[1] < FEW else ""
                    shares.setdefault(f"{kind}{few}", []).append(near[0])
    for kind, of_kind in shares.items():
        low, middle, high = np.percentile(of_kind, (2.5, 50.0, 97.5))
        print(
            f"{kind}: {len(of_kind)} tags, share {low:.2f}, {middle:.2f}, {high:.2f} (2.5 %, "
            "median, 97.5 %)"
        )
    for kind, count in taken.items():
        print(f"{kind}: taken for reports by a deviation {count} of {asked[kind]}")


if __name__ == "__main__":
    main()
