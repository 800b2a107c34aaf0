"""Property tests: damaged and hostile files, and round trips through every locale."""

from __future__ import annotations

import re
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from stemwatch.connectors.connector import ConnectorError, TagMapping, ValveTags
from stemwatch.connectors.historian import HistorianFile, ReadOptions, propose_valves
from stemwatch.connectors.historian.opened_file import OpenedFile, open_file
from stemwatch.connectors.historian.proposed_plant import ProposedSource, plant_toml
from stemwatch.connectors.historian.values.numbers import parse_number
from stemwatch.models.recording import Role

quick = settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
HOSTILE = [
    "", " ", "NaN", "inf", "-inf", "1e308", "-1e308", "1e999", "1e-300", "3.5e-44", "=1+1",
    "=cmd|'/c calc'!A1", "١٢٣", "１２", "1_000", "0x1F", "1,5", "1.5", "1.181,2", "11,006.5", "Bad",
    "#N/A", "Resize to show all values", "\"", "a\"b", "\"\"", "\0", "\ufeff", "9" * 400,
    "x" * 5000,
    "2026-02-30 00:00:00", "9999-12-31 23:59:59", "0001-01-01", "25:61:61", "1e5", "--5", "+-5",
    "246", "255", "True", "\t", ";", "|", "🙂", "-", "2026-01-05T06:00:00+99:99", "1.#QNAN",
]  # fmt: skip


def look(path: Path, options: ReadOptions | None = None) -> OpenedFile | None:
    """Everything a user can ask of a file; only ``ConnectorError`` may come out."""
    try:
        source = HistorianFile(path, options or ReadOptions())
        seen = source.inspect()
        plant_toml([ProposedSource("historian", seen.source, (seen,))])
        for valve in propose_valves(source):
            try:
                source.read(valve)
            except ConnectorError as error:
                assert_teaches(error, path)
        return open_file(path, options or ReadOptions())
    except ConnectorError as error:
        assert_teaches(error, path)
        return None


def assert_teaches(error: ConnectorError, path: Path) -> None:
    """A refusal names its file."""
    assert str(path) in str(error)


def assert_no_invented_number(opened: OpenedFile, text: str) -> None:
    """Each value stands in the text as a number."""
    written = {
        number
        for token in re.split(r"[\n,;\t|\"]", text) + re.split(r"[\n;\t|\"]", text)
        for mark in ".,"
        if (number := parse_number(token, mark)) is not None
    }
    for column in opened.table.columns:
        values = opened.column(column.tag).values
        assert set(values[np.isfinite(values)].tolist()) <= written


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One file that every example writes anew."""
    return tmp_path_factory.mktemp("hostile") / "x.csv"


def write(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


@quick
@given(st.binary(max_size=400))
def test_random_bytes_are_an_error_or_a_table(path: Path, content: bytes) -> None:
    """Random bytes are an error with the file's name, or a table, and never anything else."""
    look(write(path, content))


BASES = {
    "wide": "Time,FIC1.OP,FIC1.PV\n"
    + "".join(f"2026-01-05 06:00:{i:02d},{i}.5,{i}.25\n" for i in range(12)),
    "german": "Zeitstempel;FIC1.OP;Status\n"
    + "".join(f"28.10.2026 06:00:{i:02d};{i},5;Good\n" for i in range(12)),
    "narrow": "Tag,Time,Value,Quality\n"
    + "".join(f"FIC1.OP,2026-01-05T06:00:{i:02d}Z,{i}.5,192\n" for i in range(12)),
    "processdata": "PROCESSDATA\tX Data\tyyyy\n4\t10\t2024-06-09 07:50:00\t12\n"
    "tagname\tX.MV\tX.PV\tbOpOFL\ndesc\tx_OP\tx_PV\tbOpOFL\nfsMax=1\n"
    + "".join(f"2024-06-09 07:5{i // 6}:{i % 6}0\t{i}.5\t{i}.25\t0\n" for i in range(12)),
    "proficy": "[Data]\nTagname,TimeStamp,Value,DataQuality\n"
    + "".join(f"A.OP,7/20/01 11:{i:02d},{i}.5,Good\n" for i in range(12)),
    "extract": "".join(f"{1601890328 + i}:7600,A.OP,{i}.5,float,GOOD\n" for i in range(12)),
    "aveva": "DateTime,TagName,Value,vValue,Quality,QualityDetail\n"
    + "".join(f"2017-02-17 15:40:{i:02d}.0000000,A.OP,{i}.5,{i}.5,0,192\n" for i in range(12)),
    "ignition": "#NAMES\nt_stamp,A/OP\n#TYPES\ndate,D\n#ROWS,12\n"
    + "".join(f"2026-10-28 06:00:{i:02d},{i}.5\n" for i in range(12)),
    "influx": "#datatype,string,long,dateTime:RFC3339,double,string\n"
    ",result,table,_time,_value,_field\n"
    + "".join(f",,0,2026-10-28T05:00:{i:02d}Z,{i}.5,A.OP\n" for i in range(12)),
    "citect": "Time,Milliseconds,A.OP\n"
    + "".join(f"15/06/2004 01:17:{i:02d},100,{i}.5\n" for i in range(12)),
    "ip21": "NAME,IP_TREND_TIME,IP_TREND_VALUE\n"
    + "".join(f"A.OP,28-OCT-26 06:00:{i:02d}.0,{i}.5\n" for i in range(12)),
    "plain": "t_s,SP,PV,OP\n" + "".join(f"{i},1,2,{i}.5\n" for i in range(12)),
}


@pytest.mark.parametrize("base", BASES, ids=str)
@settings(max_examples=12, deadline=None)
@given(data=st.data())
def test_hostile_cells_give_no_invented_number(path: Path, base: str, data: st.DataObject) -> None:
    """Hostile cells anywhere in any layout: no crash, and no number that is not in the text."""
    lines = [re.split(r"([,;\t])", line) for line in BASES[base].split("\n")]
    for _ in range(data.draw(st.integers(1, 5))):
        row = data.draw(st.integers(0, len(lines) - 1))
        cell = data.draw(st.integers(0, len(lines[row]) - 1))
        lines[row][cell] = data.draw(st.sampled_from(HOSTILE) | st.text(max_size=8))
    text = "\n".join("".join(line) for line in lines)
    opened = look(write(path, text.encode("utf-8", "replace")))
    if opened is not None and base not in ("extract", "processdata"):
        assert_no_invented_number(opened, text)


@pytest.mark.parametrize("base", BASES, ids=str)
@settings(max_examples=15, deadline=None)
@given(cut=st.floats(0, 1), encoding=st.sampled_from(["utf-8", "utf-16", "cp1252"]))
def test_a_file_cut_anywhere_is_read_or_refused(
    path: Path, base: str, cut: float, encoding: str
) -> None:
    """A file cut at any byte is read up to there or refused."""
    content = BASES[base].encode(encoding)
    look(write(path, content[: int(cut * len(content))]))


@quick
@given(data=st.data())
def test_lines_of_mixed_layouts_never_crash(path: Path, data: st.DataObject) -> None:
    """Lines of different layouts in one file."""
    pool = [line for text in BASES.values() for line in text.split("\n")]
    lines = data.draw(st.lists(st.sampled_from(pool), max_size=40))
    look(write(path, "\n".join(lines).encode()))


def test_huge_field_is_one_cell(path: Path) -> None:
    """A field of a megabyte is a bad cell of its row."""
    text = BASES["plain"].replace("3,1,2,3.5", f"3,1,2,{'9x' * 500_000}")
    path.write_text(text)
    opened = look(path)
    assert opened is not None
    assert int(np.isfinite(opened.column("OP").values).sum()) == 11


def test_a_row_of_a_million_cells_is_left_out(path: Path) -> None:
    """A row of a million cells is reported and left out."""
    path.write_text(BASES["plain"] + "1," * 1_000_000 + "\n")
    opened = look(path)
    assert opened is not None
    assert "line 14: 1000001 cells where 4 were expected" in opened.notes.problems[0]


FORMS = {
    "iso": "%Y-%m-%dT%H:%M:%S",
    "german": "%d.%m.%Y %H:%M:%S",
    "british": "%d/%m/%Y %H:%M:%S",
    "american": "%m/%d/%Y %I:%M:%S %p",
    "pi": "%d-%b-%y %H:%M:%S",
    "compact": "%Y%m%d %H%M%S",
}
numbers = st.floats(-1e6, 1e6, allow_nan=False).map(lambda v: round(v, 4) + 0.0)


@settings(max_examples=120, deadline=None)
@given(
    values=st.lists(numbers.filter(lambda v: v == 0 or abs(v) > 1e-3), min_size=5, max_size=30),
    form=st.sampled_from(sorted(FORMS)),
    separator=st.sampled_from(",;\t|"),
    decimal=st.sampled_from(".,"),
    encoding=st.sampled_from(["utf-8", "utf-8-sig", "utf-16", "cp1252"]),
    end=st.sampled_from(["\n", "\r\n", "\r"]),
    step_s=st.sampled_from([1, 5, 10, 60, 3600]),
)
def test_a_table_in_any_locale_reads_back_the_same(
    path: Path,
    values: list[float],
    form: str,
    separator: str,
    decimal: str,
    encoding: str,
    end: str,
    step_s: int,
) -> None:
    """A table written in any locale reads back the same numbers at the same times."""
    start = datetime(2026, 10, 27, 23, 30, tzinfo=UTC)
    quote = '"' if separator == decimal else ""
    lines = [f"Time{separator}Höhe.OP"]
    for i, value in enumerate(values):
        number = repr(value).replace(".", decimal)
        time = (start + timedelta(seconds=i * step_s)).strftime(FORMS[form])
        lines.append(f"{time}{separator}{quote}{number}{quote}")
    write(path, end.join([*lines, ""]).encode(encoding))
    options = ReadOptions(zone="UTC", decimal=decimal)  # type: ignore[arg-type]
    valve = ValveTags(valve="V", tags={Role.OP: TagMapping(tag="Höhe.OP")})
    recording = HistorianFile(path, options).read(valve)
    assert recording.start == start
    assert recording.interval_s == step_s
    kept = recording.op.values[np.isfinite(recording.op.values)].tolist()
    assert kept == values
