"""Only the files, row groups and columns that a valve and a window need are read.

Everything else is overwritten with nonsense first: had it been read, reading would fail.
"""

from __future__ import annotations

from collections.abc import Callable
from datetime import timedelta
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from stemwatch.connectors.connector import ConnectorError, TagMapping, ValveTags, Window
from stemwatch.connectors.parquet import ParquetArchive
from stemwatch.models.recording import Role
from tests.connectors import example_archives as made

VALVES = [f"FIC{number}" for number in range(6)]
WINDOW = Window(start=made.START, stop=made.START + timedelta(seconds=300))


def tags(name: str) -> ValveTags:
    """OP and MV of a valve of the layout with a row for each instant."""
    named = {Role.OP: TagMapping(tag=f"{name}.op"), Role.MV: TagMapping(tag=f"{name}.mv")}
    return ValveTags(valve=name, tags=named)


def spoil(path: Path, keep: Callable[[int, str], bool]) -> int:
    """Overwrite every column chunk but those that ``keep`` (row group, column) names; how many."""
    metadata = pq.read_metadata(path)
    content = bytearray(path.read_bytes())
    spoilt = 0
    for group in range(metadata.num_row_groups):
        for index in range(metadata.num_columns):
            chunk = metadata.row_group(group).column(index)
            if keep(group, chunk.path_in_schema):
                continue
            first = chunk.dictionary_page_offset or chunk.data_page_offset
            content[first : first + chunk.total_compressed_size] = (
                b"\xff" * chunk.total_compressed_size
            )
            spoilt += 1
    path.write_bytes(content)
    return spoilt


@pytest.fixture
def archive(tmp_path: Path) -> Path:
    """Six valves on three days, each day a file in a folder, each valve a row group."""
    for day in range(3):
        date = (made.START + timedelta(days=day)).date().isoformat()
        tables = [made.valves_table(name, days=day) for name in VALVES]
        path = tmp_path / "archive" / f"date={date}" / "part-0.parquet"
        made.write(pa.concat_tables(tables), path, row_group_size=599)
    return tmp_path / "archive"


def test_only_the_needed_row_group_and_columns_are_read(archive: Path) -> None:
    """Of 18 row groups and 6 columns, what is read is one group and time, op and its quality,
    mv."""
    before = ParquetArchive(archive).read(tags("FIC4"), WINDOW)
    expected = {"time", "op", "mv", "op_quality"}
    spoilt = 0
    for file in sorted(archive.rglob("*.parquet")):
        own = "2026-01-05" in str(file)
        spoilt += spoil(file, lambda g, c, own=own: own and g == 4 and c in expected)  # type: ignore[misc]
    assert spoilt == 3 * 6 * 6 - 4
    repeated = ParquetArchive(archive).read(tags("FIC4"), WINDOW)
    made.same(before, repeated)
    with pytest.raises(ConnectorError, match=r"row group 6 cannot be read.*damaged"):
        ParquetArchive(archive).read(tags("FIC5"), WINDOW)


def test_listing_tags_reads_no_samples(archive: Path) -> None:
    """Footers name the valves where each has its own row groups, with roles and numbers."""
    for file in archive.rglob("*.parquet"):
        spoil(file, lambda group, column: False)
    infos = {info.tag: info for info in ParquetArchive(archive).tags()}
    assert len(infos) == 18
    op = infos["FIC3.op"]
    assert (op.proposed_role, op.proposed_valve, op.samples) == (Role.OP, "FIC3", 3 * 598)
    assert infos["FIC3.mv"].proposed_role is Role.MV


def test_folders_of_other_days_are_not_opened(archive: Path) -> None:
    """A file without a footer in the folder of another week costs nothing."""
    torn = archive / "date=2026-02-11" / "part-0.parquet"
    torn.parent.mkdir()
    torn.write_bytes(b"nonsense")
    recording = ParquetArchive(archive).read(tags("FIC0"), WINDOW)
    assert not any("Problem" in decision for decision in recording.provenance.decisions)


def test_one_torn_file_is_a_problem_not_the_end(archive: Path) -> None:
    """A file of the same day that cannot be read is named, and the rest is read."""
    torn = archive / "date=2026-01-05" / "part-1.parquet"
    torn.write_bytes(b"nonsense")
    recording = ParquetArchive(archive).read(tags("FIC0"), WINDOW)
    assert len(recording) == 300
    assert any("part-1.parquet" in decision for decision in recording.provenance.decisions)


@pytest.mark.parametrize(
    "folder", ["year=2026/month=1/day=5", "year=2026/month=01", "day=20260105"]
)
def test_year_month_and_day_folders_are_dates(tmp_path: Path, folder: str) -> None:
    """Year, month and day, with or without zeros; folders that are no date exclude nothing."""
    made.write(made.valves_table("A"), tmp_path / folder / "a.parquet")
    (tmp_path / "year=2025").mkdir()
    (tmp_path / "year=2025" / "torn.parquet").write_bytes(b"nonsense")
    (tmp_path / "date=soon").mkdir()
    made.write(made.valves_table("B"), tmp_path / "date=soon" / "b.parquet")
    archive = ParquetArchive(tmp_path)
    for name in "AB":
        recording = archive.read(tags(name), WINDOW)
        assert (len(recording), recording.start) == (300, made.START)
        assert not any("torn" in decision for decision in recording.provenance.decisions)


@pytest.mark.parametrize("window", [WINDOW, Window(start=made.START), Window(stop=WINDOW.stop)])
def test_folders_at_the_ends_of_the_calendar_cost_the_others_nothing(
    tmp_path: Path, window: Window
) -> None:
    """9999-12-31 often stands for no date."""
    made.write(made.valves_table("A"), tmp_path / "date=2026-01-05" / "a.parquet")
    for folder in ("date=9999-12-31", "date=0001-01-01", "year=9999/month=12", "year=1/month=1"):
        made.write(made.valves_table("B"), tmp_path / folder / "b.parquet")
    assert len(ParquetArchive(tmp_path).read(tags("A"), window)) >= 300


def test_folders_of_neighbouring_days_are_read_too(tmp_path: Path) -> None:
    """A window of a UTC day also looks into the folders of the days beside it."""
    made.write(made.valves_table("A"), tmp_path / "date=2026-01-06" / "a.parquet")
    assert len(ParquetArchive(tmp_path).read(tags("A"), WINDOW)) == 300


def test_values_before_the_window_are_held_into_it(tmp_path: Path) -> None:
    """With before_s a set point that was written before the window still holds in it."""
    seconds = np.arange(0, 1200)
    rows = [("A.OP", int(s), float(s % 50)) for s in seconds]
    rows += [("A.SP", 60 * k, 10.0 + k) for k in range(0, 20)]
    names, at, values = zip(*sorted(rows, key=lambda row: row[1]), strict=True)
    times = [made.START + timedelta(seconds=s) for s in at]
    path = made.write(
        pa.table({"tag": names, "time": times, "value": values}), tmp_path / "n.parquet"
    )
    both = {Role.OP: TagMapping(tag="A.OP"), Role.SP: TagMapping(tag="A.SP")}
    window = Window(start=made.START + timedelta(seconds=630))
    valve = ValveTags(valve="A", tags=both)
    without = ParquetArchive(path).read(valve, window).signals[Role.SP]
    recording = ParquetArchive(path, before_s=120.0).read(valve, window)
    assert np.isnan(without.values[0])
    assert (recording.start, recording.signals[Role.SP].values[0]) == (window.start, 20.0)


def test_a_file_that_is_written_anew_is_read_anew(tmp_path: Path, monkeypatch) -> None:
    """A service runs for months: a file of another size or time is another file."""
    monkeypatch.setattr("stemwatch.connectors.parquet.catalog.FRESH_S", 0.0)
    archive = ParquetArchive(tmp_path)
    made.write(made.valves_table("A"), tmp_path / "a.parquet")
    assert {info.proposed_valve for info in archive.tags()} == {"A"}
    made.write(made.valves_table("B").slice(0, 300), tmp_path / "a.parquet")
    made.write(made.valves_table("C"), tmp_path / "c.parquet")
    assert {info.proposed_valve for info in archive.tags()} == {"B", "C"}
