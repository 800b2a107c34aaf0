"""Reading a historian's CSV export beside pandas and DuckDB, on the same file and one core.

    python tests/benchmarks/bench_csv.py [--valves 4] [--hours 24] [--rounds 3] [--json FILE]

A wide file at 1 s with OP, MV and PV of each valve. *stemwatch* finds out what it has before it
(layout, separator, dates, zone, units, status words, frozen clocks), reads every value, and gives
one ``Recording`` for each valve; *pandas* and *DuckDB* are told what the columns are, parse the
time, and give a table. The difference is what the guessing and checking costs. Seconds of processor
time, which a busy machine stretches little; the median of the rounds.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import duckdb
import numpy as np
import pandas as pd

from stemwatch.connectors.historian.connector import HistorianFile, propose_valves

ROLES = ("OP", "ZT", "PV")


def write_file(path: Path, valves: int, samples: int) -> None:
    """A wide export: time in UTC and three tags for each valve, three decimals."""
    rng = np.random.default_rng(1)
    began = datetime(2026, 3, 1, tzinfo=UTC)
    names = [f"FIC-{101 + n}.{role}" for n in range(valves) for role in ROLES]
    values = 50.0 + np.cumsum(rng.standard_normal((samples, len(names))) * 0.05, axis=0)
    with path.open("w", encoding="utf-8") as file:
        file.write(",".join(["Time", *names]) + "\n")
        for second, row in enumerate(values.tolist()):
            stamp = (began + timedelta(seconds=second)).strftime("%Y-%m-%dT%H:%M:%SZ")
            file.write(stamp + "," + ",".join(f"{value:.3f}" for value in row) + "\n")


def with_stemwatch(path: Path) -> int:
    """Every valve of the file as a recording; the number of samples read."""
    source = HistorianFile(path)
    return sum(len(source.read(valve)) for valve in propose_valves(source))


def with_pandas(path: Path) -> int:
    """One table, its time parsed."""
    table = pd.read_csv(path, parse_dates=["Time"], date_format="%Y-%m-%dT%H:%M:%SZ")
    return len(table)


def with_duckdb(path: Path) -> int:
    """One table in memory, one thread."""
    with duckdb.connect() as connection:
        connection.execute("SET threads = 1")
        connection.execute("CREATE TABLE t AS SELECT * FROM read_csv(?)", [str(path)])
        table = connection.execute("SELECT count(*) FROM t").fetchone()
    return 0 if table is None else int(table[0])


def _median_s(read: Callable[[Path], int], path: Path, rounds: int) -> float:
    times_s = []
    for _ in range(rounds):
        began = time.process_time()
        if read(path) == 0:
            raise SystemExit(f"bench_csv: {read.__name__} read nothing")
        times_s.append(time.process_time() - began)
    return float(np.median(times_s))


def measure(valves: int, hours: float, rounds: int) -> list[dict[str, object]]:
    """One row for each reader."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "export.csv"
        write_file(path, valves, round(3600 * hours))
        megabytes = path.stat().st_size / 1e6
        readers = {"stemwatch": with_stemwatch, "pandas": with_pandas, "DuckDB": with_duckdb}
        seconds = {name: _median_s(read, path, rounds) for name, read in readers.items()}
    return [
        {
            "reader": name,
            "file_MB": round(megabytes, 1),
            "seconds": round(one, 3),
            "MB_per_s": round(megabytes / one, 1),
            "stemwatch_takes_times": round(seconds["stemwatch"] / one, 2),
        }
        for name, one in seconds.items()
    ]


def main() -> None:
    """Read the options, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--valves", type=int, default=4)
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    rows = measure(arguments.valves, arguments.hours, arguments.rounds)
    print("".join(f"{name.replace('_', ' '):>23}" for name in rows[0]))
    for row in rows:
        print("".join(f"{cell:>23}" for cell in row.values()))
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
