"""`explain` on a servo drive whose friction and load follow a law: names, S, coverage, slope.

    python tests/benchmarks/bench_servo_ladder.py [--every N] [--json FILE]

Reads `servo_ladder/` in the folder of recordings named by STEMWATCH_RECORDINGS, or in the one
beside the checkout, and nothing else. The law is read off each recording by a robust regression of
`command - position` on the sine of the angle, the sign of the speed, speed and acceleration, as the
folder's README describes it; it is written here anew and shares no code with the product.
"""

from __future__ import annotations

import argparse
import csv
import gzip
import json
import os
import sys
from collections import Counter
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import medfilt, savgol_filter

from stemwatch.connectors.connector import TagMapping, ValveTags
from stemwatch.connectors.historian import ReadOptions
from stemwatch.models.mismatch.explain import explain
from stemwatch.models.recording import Recording, Role
from stemwatch.service.run.task import open_file

RECORDINGS = "STEMWATCH_RECORDINGS"
BESIDE_THE_CHECKOUT = Path(__file__).parents[3] / "shared" / "recordings"
LOAD_NAMES = {"load_by_position", "flow_force", "span_error"}
CLEAR_LOAD, NO_LOAD = 2.0, 0.5  # percent of a turn
WINDOW, HOLE = 15, 1.5  # samples of the low pass; intervals between two samples that make a hole


@dataclass(frozen=True)
class Row:
    """One recording: what the law says and what `explain` does, percent of a turn."""

    file: str
    gain: float
    law_S: float
    law_load: float
    naive_S: float | None
    S: float | None
    low: float | None
    high: float | None
    names: tuple[str, ...]
    rmse_naive: float | None
    rmse_extended: float | None
    seconds: float

    @property
    def error(self) -> float:
        """How far S lies from the law; infinite where there is none."""
        return abs(self.S - self.law_S) if self.S is not None else np.inf

    @property
    def holds(self) -> bool:
        """True where the interval of S holds the law."""
        return (
            self.low is not None and self.high is not None and self.low <= self.law_S <= self.high
        )

    @property
    def loaded(self) -> bool:
        """True where a load is named, by any of its names."""
        return bool(LOAD_NAMES & set(self.names))


def folder() -> Path:
    """The folder of the ladder; ends with a sentence where there is none."""
    results = Path(os.environ.get(RECORDINGS) or BESIDE_THE_CHECKOUT) / "servo_ladder"
    if not (results / "conditions.csv").is_file():
        sys.exit(
            f"bench_servo_ladder: no conditions.csv in {results}; set {RECORDINGS} to the folder "
            "of recordings that holds servo_ladder/"
        )
    return results


def read(path: Path) -> Recording:
    """The recording as a user reads it: OP and MV by their columns."""
    tags = {Role.OP: TagMapping(tag="OP"), Role.MV: TagMapping(tag="MV")}
    return open_file(str(path), ReadOptions()).read(ValveTags(valve=path.name[:-7], tags=tags))


def law(path: Path) -> tuple[float, float]:
    """S and the load's amplitude by the rig's law, percent of a turn."""
    with gzip.open(path, "rt", encoding="utf-8", newline="") as text:
        rows = list(csv.DictReader(text))
    t = np.array([row["Time"].rstrip("Z") for row in rows], dtype="datetime64[ms]").astype(float)
    op, mv = (np.array([float(row[name]) for row in rows]) for name in ("OP", "MV"))
    dt = float(np.median(np.diff(t))) / 1000.0
    edges = [0, *(np.flatnonzero(np.diff(t) > HOLE * 1000.0 * dt) + 1).tolist(), t.size]
    columns, off = [], []
    for begin, end in pairwise(edges):
        if end - begin < 2 * WINDOW:
            continue
        middle = medfilt(mv[begin:end], 7)
        clean = np.where(np.abs(mv[begin:end] - middle) > 3.0, middle, mv[begin:end])
        x, v, a = (savgol_filter(clean, WINDOW, 2, deriv=d, delta=dt) for d in range(3))
        sine = np.sin(2.0 * np.pi * (x - 50.0) / 100.0)
        columns.append(np.stack((sine, np.tanh(v), v, a, np.ones_like(x)), axis=1))
        off.append(op[begin:end] - x)
    coefficients = _robust(np.vstack(columns), np.concatenate(off))
    return 2.0 * float(coefficients[1]), float(coefficients[0])


def _robust(columns: NDArray[np.float64], off: NDArray[np.float64]) -> NDArray[np.float64]:
    weight: NDArray[np.float64] = np.ones(off.size)
    result: NDArray[np.float64] = np.zeros(columns.shape[1])
    for _ in range(30):
        solved = np.linalg.lstsq(columns * weight[:, None], off * weight, rcond=None)[0]
        result = np.asarray(solved, dtype=np.float64)
        residual = off - columns @ result
        spread = 1.4826 * np.median(np.abs(residual))
        weight = np.asarray(1.0 / np.sqrt(1.0 + (residual / (2.0 * spread)) ** 2))
    return result


def row(path: Path, condition: dict[str, str]) -> Row:
    """One recording, explained."""
    law_S, law_load = law(path)
    explanation = explain(read(path))
    return Row(
        file=condition["file"],
        gain=float(condition["kp"]),
        law_S=law_S,
        law_load=law_load,
        naive_S=explanation.naive.S.value,
        S=explanation.restated.S.value,
        low=explanation.restated.S.low,
        high=explanation.restated.S.high,
        names=tuple(sorted("/".join(effect.members) for effect in explanation.effects)),
        rmse_naive=explanation.heldout.rmse_naive,
        rmse_extended=explanation.heldout.rmse_extended,
        seconds=explanation.seconds,
    )


def table(rows: list[Row]) -> list[str]:
    """The lines for docs/proof.md: by gain, then over all."""
    lines = [
        "| gain | recordings | law: S, % | S alone, % | restated S, % | off by (median) | law in "
        "interval | load by law, % | load named | error before, after, % |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for gain in sorted({item.gain for item in rows}):
        some = [item for item in rows if item.gain == gain]
        lines.append(
            f"| {gain:g} | {len(some)} | {_range(item.law_S for item in some)} "
            f"| {_median(item.naive_S for item in some):.1f} | {_range(item.S for item in some)} "
            f"| {_median(item.error for item in some):.2f} "
            f"| {sum(item.holds for item in some)} of {len(some)} "
            f"| {_range(item.law_load for item in some)} "
            f"| {sum(item.loaded for item in some)} of {len(some)} "
            f"| {_median(item.rmse_naive for item in some):.2f}, "
            f"{_median(item.rmse_extended for item in some):.2f} |"
        )
    return [*lines, "", *summary(rows)]


def summary(rows: list[Row]) -> list[str]:
    """What the whole ladder says, a line each."""
    clear = [item for item in rows if item.law_load >= CLEAR_LOAD]
    none = [item for item in rows if item.law_load < NO_LOAD]
    names = Counter(item.names for item in rows)
    others = Counter(tuple(set(item.names) - LOAD_NAMES) for item in rows)
    positive = [item for item in rows if item.S and item.S > 0.0]
    gains = np.log([item.gain for item in positive])
    slope = np.polyfit(gains, np.log([item.S for item in positive]), 1)[0]
    of_law = [item for item in rows if item.law_S > 0.0]
    law_slope = np.polyfit(
        np.log([item.gain for item in of_law]), np.log([item.law_S for item in of_law]), 1
    )[0]
    better = sum((item.rmse_extended or 0.0) < (item.rmse_naive or 0.0) for item in rows)
    return [
        f"- {len(rows)} recordings; names: "
        + "; ".join(f"{', '.join(key) or 'nothing'} {count}" for key, count in names.most_common()),
        f"- the load aside, the commonest names are given in {max(others.values())} of {len(rows)}",
        f"- a load of {CLEAR_LOAD:g} % and more is named in {sum(o.loaded for o in clear)} of "
        f"{len(clear)}, one below {NO_LOAD:g} % in {sum(o.loaded for o in none)} of {len(none)}",
        f"- S off the law by {_median(item.error for item in rows):.2f} % of a turn (median), "
        f"at most {max(item.error for item in rows):.2f}; the interval holds the law in "
        f"{sum(item.holds for item in rows)} of {len(rows)}",
        f"- slope of log S over log gain {slope:.2f}; of the law itself {law_slope:.2f}",
        f"- the free run on unseen samples is better than that of S and J alone in {better} of "
        f"{len(rows)}; {_median(item.seconds for item in rows):.1f} s a recording (median)",
    ]


def _range(values: Any) -> str:
    matching = [value for value in values if value is not None]
    return f"{min(matching):.2f} to {max(matching):.2f}"


def _median(values: Any) -> float:
    return float(np.median([value for value in values if value is not None]))


def main() -> None:
    """Explain the ladder and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--every", type=int, default=1, help="only every so many-th recording")
    parser.add_argument("--json", type=Path, help="write the rows to this file")
    arguments = parser.parse_args()
    place = folder()
    with (place / "conditions.csv").open(encoding="utf-8", newline="") as text:
        conditions = list(csv.DictReader(text))[:: arguments.every]
    rows = [row(place / f"{condition['file']}.gz", condition) for condition in conditions]
    print("\n".join(table(rows)))
    if arguments.json is not None:
        arguments.json.write_text(
            json.dumps([asdict(item) for item in rows], indent=1), encoding="utf-8"
        )


if __name__ == "__main__":
    main()
