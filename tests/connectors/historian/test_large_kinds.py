"""Whatever an export is written like, in pieces it gives what it gives when it is read whole."""

from __future__ import annotations

import csv
import io
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from unittest import mock

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from stemwatch.connectors.connector import ConnectorError, UnreadableSource
from stemwatch.connectors.historian import ReadOptions
from stemwatch.connectors.historian.opened_file import open_file
from stemwatch.connectors.historian.tables import large_file, row_pieces, text_pieces
from stemwatch.connectors.historian.times import zones
from tests.connectors.historian.example_exports import LAYOUTS, Kind, everything, written

ZONE = ReadOptions(zone="Europe/Berlin")


@contextmanager
def small_pieces() -> Iterator[None]:
    """Files of any size are read in pieces of a few lines."""
    with (
        mock.patch.object(large_file, "LARGE_BYTES", 0),
        mock.patch.object(text_pieces, "BLOCK", 5_000),
        mock.patch.object(text_pieces, "HEAD_LINES", 700),
        mock.patch.object(large_file, "_ROWS_AT_ONCE", 300),
        mock.patch.object(zones, "_ROWS_AT_ONCE", 70),
    ):
        yield


def both_ways(kind: Kind, options: ReadOptions = ZONE) -> tuple[object, object, bool]:
    """What reading whole gives, what reading in pieces gives, and whether it was in pieces."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / ("export.csv.gz" if kind.packed else "export.csv")
        path.write_bytes(written(kind))
        complete = everything(path, options, ConnectorError)
        with small_pieces():
            pieces = everything(path, options, ConnectorError)
            try:
                in_pieces = open_file(path, options).in_pieces
            except UnreadableSource:
                in_pieces = False
    return complete, pieces, in_pieces


def comma_apart(layout: str) -> Kind:
    """A layout as plants with decimal commas write it."""
    return Kind(layout=layout, separator=";", decimal=",")


WRITTEN = {
    "plain": Kind(),
    "quoted": Kind(quoted="all"),
    "words quoted": Kind(quoted="words", end="\r\n"),
    "packed": Kind(packed=True),
    "cp1252": Kind(encoding="cp1252", cells=((0.4, "12°"),)),
    "utf-16": Kind(encoding="utf-16"),
    "by tag": Kind(by_tag=True),
}


@pytest.mark.parametrize(
    ("layout", "way"),
    [
        # Every layout and every way in every run, all of their pairs in the long one.
        pytest.param(
            layout,
            WRITTEN[way],
            marks=[pytest.mark.long] if way != "plain" and (row + place) % 4 else [],
            id=f"{way}-{layout}",
        )
        for place, way in enumerate(WRITTEN)
        for row, layout in enumerate(LAYOUTS)
    ],
)
def test_every_layout_is_read_in_pieces_and_gives_the_same(layout: str, way: Kind) -> None:
    """Values, quality, decisions and problems."""
    complete, pieces, in_pieces = both_ways(replace(way, layout=layout))
    assert pieces == complete
    assert in_pieces or len(complete) == 1


CELLS = st.sampled_from(
    ["", " ", "Bad", "41 435", "1.234,5", "1,234", "12,5", "+7", "7 %", "1e999", "nan", "NaN",
     "12\x00977", 'a "word"', "two\nlines", "Â°C", "\u2212 3", "1_000", "0", "99999",
     "No Good Data For Calculation", "\u00a05", "1e5", "  8.25 "]
)  # fmt: skip
LINES = st.sampled_from(
    ["", "   ", "x", 'an "odd quote', '"never closed', "1,2,3,4,5,6,7,8,9,10", ",,,,,,,", ";;;",
     "2026-10-25T00:51:10Z,1,2", "[Tags]", "* a comment", "Time,FIC-1.OP,FIC-1.ZT,FIC-1.PV,TIC-2.OP"
     ",TIC-2.ZT", "#datatype,string", "never,1,2,3,4,5", "\x00\x00\x00", "a\x0cb"]
)  # fmt: skip
SHARE = st.floats(0.0, 1.0).map(lambda share: round(share, 3))
KINDS = st.builds(
    Kind,
    layout=st.sampled_from(sorted(LAYOUTS)),
    separator=st.sampled_from([",", ";", "\t", "|"]),
    decimal=st.sampled_from([".", ","]),
    quoted=st.sampled_from(["no", "words", "all"]),
    encoding=st.sampled_from(["utf-8", "utf-8-sig", "cp1252", "utf-16", "gb18030"]),
    end=st.sampled_from(["\n", "\r\n", "\r"]),
    packed=st.booleans(),
    by_tag=st.booleans(),
    cells=st.lists(st.tuples(SHARE, CELLS), max_size=6).map(tuple),
    lines=st.lists(st.tuples(SHARE, LINES), max_size=4).map(tuple),
    last_end=st.booleans(),
)


@settings(max_examples=12)
@given(kind=KINDS, zone=st.sampled_from([None, "Europe/Berlin"]))
def test_damaged_in_any_way_it_is_the_same(kind: Kind, zone: str | None) -> None:
    """Bad cells with their lines and every warning, too."""
    complete, pieces, _ = both_ways(kind, ReadOptions(zone=zone))
    assert pieces == complete


@pytest.mark.long
@settings(max_examples=200)
@given(kind=KINDS, zone=st.sampled_from([None, "Europe/Berlin"]))
def test_damaged_in_two_hundred_ways_it_is_the_same(kind: Kind, zone: str | None) -> None:
    """The same, longer."""
    complete, pieces, _ = both_ways(kind, ReadOptions(zone=zone))
    assert pieces == complete


@settings(max_examples=300)
@given(text=st.text(alphabet='a",;\n', max_size=40))
@example(text='"","",""\n')
@example(text='",",","\n')
@example(text='"a"",""b"\n')
@example(text='"a","b\nc","d"\n')
def test_quotes_are_taken_off_where_each_is_around_a_cell(text: str) -> None:
    """The rows are then those of a reader that looks at every sign; else it is left to that."""
    data = text.encode() + b"\n"
    bare = row_pieces._without_quotes(data, b",") if b'"' in data else None
    if bare is not None:
        rows = [line.split(row_pieces.MARK) for line in bare.decode().split("\n")[:-1]]
        told = list(csv.reader(io.StringIO(data.decode(), newline=""), strict=True))
        assert [row for row in rows if row != [""]] == [
            row for row in told if row not in ([], [""])
        ]


@pytest.mark.long
def test_one_valve_of_thirty_thousand_columns_is_read_by_its_name(
    tmp_path: Path,
) -> None:
    """In pieces, though a line has 200 kB."""
    tags = [f"FIC-{n // 2:05d}.{('OP', 'MV')[n % 2]}" for n in range(30_310)]
    path = tmp_path / "export.csv"
    with path.open("w", encoding="cp1252") as file:
        file.write(",".join(["Zeit °", *tags]) + "\n")
        for second in range(30):
            cells = ",".join(f"{n % 90 + second / 10:.1f}" for n in range(len(tags)))
            file.write(f"2026-01-01T00:00:{second:02d}Z,{cells}\n")
    opened = open_file(path, ReadOptions(), ["FIC-15000.MV"])
    assert opened.in_pieces
    expected = [30_001 % 90 + second / 10 for second in range(30)]
    assert opened.column("FIC-15000.MV").values.tolist() == pytest.approx(expected, abs=1e-9)
