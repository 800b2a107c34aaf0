"""Large exports are read in pieces and give what reading them whole gives."""

from __future__ import annotations

import gzip
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, timedelta
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stemwatch.connectors.connector import TagMapping, UnreadableSource, ValveTags
from stemwatch.connectors.historian import HistorianFile, ReadOptions, opened_file
from stemwatch.connectors.historian.columns import convert
from stemwatch.connectors.historian.opened_file import open_file
from stemwatch.connectors.historian.tables import large_file, text_pieces
from stemwatch.models.recording import Role
from tests.connectors.historian.example_exports import everything

ROWS = 900
START = datetime(2026, 10, 25, 0, 50, tzinfo=UTC)  # clocks are put back ten minutes later


@cache
def texts_of_rows(form: str, decimal: str) -> list[tuple[str, ...]]:
    """Time and five values of each row, as most of the exports below print them."""
    rng = np.random.default_rng(3)
    values = 50.0 + np.cumsum(rng.standard_normal((ROWS, 5)) * 0.3, axis=0)
    times = [(START + timedelta(seconds=10 * i)).strftime(form) for i in range(ROWS)]
    return [
        (time, *(f"{value:.3f}".replace(".", decimal) for value in row))
        for time, row in zip(times, values, strict=True)
    ]


def export(
    *,
    separator: str = ",",
    form: str = "%Y-%m-%dT%H:%M:%SZ",
    cells: dict[tuple[int, int], str] | None = None,
    lines: dict[int, str] | None = None,
    end: str = "\n",
    header: str = "",
    decimal: str = ".",
) -> bytes:
    """Two valves at 10 s; some cells and some whole lines are something else."""
    names = ["FIC-1.OP", "FIC-1.ZT", "FIC-1.PV", "FIC-2.OP", "FIC-2.ZT"]
    table = [list(texts) for texts in texts_of_rows(form, decimal)]
    for (i, column), text in (cells or {}).items():
        table[i][column] = text
    rows = [header or separator.join(["Time", *names])]
    rows += [(lines or {}).get(i, separator.join(texts)) for i, texts in enumerate(table)]
    return (end.join(rows) + end).encode("utf-8")


WORDS = {
    **{(3, 1): "Bad", (4, 1): "", (9, 2): "Comm Fail"},
    **{(20, 3): " 12.5", (21, 3): "+7", (30, 3): "7 %", (40, 4): "41 435"},
    **{(31, 5): "1_000", (32, 5): "0x10", (33, 5): "1e999", (34, 5): "nan"},
}
HABIT = {(i, 3): f"1 {i % 900 + 100}" for i in range(ROWS) if i % 3}
WHOLE = {(i, column): str(i % 90) for i in range(ROWS) for column in range(1, 6)}
GOOD = {(i, 2): "Bad" if i % 50 == 0 else "Good" for i in range(ROWS)}
EITHER = {(i, column): f"{i % 90 + 1},{i:03d}" for i in range(ROWS) for column in range(1, 6)}
UNITS = "Time,FIC-1.OP [%],FIC-1.ZT [%],T [°C],FIC-2.OP,FIC-2.ZT"
TWICE = "Time,FIC-1.OP,FIC-1.ZT,FIC-1.PV,FIC-1.OP,FIC-2.ZT"
BERLIN = ReadOptions(zone="Europe/Berlin")
STATUS = "Time,FIC-1.OP,FIC-1.OP Status,FIC-1.ZT,FIC-2.OP,FIC-2.ZT"
FILES: dict[str, tuple[bytes, ReadOptions]] = {
    "plain": (export(), ReadOptions()),
    "semicolons": (export(separator=";", end="\r\n"), ReadOptions()),
    "tabs": (export(separator="\t", form="%Y-%m-%d %H:%M:%S.%f"), BERLIN),
    "day and month": (export(form="%d/%m/%Y %H:%M:%S"), ReadOptions()),
    "cut stamps": (export(form="%Y-%m-%d %H:%M"), ReadOptions(zone="UTC")),
    "month names": (export(form="%d-%b-%y %H:%M:%S"), ReadOptions(zone="UTC")),
    "offsets": (export(form="%Y-%m-%dT%H:%M:%S+02:00"), ReadOptions()),
    "unix": (export(form="%s"), ReadOptions()),
    "words": (export(cells=WORDS), ReadOptions()),
    "decimal comma as said": (
        export(separator=";", decimal=",", cells={(3, 1): "Bad", (5, 1): "1.181,2"}),
        ReadOptions(decimal=","),
    ),
    "thousands apart": (export(cells=HABIT), ReadOptions()),
    "integers": (export(cells=WHOLE), ReadOptions()),
    "bad rows": (
        export(lines={7: "2026-10-25T00:51:10Z,1,2", 8: "", 9: "   ", 500: "x," * 9 + "x"}),
        ReadOptions(),
    ),
    "bad times": (export(cells={(5, 0): "never", (6, 0): "2026-02-30T00:00:00Z"}), ReadOptions()),
    "not the last end": (export()[:-1], ReadOptions()),
    "cut": (export()[:-20], ReadOptions()),
    "status": (export(header=STATUS, cells=GOOD), ReadOptions()),
    "units": (export(header=UNITS), ReadOptions()),
    "one name twice": (export(header=TWICE), ReadOptions()),
}
FILES |= {
    name: (content, ReadOptions())
    for name, content in {
        "quotes": export(cells={(5, 1): '"1.5"', (6, 1): '"a ""word"""', (7, 1): '"two\nlines"'}),
        "a quote that is never closed": export(lines={5: '2026-10-25T00:50:50Z,"1,2,3,4,5'}),
        "lost bytes": export(cells={(5, 1): "12\x00977"}),
        "decimal comma": export(separator=";", decimal=","),
        "decimal comma and words": export(
            separator=";", decimal=",", cells={(3, 1): "Bad", (4, 1): "", (5, 1): "+7,5"}
        ),
        "either mark and semicolons": export(separator=";", cells=EITHER),
        "either mark, and one that settles it": export(
            separator="\t", cells={**EITHER, (800, 3): "0,125"}
        ),
        "a word at the end": export(cells={(ROWS - 1, 2): "Bad"}),
        "headers again": export(lines={5: "Time,FIC-1.OP,FIC-1.ZT,FIC-1.PV,FIC-2.OP,FIC-2.ZT"}),
        "empty cells at the end": export(lines={5: "2026-10-25T00:50:50Z,1,2,3,4,5,,"}),
        "other encoding": export(header="Time,FIC-1.OP,FIC-1.ZT,Hoehe,FIC-2.OP,FIC-2.ZT").replace(
            b"Hoehe", b"H\xf6he"
        ),
        "bytes that no encoding has": export(cells={(5, 1): "x"}).replace(b",x,", b",\x81,"),
        "old line ends": export(end="\r"),
        "compressed": gzip.compress(export()),
        "compressed and cut": gzip.compress(export())[:-3000],
        "compressed in parts": gzip.compress(export()[:9000]) + gzip.compress(export()[9000:]),
    }.items()
}
READ_WHOLE = {
    "control characters": export(cells={(5, 1): "\x0c1.5"}),
    "a character that is cut": export()[:-1] + "é".encode()[:1],
}


@pytest.fixture
def whole_and_in_pieces(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Reads a file both ways."""

    def read(content: bytes, options: ReadOptions) -> tuple[tuple, tuple, bool]:
        path = tmp_path / "export.csv"
        path.write_bytes(content)
        complete = everything(path, options, UnreadableSource)
        monkeypatch.setattr(large_file, "LARGE_BYTES", 0)
        monkeypatch.setattr(text_pieces, "BLOCK", 10_000)
        monkeypatch.setattr(text_pieces, "HEAD_LINES", 700)
        try:
            in_pieces = open_file(path, options).in_pieces
        except UnreadableSource:
            in_pieces = False
        return complete, everything(path, options, UnreadableSource), in_pieces

    return read


@pytest.mark.parametrize("name", FILES)
def test_in_pieces_it_is_the_same(whole_and_in_pieces, name: str) -> None:
    """Every value, quality, decision and problem."""
    complete, pieces, in_pieces = whole_and_in_pieces(*FILES[name])
    assert in_pieces
    assert pieces == complete


@pytest.mark.parametrize("name", READ_WHOLE)
def test_what_could_be_misread_in_pieces_is_read_whole(whole_and_in_pieces, name: str) -> None:
    """With the same result as ever."""
    complete, pieces, in_pieces = whole_and_in_pieces(READ_WHOLE[name], ReadOptions())
    assert not in_pieces
    assert pieces == complete


def test_many_who_ask_for_valves_of_one_file_at_once_come_one_by_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a page does with its plots: what is converted for the one is let go for the other."""
    monkeypatch.setattr(large_file, "LARGE_BYTES", 0)
    monkeypatch.setattr(opened_file, "_NUMBERS_KEPT", 1)
    path = tmp_path / "export.csv"
    path.write_bytes(export())
    valves = [
        ValveTags(valve=name, tags={Role.OP: TagMapping(tag=f"{name}.OP")})
        for name in ("FIC-1", "FIC-2")
    ]
    alone = [HistorianFile(path).read(valve) for valve in valves]
    at_work: list[int] = []
    most = 0

    def slowly(*columns: Any, **options: Any) -> Any:
        nonlocal most
        at_work.append(1)
        most = max(most, len(at_work))
        time.sleep(0.02)
        at_work.pop()
        return convert(*columns, **options)

    monkeypatch.setattr(opened_file, "convert", slowly)
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(HistorianFile(path).read, valves * 2))
    assert most == 1
    for expected, recording in zip(alone * 2, together, strict=True):
        np.testing.assert_array_equal(recording.op.values, expected.op.values)


def test_marks_that_nothing_settles_are_refused_alike(whole_and_in_pieces) -> None:
    """With the count of all different numbers, though one would do to be in doubt."""
    content = export(separator="\t", cells=EITHER)
    complete, pieces, _ = whole_and_in_pieces(content, ReadOptions())
    assert pieces == complete
    assert "numbers such as '1,234'" in pieces[0]


def narrow_export(quality: Callable[[int, int], str], *, in_order: bool = True) -> bytes:
    """A row per sample, with a quality code; five tags."""
    tags = ("FIC-1.OP", "FIC-1.ZT", "FIC-1.PV", "FIC-2.OP", "FIC-2.ZT")
    rows = ["DateTime,TagName,Value,QualityDetail"]
    for i in range(ROWS):
        stamp = f"{START + timedelta(seconds=i):%Y-%m-%d %H:%M:%S}"
        order = range(5) if in_order else np.random.default_rng(i).permutation(5).tolist()
        rows += [f"{stamp},{tags[n]},{40 + (i * 7 + n) % 23}.{n},{quality(i, n)}" for n in order]
    return ("\n".join(rows) + "\n").encode()


@pytest.mark.parametrize("in_order", [True, False])
@pytest.mark.parametrize(
    "quality",
    [
        lambda i, n: "192",
        lambda i, n: "0" if i % 9 == n else "192",
        lambda i, n: " 192" if i % 2 else "192 ",
        lambda i, n: "" if n == 2 else "192",
        lambda i, n: "24" if (i, n) == (ROWS - 1, 4) else "192",
    ],
    ids=["one code", "two codes", "blanks", "none for a tag", "another at the end"],
)
def test_codes_of_a_row_per_sample(whole_and_in_pieces, quality, in_order: bool) -> None:
    """Codes and tags are read once for all tags, and each tag gets its own."""
    content = narrow_export(quality, in_order=in_order)
    complete, pieces, in_pieces = whole_and_in_pieces(content, BERLIN)
    assert in_pieces
    assert pieces == complete


def test_texts_that_are_no_codes_are_not_kept(whole_and_in_pieces, monkeypatch) -> None:
    """A column of so many texts is read where it is asked for."""
    monkeypatch.setattr(large_file, "_MOST_CODES", 3)
    content = narrow_export(lambda i, n: str(192 + i % 7))
    complete, pieces, in_pieces = whole_and_in_pieces(content, BERLIN)
    assert in_pieces
    assert pieces == complete


def test_a_file_that_grows_meanwhile_is_read_as_it_was(tmp_path: Path, monkeypatch) -> None:
    """A historian still writes it: no row is filed under another time."""
    monkeypatch.setattr(large_file, "LARGE_BYTES", 0)
    path = tmp_path / "export.csv"
    path.write_bytes(export())
    before = open_file(path, ReadOptions()).column("FIC-2.ZT").values
    opened = open_file(path, ReadOptions())
    with path.open("ab") as file:
        file.write(export().split(b"\n", 1)[1])
    assert np.array_equal(opened.column("FIC-2.ZT").values, before)
    path.write_bytes(export()[: len(export()) // 2])
    with pytest.raises(UnreadableSource, match=r"export\.csv: has become shorter"):
        opened.column("FIC-1.PV")


READ_ONE = """
import pathlib, re, sys
from stemwatch.connectors.connector import TagMapping, ValveTags
from stemwatch.connectors.historian import HistorianFile
from stemwatch.models.recording import Role
tags = {role: TagMapping(tag=f"V12.{role.value.upper()}", unit="%") for role in (Role.OP, Role.MV)}
recording = HistorianFile(sys.argv[1]).read(ValveTags(valve="V12", tags=tags))
status = pathlib.Path("/proc/self/status").read_text()
print(len(recording), int(re.search(r"VmHWM:\\s+(\\d+) kB", status)[1]) // 1024)
"""
TWO_GB = ("plain", "narrow", "AVEVA Insight")
KINDS = ("quoted", "cp1252", "packed")
VALVES = 24
TAG_NAMES = [f"V{n}.{role}" for n in range(VALVES) for role in ("OP", "MV")]

WHICH_HOUR = b"yyyy-mm-ddThh"


def any_hour(kind: str, rows: list[list[str]]) -> str:
    """An hour at 1 s, as text, with ``WHICH_HOUR`` where each time says which."""
    hour = WHICH_HOUR.decode()
    stamps = [f"{hour}:{s // 60:02d}:{s % 60:02d}Z" for s in range(3600)]
    if kind in ("narrow", "AVEVA Insight"):
        form = "{};{};{}\n" if kind == "narrow" else "{},{},{},192\n"
        return "".join(
            form.format(tag, stamp, value)
            for stamp, row in zip(stamps, rows, strict=True)
            for tag, value in zip(TAG_NAMES, row, strict=True)
        )
    apart = '","' if kind == "quoted" else ","
    quote = '"' if kind == "quoted" else ""
    return "".join(
        f"{quote}{stamp}{apart}{apart.join(row)}{quote}\n"
        for stamp, row in zip(stamps, rows, strict=True)
    )


def write_hours(path: Path, kind: str, megabytes: int) -> int:
    """An export at 1 s of so many MB of text: the same hour again and again; how many instants."""
    walk = np.cumsum(np.random.default_rng(1).standard_normal((3600, 2 * VALVES)) * 0.05, axis=0)
    rows = [[f"{value:.2f}" for value in row] for row in (50 + walk).tolist()]
    header = {
        "narrow": "Tag;Time;Value",
        "AVEVA Insight": "TagName,DateTime,Value,OpcQuality",
        "cp1252": ",".join(["Zeit in °", *TAG_NAMES]),
    }.get(kind, ",".join(["Time", *TAG_NAMES]))
    hour_text = any_hour(kind, rows).encode()
    hours = written = 0
    with gzip.open(path, "wb", 1) if kind == "packed" else path.open("wb") as file:
        file.write((header + "\n").encode("cp1252"))
        while written < megabytes * 10**6:
            hour = datetime(2026, 1, 1, tzinfo=UTC) + timedelta(hours=hours)
            written += file.write(hour_text.replace(WHICH_HOUR, f"{hour:%Y-%m-%dT%H}".encode()))
            hours += 1
    return 3600 * hours


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="memory is read from /proc")
@pytest.mark.parametrize(
    ("kind", "megabytes", "most_mb"),
    [
        ("quoted", 16, 200),
        pytest.param("narrow", 16, 400, marks=pytest.mark.long),
        *(
            pytest.param(kind, 2000, 1500, marks=[pytest.mark.long, pytest.mark.study])
            for kind in TWO_GB
        ),
        *(pytest.param(kind, 500, 1000, marks=pytest.mark.long) for kind in KINDS),
    ],
)
def test_one_valve_of_a_large_export_needs_little_memory(
    tmp_path: Path, kind: str, megabytes: int, most_mb: int
) -> None:
    """2 GB in less than 1.5 GB, whatever else is in the file, also with a row for each sample;
    written in other ways, 500 MB in less than 1 GB."""
    rows = write_hours(tmp_path / "export.csv", kind, megabytes)
    command = [sys.executable, "-c", READ_ONE, str(tmp_path / "export.csv")]
    text = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    (tmp_path / "export.csv").unlink()
    assert int(text[0]) == rows
    assert int(text[1]) < most_mb
