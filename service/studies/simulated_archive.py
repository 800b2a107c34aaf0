"""``write_archive``: a simulated plant of thousands of valves as an archive.

A few hundred megabytes to many gigabytes, written in pieces by several processes.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from stemwatch.models.recording import Floats, Role
from stemwatch.service.executors import Executor, map_in_order, map_items

if TYPE_CHECKING:
    from stemwatch.models.studies.simulator import PlantLoop

Format = Literal["parquet", "csv"]
ROLES = (Role.OP, Role.MV, Role.PV, Role.SP)
PIECE = 20  # valves of one file of Parquet
CSV_PIECE = 8  # valves of one wide text file, which is parsed as a whole
DECIMALS = 4
REUSED_NOISE_PERCENT = 0.02  # on a loop that is used again, so that no two valves are equal
AREAS = 10


@dataclass(frozen=True, kw_only=True)
class ArchivePlan:
    """What to simulate: ``valves`` valves of ``hours`` hours, a sample every ``interval_s`` s.

    One in ``sticky_every`` sticks. ``distinct`` loops are simulated; where that is fewer than the
    valves, each is used again, shifted in time (cyclically) and with new noise on the position:
    good for timing, not for counting right verdicts. Raises ``ValueError`` on numbers that make no
    archive.
    """

    valves: int
    hours: float = 24.0
    interval_s: float = 1.0
    distinct: int = 0  # 0: every valve has a loop of its own
    sticky_every: int = 5
    seed: int = 1
    start: datetime = datetime(2026, 3, 2, tzinfo=UTC)
    format: Format = "parquet"

    def __post_init__(self) -> None:
        if min(self.valves, self.sticky_every) < 1 or self.distinct < 0:
            raise ValueError(
                "valves and sticky_every of at least 1 and distinct of at least 0 expected, "
                f"received {self.valves}, {self.sticky_every} and {self.distinct}"
            )
        if self.hours * 3600.0 < 2.0 * self.interval_s or self.interval_s <= 0.0:
            raise ValueError(
                "at least two samples and an interval above 0 expected, received "
                f"{self.hours:g} h at {self.interval_s:g} s"
            )

    @property
    def loops(self) -> int:
        """How many loops are simulated."""
        return min(self.distinct or self.valves, self.valves)


@dataclass(frozen=True)
class Piece:
    """Some valves of an archive, for one process: their numbers, counted from 0.

    ``loops`` is where loops that are used again lie, simulated.
    """

    plan: ArchivePlan
    folder: Path
    number: int
    places: tuple[int, ...]
    loops: Path | None = None


@dataclass(frozen=True)
class _Loop:
    """A simulated loop: its signals, each (samples,), and its truth."""

    signals: dict[Role, Floats]
    truth: dict[str, object]


def write_archive(
    plan: ArchivePlan,
    folder: Path,
    executor: Executor,
    on_progress: Callable[[int], None] = lambda _: None,
) -> Path:
    """Write the archive, ``plant.toml`` and ``truth.json`` into ``folder``; returns the plant file.

    Parquet: ``parquet/date=YYYY-MM-DD/part-NNNNN.parquet`` with a row for each instant of a valve
    (time in UTC, valve, op, mv, pv, sp), one row group for each valve and day. CSV:
    ``csv/valves-NNNNN.csv``, a column for each tag. ``on_progress`` hears how many
    valves are done.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder, prefix="loops-") as loops:
        pieces = _pieces(plan, folder, Path(loops))
        if plan.loops < plan.valves:
            simulated = [replace(pieces[0], places=(number,)) for number in range(plan.loops)]
            for _ in map_items(executor, store_loop, simulated):
                pass
        truths = map_in_order(executor, write_piece, pieces, on_progress)
    plant = folder / "plant.toml"
    plant.write_text("\n".join(_plant_toml(plan)) + "\n", encoding="utf-8", newline="\n")
    truth_of_plant = {
        "start": plan.start.isoformat(),
        "interval_s": plan.interval_s,
        "valves": truths,
    }
    (folder / "truth.json").write_text(json.dumps(truth_of_plant) + "\n", encoding="utf-8")
    return plant


def _pieces(plan: ArchivePlan, folder: Path, loops: Path) -> list[Piece]:
    size = PIECE if plan.format == "parquet" else CSV_PIECE
    return [
        Piece(plan, folder, number, tuple(range(first, min(first + size, plan.valves))), loops)
        for number, first in enumerate(range(0, plan.valves, size))
    ]


def store_loop(piece: Piece) -> None:
    """Simulate the only loop of a piece and store it in its folder of loops, to be used again."""
    if piece.loops is None:
        raise ValueError("a piece with a folder of loops expected, received one without")
    (number,) = piece.places
    loop = _simulated(piece.plan, number)
    named = {role.value: values for role, values in loop.signals.items()}
    np.savez(piece.loops / f"{number}.npz", **named)  # type: ignore[arg-type]  # no allow_pickle in it
    (piece.loops / f"{number}.json").write_text(json.dumps(loop.truth), encoding="utf-8")


def _stored_loop(folder: Path | None, number: int) -> _Loop | None:
    """The loop that ``store_loop`` stored, or ``None``."""
    if folder is None or not (folder / f"{number}.json").is_file():
        return None
    with np.load(folder / f"{number}.npz") as file:
        signals = {Role(name): file[name] for name in file.files}
    return _Loop(signals, json.loads((folder / f"{number}.json").read_text("utf-8")))


def write_piece(piece: Piece) -> list[dict[str, object]]:
    """Write one piece, simulating loops that are not stored; returns the truth of each valve.

    One loop is in memory at a time.
    """
    written: list[tuple[str, dict[Role, Floats]]] = []
    truths: list[dict[str, object]] = []
    for index in piece.places:
        number, tag = index % piece.plan.loops, tag_of(index)
        loop = _stored_loop(piece.loops, number) or _simulated(piece.plan, number)
        written.append((tag, _columns(piece.plan, loop, index)))
        truths.append(loop.truth | {"tag": tag, "distinct": index == number})
    (write_parquet if piece.plan.format == "parquet" else _write_csv)(piece, written)
    return truths


def tag_of(index: int) -> str:
    """The name of the valve of this number."""
    return f"FV-{index + 1:05d}"


def _simulated(plan: ArchivePlan, number: int) -> _Loop:
    from stemwatch.models.studies.simulator import simulate_loop

    loop = _loop(plan, number)
    archive = replace(loop.archive, interval_s=plan.interval_s)
    simulated = simulate_loop(
        replace(loop, archive=archive, duration_s=3600.0 * plan.hours), plan.seed + number
    )
    signals = simulated.recording.signals
    return _Loop(
        {role: signals[role].values for role in ROLES if role in signals}, simulated.truth.as_json()
    )


def _loop(plan: ArchivePlan, number: int) -> PlantLoop:
    """One in ``sticky_every`` sticks. Each draw is that of its own seed, so that a piece needs to
    draw no more than its own loops."""
    from stemwatch.models.studies.simulator import draw_healthy, draw_sticky

    draw = draw_sticky if number % plan.sticky_every == plan.sticky_every - 1 else draw_healthy
    story_count = 12  # stories and shapes are used in turn, so that all of them occur
    return draw(number % story_count + 1, plan.seed + 1000 * number)[-1]


def _columns(plan: ArchivePlan, loop: _Loop, index: int) -> dict[Role, Floats]:
    """The signals in percent, OP and MV always, rounded as an archive rounds."""
    signals = loop.signals
    repetition = index // plan.loops
    if repetition:
        rng = np.random.default_rng([plan.seed, index])
        shift = int(rng.integers(signals[Role.OP].size))
        signals = {role: np.roll(values, shift) for role, values in signals.items()}
        noise = rng.standard_normal(signals[Role.OP].size)
        signals[Role.MV] = signals[Role.MV] + REUSED_NOISE_PERCENT * noise
    return {role: np.round(values, DECIMALS) for role, values in signals.items()}


def _clock(plan: ArchivePlan, samples: int) -> np.ndarray[Any, np.dtype[np.datetime64]]:
    """(samples,) times in UTC, whole microseconds."""
    first = np.datetime64(plan.start.astimezone(UTC).replace(tzinfo=None), "us")
    return first + np.round(np.arange(samples) * plan.interval_s * 1e6).astype("timedelta64[us]")


def write_parquet(piece: Piece, valves: Iterable[tuple[str, dict[Role, Floats]]]) -> None:
    """One file of Parquet for each date, with the signals of ``valves``: name and values (n,)."""
    import pyarrow as pa
    from pyarrow import parquet

    roles = [pa.field(role.value, pa.float64(), metadata={"unit": "%"}) for role in ROLES]
    key = pa.dictionary(pa.int32(), pa.string())
    schema = pa.schema([("time", pa.timestamp("us", "UTC")), ("valve", key), *roles])
    files: dict[str, Any] = {}
    for tag, columns in valves:
        for date, part, times in _days(piece.plan, columns[Role.OP].size):
            if date not in files:
                folder = piece.folder / "parquet" / f"date={date}"
                folder.mkdir(parents=True, exist_ok=True)
                path = folder / f"part-{piece.number:05d}.parquet"
                files[date] = parquet.ParquetWriter(
                    path, schema, compression="zstd", write_page_checksum=True
                )
            name = pa.DictionaryArray.from_arrays(np.zeros(times.size, np.int32), [tag])
            data = [_values(columns.get(role), part, times.size) for role in ROLES]
            table = pa.Table.from_arrays(
                [pa.array(times, schema[0].type), name, *data], schema=schema
            )
            files[date].write_table(table, row_group_size=times.size)
    for file in files.values():
        file.close()


def _values(values: Floats | None, part: slice, samples: int) -> Any:
    """A column of an Arrow table; NaN is written as no value."""
    import pyarrow as pa

    if values is None:
        return pa.nulls(samples, pa.float64())
    return pa.array(values[part], pa.float64(), from_pandas=True)


def _days(
    plan: ArchivePlan, samples: int
) -> Iterator[tuple[str, slice, np.ndarray[Any, np.dtype[np.datetime64]]]]:
    """Each date with its samples, as a slice and as times."""
    times = _clock(plan, samples)
    dates = times.astype("datetime64[D]")
    cuts = [0, *(np.flatnonzero(np.diff(dates)) + 1).tolist(), samples]
    for first, last in pairwise(cuts):
        yield str(dates[first]), slice(first, last), times[first:last]


def _write_csv(piece: Piece, valves: Iterable[tuple[str, dict[Role, Floats]]]) -> None:
    import pyarrow as pa
    from pyarrow import csv

    columns: dict[str, Any] = {}
    for tag, signals in valves:
        if not columns:
            times = _clock(piece.plan, signals[Role.OP].size)
            columns["Time"] = pa.array(np.datetime_as_string(times, unit="ms", timezone="UTC"))
        for role, values in signals.items():
            columns[f"{tag}.{role.value}"] = pa.array(values, from_pandas=True)
    folder = piece.folder / "csv"
    folder.mkdir(parents=True, exist_ok=True)
    options = csv.WriteOptions(quoting_style="none")
    csv.write_csv(pa.table(columns), folder / f"valves-{piece.number:05d}.csv", options)


def _plant_toml(plan: ArchivePlan) -> Iterator[str]:
    yield '[plant]\nname = "Simulated archive"\nzone = "UTC"\n'
    yield '[[sources]]\nname = "archive"'
    parquet = plan.format == "parquet"
    yield 'kind = "parquet"\npath = "parquet"' if parquet else 'path = "csv/*.csv"\nzone = "UTC"'
    for index in range(plan.valves):
        tag = tag_of(index)
        yield f'\n[[valves]]\nid = "{tag}"\narea = "Area {index % AREAS + 1}"\nsource = "archive"'
        for role in ROLES:
            yield f'tags.{role.value} = {{ tag = "{tag}.{role.value}", unit = "%" }}'
