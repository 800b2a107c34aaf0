"""One recording of 600 s written into every kind of archive, for tests that compare them."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from stemwatch.connectors.connector import TagMapping, ValveTags
from stemwatch.models.recording import Recording, Role

START = datetime(2026, 1, 5, 6, tzinfo=UTC)
COUNT = 600
BAD, ABSENT = 7, 9  # of OP: one sample is bad, one instant is not there at all
ENDINGS = {Role.OP: "OP", Role.MV: "ZT", Role.PV: "PV"}


def valve(prefix: str = "FIC1.", name: str = "FIC1") -> ValveTags:
    """OP and position in percent, PV of 0 to 40."""
    return ValveTags(
        valve=name,
        tags={
            Role.OP: TagMapping(tag=f"{prefix}OP", unit="%"),
            Role.MV: TagMapping(tag=f"{prefix}ZT", unit="%"),
            Role.PV: TagMapping(tag=f"{prefix}PV", low=0.0, high=40.0),
        },
    )


def rows(seed: int = 0) -> list[tuple[datetime, dict[str, float | None]]]:
    """(time, values by ending) of every instant that is there; ``None`` where OP is bad."""
    rng = np.random.default_rng(seed)
    op = 50.0 + 10.0 * np.sin(np.arange(COUNT) / 20.0) + rng.normal(0.0, 0.05, COUNT)
    zt = op - 1.0 + rng.normal(0.0, 0.05, COUNT)
    table = np.round(np.stack((op, zt, 20.0 + 0.1 * op)), 3)
    return [
        (
            START + timedelta(seconds=i),
            {
                "OP": None if i == BAD else float(table[0, i]),
                "ZT": float(table[1, i]),
                "PV": float(table[2, i]),
            },
        )
        for i in range(COUNT)
        if i != ABSENT
    ]


def narrow_rows(prefix: str = "FIC1.") -> list[tuple[str, datetime, float | None, str]]:
    """(tag, time, value, quality), time by time as an archive writes them."""
    return [
        (prefix + ending, time, value, "Bad" if value is None else "Good")
        for time, values in rows()
        for ending, value in values.items()
    ]


def write_csv(path: Path) -> Path:
    """The recording as a wide text export."""
    lines = ["Time,FIC1.OP,FIC1.ZT,FIC1.PV"]
    lines += [
        ",".join([time.isoformat(), *("Bad" if v is None else repr(v) for v in values.values())])
        for time, values in rows()
    ]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def narrow_table(kind: Any = None, prefix: str = "FIC1.") -> pa.Table:
    """The recording with a row for each sample of a tag; ``kind`` is the type of the times."""
    tags, times, values, quality = zip(*narrow_rows(prefix), strict=True)
    return pa.table(
        {
            "tag": pa.array(tags),
            "time": pa.array(times, pa.timestamp("us", tz="UTC")).cast(
                kind or pa.timestamp("us", tz="UTC")
            ),
            "value": pa.array(values, pa.float64()),
            "quality": pa.array(quality).dictionary_encode(),
        }
    )


def wide_table() -> pa.Table:
    """The recording with a column for each tag, and one of OP's quality."""
    result = rows()
    columns: dict[str, Any] = {"time": pa.array([time for time, _ in result])}
    for ending in ENDINGS.values():
        columns[f"FIC1.{ending}"] = pa.array([values[ending] for _, values in result])
    bad = ["Bad" if values["OP"] is None else "Good" for _, values in result]
    columns["FIC1.OP_quality"] = pa.array(bad)
    return pa.table(columns)


def valves_table(name: str = "FIC1", days: int = 0) -> pa.Table:
    """The recording with a row for each instant of the valve, ``days`` later."""
    result = rows()
    later = timedelta(days=days)
    columns: dict[str, Any] = {
        "valve": pa.array([name] * len(result)),
        "time": pa.array([time + later for time, _ in result], pa.timestamp("ms", tz="UTC")),
    }
    for column, ending in (("op", "OP"), ("mv", "ZT"), ("pv", "PV")):
        columns[column] = pa.array([values[ending] for _, values in result])
    bad = ["Bad" if values["OP"] is None else "Good" for _, values in result]
    columns["op_quality"] = pa.array(bad)
    return pa.table(columns)


def write(table: pa.Table, path: Path, **how: Any) -> Path:
    """A Parquet file, with its folders."""
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(table, path, **how)
    return path


def same(item: Recording, other: Recording) -> None:
    """Both recordings hold the same samples at the same instants, for the same reasons."""
    assert (item.start, item.interval_s, len(item)) == (other.start, other.interval_s, len(other))
    assert item.signals.keys() == other.signals.keys()
    for role, signal in item.signals.items():
        repeated = other.signals[role]
        np.testing.assert_array_equal(signal.quality, repeated.quality)
        np.testing.assert_array_equal(signal.values, repeated.values)
        assert (signal.unit, signal.interval_s) == (repeated.unit, repeated.interval_s)
    assert (item.clock.gaps, item.clock.repeated_times) == (
        other.clock.gaps,
        other.clock.repeated_times,
    )
