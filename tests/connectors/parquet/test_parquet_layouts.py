"""The same recording comes out of every layout of Parquet files, and out of a text export."""

from __future__ import annotations

from datetime import timedelta
from pathlib import Path
from zoneinfo import ZoneInfo

import pyarrow as pa
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from stemwatch.connectors.connector import ConnectorError, TagMapping, UnreadableSource, ValveTags
from stemwatch.connectors.historian import HistorianFile, ReadOptions
from stemwatch.connectors.parquet import ParquetArchive
from stemwatch.models.recording import Quality, Recording, Role
from tests.connectors import example_archives as made


@pytest.fixture
def from_csv(tmp_path: Path) -> Recording:
    """The recording as the text export gives it."""
    return HistorianFile(made.write_csv(tmp_path / "export.csv")).read(made.valve())


def long_valve() -> ValveTags:
    """The tags that the layout with a row for each instant of a valve gives."""
    tags = made.valve().tags
    named = {Role.OP: "FIC1.op", Role.MV: "FIC1.mv", Role.PV: "FIC1.pv"}
    return ValveTags(
        valve="FIC1",
        tags={
            role: TagMapping(tag=named[role], unit=item.unit, low=item.low, high=item.high)
            for role, item in tags.items()
        },
    )


def test_wide_files_give_the_same_recording(tmp_path: Path, from_csv: Recording) -> None:
    """Wide files give what the text export gives, with the quality column beside its tag."""
    path = made.write(made.wide_table(), tmp_path / "wide.parquet")
    made.same(from_csv, ParquetArchive(path).read(made.valve()))


@pytest.mark.parametrize("group", [37, 1_000_000])
@pytest.mark.parametrize("encoded", [True, False])
def test_narrow_files_give_the_same_recording(
    tmp_path: Path, from_csv: Recording, group: int, encoded: bool
) -> None:
    """Narrow files too, however small their row groups are and whether names are a dictionary."""
    table = made.narrow_table()
    if encoded:
        table = table.set_column(0, "tag", table.column("tag").dictionary_encode())
    path = made.write(table, tmp_path / "narrow.parquet", row_group_size=group)
    made.same(from_csv, ParquetArchive(path).read(made.valve()))


def test_rows_by_valve_give_the_same_recording(tmp_path: Path, from_csv: Recording) -> None:
    """The recommended layout, with other valves before and after in the same file."""
    table = pa.concat_tables([made.valves_table(name) for name in ("FIC0", "FIC1", "FIC2")])
    path = made.write(table, tmp_path / "valves.parquet", row_group_size=599)
    made.same(from_csv, ParquetArchive(path).read(long_valve()))


def test_keys_of_hive_folders_count_as_columns(tmp_path: Path, from_csv: Recording) -> None:
    """Hive folders: their keys count as columns, whatever else they are called."""
    table = made.narrow_table()
    for tag in ("FIC1.OP", "FIC1.ZT", "FIC1.PV"):
        own = table.filter(pa.compute.equal(table.column("tag"), tag)).drop_columns("tag")
        folder = tmp_path / "archive" / "area=100" / "date=2026-01-05" / f"tag={tag}"
        made.write(own, folder / "part-0.parquet")
    made.same(from_csv, ParquetArchive(tmp_path / "archive").read(made.valve()))


def test_several_files_are_one_archive(tmp_path: Path, from_csv: Recording) -> None:
    """Files that share a recording are joined, and a hidden or foreign file is no part of it."""
    table = made.wide_table()
    for number, first in enumerate(range(0, 599, 150)):
        made.write(table.slice(first, 150), tmp_path / "archive" / f"part-{number}.parquet")
    (tmp_path / "archive" / "_SUCCESS").write_text("")
    (tmp_path / "archive" / ".part-9.parquet").write_text("not yet")
    (tmp_path / "archive" / "notes.txt").write_text("moved to a new disk")
    made.same(from_csv, ParquetArchive(tmp_path / "archive").read(made.valve()))
    pattern = str(tmp_path / "archive" / "part-*.parquet")
    made.same(from_csv, ParquetArchive(pattern).read(made.valve()))
    uri = (tmp_path / "archive").as_uri()
    made.same(from_csv, ParquetArchive(uri).read(made.valve()))


@settings(max_examples=15, deadline=None)
@given(order=st.permutations(range(599)), twice=st.lists(st.integers(0, 598), max_size=20))
@example(order=list(range(599)), twice=[8])  # the row before a hole
def test_row_order_and_repeated_rows_make_no_difference(
    tmp_path_factory: pytest.TempPathFactory, order: list[int], twice: list[int]
) -> None:
    """Rows in any order, some of them there twice, are the same recording."""
    folder = tmp_path_factory.mktemp("shuffled")
    table = made.wide_table()
    recording = ParquetArchive(made.write(table, folder / "plain.parquet")).read(made.valve())
    mixed = made.write(table.take([*order, *twice]), folder / "mixed.parquet", row_group_size=100)
    repeated = ParquetArchive(mixed).read(made.valve())
    for role, signal in recording.signals.items():
        assert signal.values.tobytes() == repeated.signals[role].values.tobytes()
        assert signal.quality.tobytes() == repeated.signals[role].quality.tobytes()
    assert (recording.start, recording.interval_s) == (repeated.start, repeated.interval_s)


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
@pytest.mark.parametrize("zone", [None, "UTC", "America/New_York"])
def test_times_of_any_resolution_and_zone_are_the_same_instants(
    tmp_path: Path, from_csv: Recording, unit: str, zone: str | None
) -> None:
    """A zone in the type only says how times are shown; without one the stated zone holds."""
    table = made.wide_table()
    times = table.column("time").cast(pa.timestamp(unit, tz="UTC"))
    if zone is None:
        options = ReadOptions(zone="Europe/Berlin")
        local = [t.astimezone(ZoneInfo("Europe/Berlin")).replace(tzinfo=None)
                 for t in times.to_pylist()]  # fmt: skip
        times = pa.array(local, pa.timestamp(unit))
    else:
        options = ReadOptions()
        times = times.cast(pa.timestamp(unit, tz=zone))
    path = made.write(table.set_column(0, "time", times), tmp_path / "times.parquet")
    archive = ParquetArchive(path, options)
    made.same(from_csv, archive.read(made.valve()))


def test_unix_numbers_and_texts_are_read_as_times(tmp_path: Path, from_csv: Recording) -> None:
    """Times that are no timestamps are understood as in a text export."""
    table = made.wide_table()
    stamps = table.column("time").to_pylist()
    for name, times in (
        ("unix", pa.array([int(t.timestamp() * 1000) for t in stamps])),
        ("texts", pa.array([t.isoformat() for t in stamps])),
    ):
        path = made.write(table.set_column(0, "time", times), tmp_path / f"{name}.parquet")
        made.same(from_csv, ParquetArchive(path).read(made.valve()))


def test_local_times_without_a_zone_have_no_date(tmp_path: Path) -> None:
    """Durations are right and the start is unknown; a window cannot be placed and says so."""
    from stemwatch.connectors.connector import Window

    table = made.wide_table()
    naive = table.column("time").cast(pa.timestamp("us"))
    path = made.write(table.set_column(0, "time", naive), tmp_path / "naive.parquet")
    recording = ParquetArchive(path).read(made.valve())
    assert (recording.start, recording.interval_s, len(recording)) == (None, 1.0, made.COUNT)
    with pytest.raises(ConnectorError, match="no zone; give the zone, such as 'Europe/Berlin'"):
        ParquetArchive(path).read(made.valve(), Window(start=made.START))


def test_the_repeated_hour_of_autumn_is_told_apart_by_order(tmp_path: Path) -> None:
    """Local times that go back by an hour once are told apart by their order."""
    start = made.START.replace(month=10, day=25, hour=0)
    instants = [start + timedelta(seconds=10 * i) for i in range(720)]
    local = [t.astimezone(ZoneInfo("Europe/Berlin")).replace(tzinfo=None) for t in instants]
    values = pa.array([float(i % 50) for i in range(720)])
    path = made.write(
        pa.table({"time": pa.array(local, pa.timestamp("s")), "A.OP": values}),
        tmp_path / "autumn.parquet",
    )
    tags = ValveTags(valve="A", tags={Role.OP: TagMapping(tag="A.OP")})
    recording = ParquetArchive(path, ReadOptions(zone="Europe/Berlin")).read(tags)
    assert (recording.start, len(recording)) == (start, 720)
    assert (recording.op.quality == Quality.GOOD).all()


@pytest.mark.parametrize(
    "kind",
    [pa.float32(), pa.int16(), pa.decimal128(12, 3), pa.dictionary(pa.int32(), pa.float64())],
)
def test_integers_and_decimals_are_numbers_and_null_is_missing(
    tmp_path: Path, kind: pa.DataType
) -> None:
    """Whole numbers and decimals are numbers; null is missing."""
    values = pa.array([None if i == 3 else float(i % 40) for i in range(300)])
    values = values.dictionary_encode() if pa.types.is_dictionary(kind) else values.cast(kind)
    times = pa.array([made.START + timedelta(seconds=i) for i in range(300)])
    path = made.write(pa.table({"time": times, "A.OP": values}), tmp_path / "kind.parquet")
    op = ParquetArchive(path).read(ValveTags(valve="A", tags={Role.OP: TagMapping(tag="A.OP")})).op
    assert op.values[[0, 1, 39, 40]].tolist() == [0.0, 1.0, 39.0, 0.0]
    assert op.quality[[2, 3, 4]].tolist() == [Quality.GOOD, Quality.MISSING, Quality.GOOD]


def test_mode_words_become_1_and_0(tmp_path: Path) -> None:
    """A text column of modes is 1 for automatic and 0 for manual."""
    times = pa.array([made.START + timedelta(seconds=i) for i in range(300)])
    op = pa.array([float(i % 40) for i in range(300)])
    mode = pa.array(["AUTO" if i < 200 else "MAN" for i in range(300)])
    path = made.write(pa.table({"time": times, "A.OP": op, "A.MODE": mode}), tmp_path / "m.parquet")
    tags = {Role.OP: TagMapping(tag="A.OP"), Role.MODE: TagMapping(tag="A.MODE")}
    signal = ParquetArchive(path).read(ValveTags(valve="A", tags=tags)).signals[Role.MODE]
    assert signal.values[[0, 199, 200]].tolist() == [1.0, 1.0, 0.0]


def test_options_name_the_columns(tmp_path: Path, from_csv: Recording) -> None:
    """Names that say nothing are told by options."""
    table = made.narrow_table().rename_columns(["a", "b", "c", "d"])
    path = made.write(table, tmp_path / "odd.parquet")
    options = ReadOptions(tag_column="a", time_column="b", value_column="c", quality_column="d")
    made.same(from_csv, ParquetArchive(path, options).read(made.valve()))
    with pytest.raises(UnreadableSource, match=r"no column 'e'; the columns are a, b, c, d"):
        ParquetArchive(path, ReadOptions(time_column="e")).read(made.valve())


def test_what_is_no_table_of_samples_says_what_it_is(tmp_path: Path) -> None:
    """No time, no number, no file, no Parquet: each with what was found and expected."""
    op = ValveTags(valve="A", tags={Role.OP: TagMapping(tag="A.OP")})
    no_time = made.write(pa.table({"A.OP": [1.0, 2.0]}), tmp_path / "a.parquet")
    with pytest.raises(UnreadableSource, match=r"none of the columns is the time.*A\.OP \(double"):
        ParquetArchive(no_time).read(op)
    stamps = pa.array([made.START])
    no_number = made.write(pa.table({"time": stamps}), tmp_path / "b.parquet")
    with pytest.raises(UnreadableSource, match="no column holds numbers beside the time 'time'"):
        ParquetArchive(no_number).read(op)
    torn = tmp_path / "c.parquet"
    torn.write_bytes(b"PAR1 and then the disk was full")
    with pytest.raises(UnreadableSource, match=r"no readable Parquet file.*still being written"):
        ParquetArchive(torn).read(op)
    with pytest.raises(UnreadableSource, match=r"no Parquet file was found.*archive/\*\.parquet"):
        ParquetArchive(tmp_path / "gone").read(op)
