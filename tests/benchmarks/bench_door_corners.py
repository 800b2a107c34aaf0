"""What the corners of a swinging door leave of S: is it told, and does its interval hold the truth?

    python tests/benchmarks/bench_door_corners.py [--valves N] [--seed N]

Six hours of healthy and sticky valves, simulated by force balance at 1 s. OP, position and PV go
through swinging doors of 0.3, 0.5 and 1 % of span, and their corners are written as an export, read
and screened. For each door: how many exports are taken for corners, the verdicts by the true S, how
often its interval holds it, and its error in deviations.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from stemwatch.connectors.connector import TagMapping, ValveTags
from stemwatch.connectors.historian import HistorianFile, ReadOptions
from stemwatch.models.limits import Limits
from stemwatch.models.recording import Recording, Role
from stemwatch.models.screening.screen import Case, Options, screen
from stemwatch.models.studies.simulator import draw_healthy, draw_sticky, simulate_loop
from stemwatch.models.studies.simulator.historian import swinging_door

HOURS = 6
DOORS = (0.3, 0.5, 1.0)  # percent
TAGS = {Role.OP: "OP", Role.MV: "ZT", Role.PV: "PV"}
START = datetime(2026, 3, 2, 6, tzinfo=UTC)


def through_door(recording: Recording, door: float, folder: Path) -> Recording:
    """The recording as it is read from an export of its corners."""
    rows: list[tuple[float, str]] = []
    tags = {role: tag for role, tag in TAGS.items() if role in recording.signals}
    for role, tag in tags.items():
        values = recording.signals[role].values
        for place in np.flatnonzero(swinging_door(values, door)).tolist():
            at = START + timedelta(seconds=place * recording.interval_s)
            rows.append((place, f"{tag},{at.isoformat()},{values[place]:.3f}\n"))
    path = folder / "export.csv"
    path.write_text("Tag,Time,Value\n" + "".join(row for _, row in sorted(rows)))
    mappings = {
        role: TagMapping(tag=tag, unit="" if role is Role.PV else "%") for role, tag in tags.items()
    }
    return HistorianFile(path, ReadOptions()).read(ValveTags(valve="A", tags=mappings))


def main() -> None:
    """Draw, store, read, screen; print a block for each door."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--valves", type=int, default=8)
    parser.add_argument("--seed", type=int, default=6161)
    options = parser.parse_args()
    draws = [
        *draw_healthy(options.valves, options.seed),
        *draw_sticky(options.valves, options.seed),
    ]
    limits = Limits()
    runs = [
        simulate_loop(loop.lasting(HOURS * 3600.0), options.seed + number)
        for number, loop in enumerate(draws)
    ]
    recordings = [(run.truth.S, run.recording) for run in runs]
    for door in DOORS:
        taken, held, known = 0, 0, 0
        verdicts: Counter[tuple[str, str]] = Counter()
        errors: list[float] = []
        with tempfile.TemporaryDirectory() as folder:
            for S, recording in recordings:
                read = through_door(recording, door, Path(folder))
                taken += read.op.deviation is not None
                (result,) = screen([Case(recording=read)], Options(narx=False))
                size = (
                    f"S below {limits.watch_S_percent:g} %"
                    if limits.watch_S_percent > S
                    else f"S from {limits.sticky_S_percent:g} % on"
                    if limits.sticky_S_percent <= S
                    else "S between"
                )
                verdicts[size, result.verdict.value] += 1
                estimate = result.S
                if estimate.value is None or estimate.low is None or estimate.high is None:
                    continue
                known += 1
                held += estimate.low <= S <= estimate.high
                errors.append((estimate.value - S) / door)
        print(f"door of {door:g} %: {taken} of {len(recordings)} taken for corners")
        for (size, verdict), count in sorted(verdicts.items()):
            print(f"  {size}: {verdict} {count}")
        if errors:
            low, middle, high = np.percentile(errors, (10.0, 50.0, 90.0))
            print(
                f"  the interval holds S in {held} of {known}; error {low:.1f}, {middle:.1f}, "
                f"{high:.1f} deviations (10 %, median, 90 %)"
            )


if __name__ == "__main__":
    main()
