"""``write_export``: simulated loops as the export files of a plant.

One wide historian file for all loops, a ``plant.toml`` that describes it, and a file with the
truth, by which results can be checked.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from itertools import compress
from pathlib import Path
from zoneinfo import ZoneInfo

import numpy as np

from stemwatch.connectors.settings import toml_value
from stemwatch.models.recording import Floats, Quality, Recording, Role, Signal
from stemwatch.models.studies.simulator import SimulatedLoop

EXPORT_FILE = "export/historian.csv"
PLANT_FILE = "plant.toml"
TRUTH_FILE = "truth.json"
_NO_DATA = "No Data"
_BAD_WORDS = ("Bad Input", "I/O Timeout")  # taken in turn, one for each stretch of bad status
_MODE_WORDS = {1.0: "AUTO", 0.0: "MAN"}
_ENGINEERING = (Role.PV, Role.SP)


@dataclass(frozen=True, kw_only=True)
class ExportedPlant:
    """What was written: the historian files, the plant file and the truth."""

    files: tuple[Path, ...]
    plant_toml: Path
    truth_file: Path


def write_export(
    loops: Sequence[SimulatedLoop],
    folder: Path,
    *,
    start: datetime,
    zone: str,
    name: str = "Demo refinery",
    with_offset: bool = True,
) -> ExportedPlant:
    """Write ``export/historian.csv``, ``plant.toml`` and ``truth.json`` into ``folder``.

    ``start`` (aware) is the time of the first sample of every loop; ``zone`` the IANA zone that
    the file's local times are in, written with their offset from UTC or, without ``with_offset``,
    bare. PV and SP are in the loop's engineering units, the mode is AUTO or MAN, and a cell
    without a value holds the archive's status word. Loops that end early have no data from there;
    an instant at which no loop has data has no row.

    Raises ``ValueError`` where there is no loop, ``start`` is naive, two loops share a tag, or
    their intervals differ.
    """
    interval_s = _check(loops, start)
    folder = Path(folder)
    historian = write_historian(
        loops, folder / EXPORT_FILE, start=start, zone=zone, with_offset=with_offset
    )
    plant_toml, truth_file = folder / PLANT_FILE, folder / TRUTH_FILE
    plant_toml.write_text(_plant_toml(loops, name, zone), encoding="utf-8", newline="\n")
    truth = {
        "start": start.astimezone(UTC).isoformat(),
        "interval_s": interval_s,
        "valves": [loop.truth.as_json() for loop in loops],
    }
    text = json.dumps(truth, indent=1, ensure_ascii=False) + "\n"
    truth_file.write_text(text, encoding="utf-8", newline="\n")
    return ExportedPlant(files=(historian,), plant_toml=plant_toml, truth_file=truth_file)


def write_historian(
    loops: Sequence[SimulatedLoop],
    file: Path,
    *,
    start: datetime,
    zone: str,
    with_offset: bool = True,
) -> Path:
    """Write the export alone, to ``file``; as ``write_export`` does."""
    interval_s = _check(loops, start)
    file.parent.mkdir(parents=True, exist_ok=True)
    times = _local_times(loops, start, ZoneInfo(zone), interval_s, with_offset)
    _write_table(file, loops, times)
    return file


def _check(loops: Sequence[SimulatedLoop], start: datetime) -> float:
    """The common interval in seconds."""
    if not loops:
        raise ValueError("an export needs at least one loop, received none")
    if start.tzinfo is None:
        raise ValueError(f"start must be timezone aware, received {start.isoformat()}")
    tags = [loop.recording.valve for loop in loops]
    repeated = sorted({tag for tag in tags if tags.count(tag) > 1})
    if repeated:
        raise ValueError(f"every loop of an export needs a tag of its own; twice: {repeated}")
    intervals = {loop.recording.valve: loop.recording.interval_s for loop in loops}
    if len(set(intervals.values())) > 1:
        raise ValueError(f"loops on one clock need one interval, received {intervals}")
    return next(iter(intervals.values()))


def _local_times(
    loops: Sequence[SimulatedLoop],
    start: datetime,
    zone: ZoneInfo,
    interval_s: float,
    with_offset: bool,
) -> list[str]:
    count = max(len(loop.recording) for loop in loops)
    first = start.astimezone(UTC)
    fine = "seconds" if float(interval_s).is_integer() and not first.microsecond else "milliseconds"
    texts = []
    for index in range(count):
        time = (first + timedelta(seconds=index * interval_s)).astimezone(zone)
        local = time if with_offset else time.replace(tzinfo=None)
        texts.append(local.isoformat(sep=" ", timespec=fine))
    return texts


def _write_table(file: Path, loops: Sequence[SimulatedLoop], times: list[str]) -> None:
    count = len(times)
    header, units, columns = ["Time"], [""], [times]
    for loop in loops:
        for role, signal in _ordered(loop.recording):
            header.append(signal.tag)
            units.append(_unit(loop, role))
            columns.append(_cells(loop, role, signal, count))
    rows = _rows_with_data(loops, count)
    with file.open("w", encoding="utf-8", newline="") as out:
        writer = csv.writer(out, lineterminator="\n")
        writer.writerows([header, units])
        writer.writerows(compress(zip(*columns, strict=True), rows))


def _ordered(recording: Recording) -> Iterator[tuple[Role, Signal]]:
    return ((role, recording.signals[role]) for role in Role if role in recording.signals)


def _unit(loop: SimulatedLoop, role: Role) -> str:
    """The loop's engineering unit for PV and SP, percent for OP and position, none for the mode."""
    if role in _ENGINEERING:
        return loop.loop.pv_range.unit
    return "" if role is Role.MODE else "%"


def _rows_with_data(loops: Sequence[SimulatedLoop], count: int) -> list[bool]:
    rows = np.zeros(count, dtype=np.bool_)
    for loop in loops:
        for signal in loop.recording.signals.values():
            rows[: signal.quality.size] |= signal.quality != Quality.MISSING
    return [bool(keep) for keep in rows]


def _cells(loop: SimulatedLoop, role: Role, signal: Signal, count: int) -> list[str]:
    """One column as text: numbers, modes in words, status words where there is no number."""
    values = _engineering(loop, signal.values) if role in _ENGINEERING else signal.values
    if role is Role.MODE:
        texts = [_MODE_WORDS.get(value, _NO_DATA) for value in values.tolist()]
    else:
        texts = [f"{value:.4f}" for value in values.tolist()]
    bad = signal.quality > Quality.HELD
    stretch = np.cumsum(np.diff(bad.astype(np.int8), prepend=0) == 1)
    for index in np.flatnonzero(bad).tolist():
        missing = signal.quality[index] == Quality.MISSING
        word = _BAD_WORDS[int(stretch[index] - 1) % len(_BAD_WORDS)]
        texts[index] = _NO_DATA if missing else word
    return texts + [_NO_DATA] * (count - len(texts))


def _engineering(loop: SimulatedLoop, percent: Floats) -> Floats:
    scale = loop.loop.pv_range
    return scale.low + percent / 100.0 * (scale.high - scale.low)


def _plant_toml(loops: Sequence[SimulatedLoop], name: str, zone: str) -> str:
    lines = ["[plant]", f"name = {toml_value(name)}", f"zone = {toml_value(zone)}"]
    if any(loop.loop.price_per_unit_hour is not None for loop in loops):
        lines.append('currency = "EUR"')
    lines.append("")
    lines += ["[[sources]]", 'name = "historian"', 'path = "export/*.csv"']
    lines += [f"zone = {toml_value(zone)}"]
    for loop in loops:
        lines += ["", *_valve_toml(loop)]
    return "\n".join(lines) + "\n"


def _valve_toml(loop: SimulatedLoop) -> list[str]:
    price = loop.loop.price_per_unit_hour
    lines = [
        "[[valves]]",
        f"id = {toml_value(loop.recording.valve)}",
        f"description = {toml_value(loop.loop.description)}",
        f"area = {toml_value(loop.loop.area)}",
        *([f"unit = {toml_value(loop.loop.unit)}"] if loop.loop.unit else []),
        f"criticality = {loop.loop.criticality}",
        *([] if price is None else [f"price_per_unit_hour = {price}"]),
        'source = "historian"',
    ]
    for role, signal in _ordered(loop.recording):
        lines += [f"[valves.tags.{role.value}]", f"tag = {toml_value(signal.tag)}"]
        if role is not Role.MODE:
            lines.append(f"unit = {toml_value(_unit(loop, role))}")
        if role in _ENGINEERING:
            scale = loop.loop.pv_range
            lines += [f"low = {float(scale.low)}", f"high = {float(scale.high)}"]
    return lines
