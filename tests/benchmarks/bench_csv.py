"""Reading a historian's CSV export beside pandas and DuckDB, on the same file and one core.

    python tests/benchmarks/bench_csv.py [--kinds wide,quoted,...] [--valves 4] [--hours 24]
                                         [--rounds 3] [--json FILE]

A file at 1 s with OP, MV and PV of each valve, written in several ways: wide, every cell quoted, in
cp1252 with a degree sign, packed with gzip, narrow with one sample on each row, in the layout of a
product, with decimal commas. MB are those of the text before it is packed. *stemwatch* finds out
the format (layout, separator, dates, zone, units, status words, frozen clocks), reads every value,
and gives one ``Recording`` for each valve; *pandas* and *DuckDB* are given the columns, parse the
time, and give a table. The difference is the cost of detecting and checking the format. Each reads
in a process of its own, after a small file of the same kind. Seconds of processor time, which a
busy machine stretches little, and the memory at the peak above that of the small file; the median
of the rounds.
"""

from __future__ import annotations

import argparse
import gzip
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

import duckdb
import numpy as np
import pandas as pd

from stemwatch.connectors.connector import TagMapping, ValveTags
from stemwatch.connectors.historian.connector import HistorianFile, propose_valves
from stemwatch.models.recording import Role

ROLES = ("OP", "ZT", "PV")


@dataclass(frozen=True)
class Kind:
    """How a file is written, and how pandas is told to read it."""

    header: str  # of a narrow file; for a wide one, the heading of the time column
    row: str = ""  # of a narrow file, with {tag}, {time} and {value}
    separator: str = ","
    decimal: str = "."
    quoted: bool = False
    encoding: str = "utf-8"
    packed: bool = False
    form: str = "%Y-%m-%dT%H:%M:%SZ"


KINDS = {
    "wide": Kind("Time"),
    "quoted": Kind("Time", quoted=True),
    "cp1252": Kind("Zeit °", encoding="cp1252"),
    "gzip": Kind("Time", packed=True),
    "narrow": Kind("Tag;Time;Value", "{tag};{time};{value}", separator=";"),
    "AVEVA history": Kind(
        "DateTime,TagName,Value,QualityDetail",
        "{time}.0000000,{tag},{value},192",
        form="%Y-%m-%d %H:%M:%S",
    ),
    "decimal comma": Kind("Time", separator=";", decimal=","),
}


def write_file(path: Path, kind: Kind, valves: int, samples: int) -> int:
    """Write an export at 1 s with three tags for each valve, three decimals; returns the bytes
    before packing. The signals of one hour are repeated.
    """
    rng = np.random.default_rng(1)
    started = datetime(2026, 3, 1, tzinfo=UTC)
    tags = [f"FIC-{101 + n}.{role}" for n in range(valves) for role in ROLES]
    walk = 50.0 + np.cumsum(rng.standard_normal((min(3600, samples), len(tags))) * 0.05, axis=0)
    hour = [[f"{value:.3f}".replace(".", kind.decimal) for value in row] for row in walk.tolist()]
    with gzip.open(path, "wb", compresslevel=1) if kind.packed else path.open("wb") as file:
        header = kind.header if kind.row else kind.separator.join([kind.header, *tags])
        written = file.write(_bytes(header, kind))
        for first in range(0, samples, len(hour)):
            lines = []
            for second, row in enumerate(hour[: samples - first], first):
                stamp = (started + timedelta(seconds=second)).strftime(kind.form)
                if kind.row:
                    pairs = zip(tags, row, strict=True)
                    lines += [kind.row.format(tag=t, time=stamp, value=v) for t, v in pairs]
                else:
                    lines.append(kind.separator.join([stamp, *row]))
            written += file.write(_bytes("\n".join(lines), kind))
    return written


def _bytes(lines: str, kind: Kind) -> bytes:
    if kind.quoted:
        lines = (
            '"' + lines.replace(kind.separator, f'"{kind.separator}"').replace("\n", '"\n"') + '"'
        )
    return (lines + "\n").encode(kind.encoding)


def with_stemwatch(path: Path, kind: Kind) -> int:
    """Every valve of the file as a recording; the number of samples read."""
    source = HistorianFile(path)
    return sum(len(source.read(valve)) for valve in propose_valves(source))


def with_one_valve(path: Path, kind: Kind) -> int:
    """One valve of the file, its tags given as a plant file gives them."""
    names = {Role.OP: "OP", Role.MV: "ZT", Role.PV: "PV"}
    tags = {role: TagMapping(tag=f"FIC-101.{name}", unit="%") for role, name in names.items()}
    return len(HistorianFile(path).read(ValveTags(valve="FIC-101", tags=tags)))


def with_pandas(path: Path, kind: Kind) -> int:
    """One table, its time parsed, by pandas' C parser."""
    time_name = next(name for name in ("DateTime", "Time", kind.header) if name in kind.header)
    table = pd.read_csv(
        path,
        engine="c",
        sep=kind.separator,
        decimal=kind.decimal,
        encoding=kind.encoding,
        compression="gzip" if kind.packed else None,
        parse_dates=[time_name],
        date_format="%Y-%m-%d %H:%M:%S.%f" if "TagName" in kind.header else kind.form,
    )
    return len(table)


def with_duckdb(path: Path, kind: Kind) -> int:
    """One table in memory, one thread; wide files with a decimal point only."""
    with duckdb.connect() as connection:
        connection.execute("SET threads = 1")
        connection.execute("CREATE TABLE t AS SELECT * FROM read_csv(?)", [str(path)])
        result = connection.execute("SELECT count(*) FROM t").fetchone()
    return 0 if result is None else int(result[0])


READERS = {
    "stemwatch": with_stemwatch,
    "stemwatch, one valve": with_one_valve,
    "pandas": with_pandas,
    "DuckDB": with_duckdb,
}


def in_own_process(reader: str, kind: str, path: Path, small: Path) -> tuple[float, float]:
    """Seconds of processor time, and MB at the peak above those for a small file, so that imports
    count in neither.
    """
    command = [sys.executable, __file__, "--reader", reader, kind, str(path), str(small)]
    answer = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    return float(answer[-2]), float(answer[-1])


def _read_here(reader: str, kind: str, path: Path, small: Path) -> None:
    read = READERS[reader]
    read(small, KINDS[kind])
    started, before = time.process_time(), _peak_mb()
    if read(path, KINDS[kind]) == 0:
        raise SystemExit(f"bench_csv: {reader} read nothing")
    print(time.process_time() - started, _peak_mb() - before)


def _peak_mb() -> float:
    """The peak memory of this process alone, from Linux: the value of getrusage includes the
    parent's.
    """
    status = Path("/proc/self/status")
    lines = status.read_text(encoding="utf-8").splitlines() if status.exists() else []
    return next((int(line.split()[1]) / 1e3 for line in lines if line.startswith("VmHWM")), 0.0)


def measure(
    kinds: Sequence[str], valves: int, hours: float, rounds: int
) -> list[dict[str, object]]:
    """One row for each kind and reader; the median of the rounds."""
    return [row for kind in kinds for row in _measure_kind(kind, valves, hours, rounds)]


def _measure_kind(kind: str, valves: int, hours: float, rounds: int) -> list[dict[str, object]]:
    with tempfile.TemporaryDirectory() as folder:
        path, small = Path(folder) / "export.csv", Path(folder) / "small.csv"
        megabytes = write_file(path, KINDS[kind], valves, round(3600 * hours)) / 1e6
        write_file(small, KINDS[kind], valves, 1000)
        readers = [name for name in READERS if kind == "wide" or name != "DuckDB"]
        results = {
            name: np.median(
                [in_own_process(name, kind, path, small) for _ in range(rounds)], axis=0
            )
            for name in readers
        }
    return [
        {
            "kind": kind,
            "reader": name,
            "file_MB": round(megabytes, 1),
            "seconds": round(float(seconds), 2),
            "MB_per_s": round(megabytes / float(seconds), 1),
            "peak_MB": round(float(peak)),
        }
        for name, (seconds, peak) in results.items()
    ]


def main() -> None:
    """Read the options, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kinds", default=",".join(KINDS))
    parser.add_argument("--valves", type=int, default=4)
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--reader", nargs=4, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.reader:
        reader, kind, path, small = arguments.reader
        _read_here(reader, kind, Path(path), Path(small))
        return
    kinds = arguments.kinds.split(",")
    rows = measure(kinds, arguments.valves, arguments.hours, arguments.rounds)
    print("".join(f"{name.replace('_', ' '):>23}" for name in rows[0]))
    for row in rows:
        print("".join(f"{cell:>23}" for cell in row.values()))
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
