"""How many samples a second go into the store and come back out of it, one writer, one core.

    python tests/benchmarks/bench_storage.py                        # SQLite, in a temporary folder
    python tests/benchmarks/bench_storage.py --url postgresql://stemwatch@/bench

Batches as from a collector (20,000 samples of 1,500 tags) and as from an import (200,000), then a
day of one tag read back, then everything copied into a backup. On PostgreSQL COPY is measured
beside one INSERT from arrays, into the same table, in turns. The database must be empty; what is
written is removed again.
"""

from __future__ import annotations

import argparse
import json
import platform
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from sqlalchemy import Connection, text

from stemwatch.connectors.modbus.sample_batch import SampleBatch
from stemwatch.service.store.administration.backup import backup
from stemwatch.service.store.database_url import DatabaseUrl
from stemwatch.service.store.samples import samples as samples_module
from stemwatch.service.store.samples.bulk_insert import SampleColumns, insert_samples
from stemwatch.service.store.store import Store, open_store

VALVES = 500
NAMES = [f"FIC-{valve:03}.{role}" for valve in range(VALVES) for role in ("OP", "MV", "PV")]
SIZES = (1_500, 20_000, 200_000)
_UNNEST = text(
    "INSERT INTO samples (tag_id, at_us, value, quality, reason_id) SELECT * FROM unnest("
    "CAST(:tag AS integer[]), CAST(:at AS bigint[]), CAST(:value AS double precision[]), "
    "CAST(:quality AS smallint[]), CAST(:reason AS integer[])) ON CONFLICT DO NOTHING"
)
Insert = Callable[[Connection, SampleColumns], None]


def insert_arrays(connection: Connection, columns: SampleColumns) -> None:
    """One INSERT from arrays: what COPY is measured against."""
    values = {
        "tag": columns.tag.tolist(),
        "at": columns.at_us.tolist(),
        "value": columns.values.tolist(),
        "quality": columns.quality.tolist(),
        "reason": [number or None for number in columns.reason.tolist()],
    }
    connection.execute(_UNNEST, values)


def batches(size: int, total: int, first_s: int) -> list[SampleBatch]:
    """``total`` samples in batches of ``size``: every tag once a second from ``first_s`` on."""
    rng = np.random.default_rng(1)
    samples = np.arange(total)
    at_us = (first_s + samples // len(NAMES)) * 1_000_000
    return [
        SampleBatch(
            source="bench",
            tags=tuple(NAMES[number % len(NAMES)] for number in range(start, start + count)),
            at_us=at_us[start : start + count],
            values=rng.normal(50.0, 10.0, count),
            quality=np.zeros(count, np.uint8),
            reasons=("",) * count,
        )
        for start in range(0, total, size)
        for count in (min(size, total - start),)
    ]


def write_all(store: Store, insert: Insert, parts: Sequence[SampleBatch]) -> float:
    """Samples a second for writing ``parts`` with ``insert``."""
    with patch.object(samples_module, "insert_samples", insert):
        started = time.perf_counter()
        for part in parts:
            store.samples.write(part)
        return sum(map(len, parts)) / (time.perf_counter() - started)


def measure(store: Store, total: int) -> list[dict[str, Any]]:
    """Every figure, as rows of a table."""
    now_s = int(time.time()) // 86_400 * 86_400
    ways: dict[str, Insert] = {"COPY": insert_samples, "INSERT from arrays": insert_arrays}
    if store.transactions.is_sqlite:
        ways = {"prepared INSERT": insert_samples}
    rows: list[dict[str, Any]] = []
    first_s = now_s
    write_all(store, insert_samples, batches(1_500, 1_500, now_s - 10))  # tags, days, caches
    for size in SIZES:
        for method, insert in ways.items():
            count = min(total, max(size, total // 4)) if size < 20_000 else max(total, size)
            rate = write_all(store, insert, batches(size, count, first_s))
            rows.append({"what": f"write, {size} at once, {method}", "samples_per_s": rate})
            first_s += count // len(NAMES) + 1
    rows.append({"what": "read one tag, all of it", "samples_per_s": _read(store)})
    rows.append({"what": "backup, compared by digest", "samples_per_s": _backup(store)})
    return rows


def _read(store: Store) -> float:
    started = time.perf_counter()
    count = sum(len(store.samples.read("bench", name).at_us) for name in NAMES[:30])
    return count / (time.perf_counter() - started)


def _backup(store: Store) -> float:
    with tempfile.TemporaryDirectory() as folder:
        started = time.perf_counter()
        backed_up = backup(store.address, Path(folder) / "backup.zip")
        return backed_up["samples"].rows / (time.perf_counter() - started)


def main() -> None:
    """Measure and print a table, or write JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--url", default="", help="an empty PostgreSQL database")
    parser.add_argument("--samples", type=int, default=600_000, help="in each measurement")
    parser.add_argument("--json", type=Path, help="write the figures to this file too")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        address = DatabaseUrl(arguments.url or f"sqlite:///{folder}/bench.db")
        with open_store(address) as store:
            if store.samples.tags("bench"):
                raise SystemExit(f"{address}: is not empty; give an empty database")
            try:
                results = measure(store, arguments.samples)
            finally:
                with store.transactions.writing("removing the samples again") as session:
                    session.execute(text("DELETE FROM samples"))
                    session.execute(text("DELETE FROM tags WHERE source = 'bench'"))
    print(f"{platform.machine()}, Python {platform.python_version()}, {address}")
    for row in results:
        print(f"{row['what']:45} {row['samples_per_s']:>12,.0f} samples/s")
    if arguments.json:
        arguments.json.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
