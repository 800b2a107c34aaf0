"""Reading a historian's CSV export beside pandas and DuckDB, on the same file and one core.

    python tests/benchmarks/bench_csv.py [--valves 4] [--hours 24] [--rounds 3] [--json FILE]

A wide file at 1 s with OP, MV and PV of each valve. *stemwatch* finds out what it has before it
(layout, separator, dates, zone, units, status words, frozen clocks), reads every value, and gives
one ``Recording`` for each valve; *pandas* and *DuckDB* are told what the columns are, parse the
time, and give a table. The difference is what the guessing and checking costs. Each reads in a
process of its own, after a small file of the same kind. Seconds of processor time, which a busy
machine stretches little, and the memory at the peak; the median of the rounds.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path

import duckdb
import numpy as np
import pandas as pd

from stemwatch.connectors.connector import TagMapping, ValveTags
from stemwatch.connectors.historian.connector import HistorianFile, propose_valves
from stemwatch.models.recording import Role

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


def with_one_valve(path: Path) -> int:
    """One valve of the file, its tags given as a plant file gives them."""
    names = {Role.OP: "OP", Role.MV: "ZT", Role.PV: "PV"}
    tags = {role: TagMapping(tag=f"FIC-101.{name}", unit="%") for role, name in names.items()}
    return len(HistorianFile(path).read(ValveTags(valve="FIC-101", tags=tags)))


def with_pandas(path: Path) -> int:
    """One table, its time parsed."""
    table = pd.read_csv(path, parse_dates=["Time"], date_format="%Y-%m-%dT%H:%M:%SZ")
    return len(table)


def with_duckdb(path: Path) -> int:
    """One table in memory, one thread."""
    with duckdb.connect() as connection:
        connection.execute("SET threads = 1")
        connection.execute("CREATE TABLE t AS SELECT * FROM read_csv(?)", [str(path)])
        found = connection.execute("SELECT count(*) FROM t").fetchone()
    return 0 if found is None else int(found[0])


READERS = {
    "stemwatch": with_stemwatch,
    "stemwatch, one valve": with_one_valve,
    "pandas": with_pandas,
    "DuckDB": with_duckdb,
}


def in_own_process(reader: str, path: Path, small: Path) -> tuple[float, float]:
    """Seconds of processor time, and MB at the peak above what the reader needs for a small file:
    what it imports is no part of either."""
    command = [sys.executable, __file__, "--reader", reader, str(path), str(small)]
    answer = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    return float(answer[-2]), float(answer[-1])


def _read_here(reader: str, path: Path, small: Path) -> None:
    read = READERS[reader]
    read(small)
    began, before = time.process_time(), _peak_mb()
    if read(path) == 0:
        raise SystemExit(f"bench_csv: {reader} read nothing")
    print(time.process_time() - began, _peak_mb() - before)


def _peak_mb() -> float:
    """Of this process alone, from Linux: what getrusage says begins with its parent's."""
    status = Path("/proc/self/status")
    lines = status.read_text(encoding="utf-8").splitlines() if status.exists() else []
    return next((int(line.split()[1]) / 1e3 for line in lines if line.startswith("VmHWM")), 0.0)


def measure(valves: int, hours: float, rounds: int) -> list[dict[str, object]]:
    """One row for each reader; the median of the rounds."""
    with tempfile.TemporaryDirectory() as folder:
        path, small = Path(folder) / "export.csv", Path(folder) / "small.csv"
        write_file(path, valves, round(3600 * hours))
        write_file(small, valves, 1000)
        megabytes = path.stat().st_size / 1e6
        found = {
            name: np.median([in_own_process(name, path, small) for _ in range(rounds)], axis=0)
            for name in READERS
        }
    return [
        {
            "reader": name,
            "file_MB": round(megabytes, 1),
            "seconds": round(float(seconds), 2),
            "MB_per_s": round(megabytes / float(seconds), 1),
            "peak_MB": round(float(peak)),
        }
        for name, (seconds, peak) in found.items()
    ]


def main() -> None:
    """Read the options, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--valves", type=int, default=4)
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--reader", nargs=3, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.reader:
        _read_here(arguments.reader[0], Path(arguments.reader[1]), Path(arguments.reader[2]))
        return
    rows = measure(arguments.valves, arguments.hours, arguments.rounds)
    print("".join(f"{name.replace('_', ' '):>23}" for name in rows[0]))
    for row in rows:
        print("".join(f"{cell:>23}" for cell in row.values()))
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
