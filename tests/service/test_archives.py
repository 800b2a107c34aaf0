"""Archives as sources of a plant: the same screening from a text export and from each of them."""

from __future__ import annotations

import csv
import json
import pickle
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from sqlalchemy import create_engine, text

from stemwatch.connectors.connector import ConnectorError, Window
from stemwatch.service.config import load_plant
from stemwatch.service.run.plan import Request, make_plan
from stemwatch.service.run.task import screen_tasks
from stemwatch.service.serve.page_server import recording_reader
from stemwatch.service.store.store import open_store

VALVE = "FIC-104"
COMPARED = ("verdict", "reason", "window", "stiction", "residuals", "quality", "indicators")
Row = tuple[str, datetime, float | None, str]
PLANT = """\
[plant]
zone = "Europe/Berlin"

[[sources]]
name = "archive"
{source}

[[valves]]
id = "FIC-104"
source = "archive"
tags.op = {{ tag = "{prefix}FIC-104.OP", unit = "%" }}
tags.mv = {{ tag = "{prefix}FIC-104.ZT", unit = "%" }}
tags.sp = {{ tag = "{prefix}FIC-104.NOT.THERE", unit = "%" }}
"""


@pytest.fixture
def rows(one_valve: Path) -> list[Row]:
    """(tag, time, value, quality) of OP and position in the small plant's export."""
    with one_valve.open(encoding="utf-8", newline="") as file:
        header, _, *lines = csv.reader(file)
    places = [header.index(f"{VALVE}.{ending}") for ending in ("OP", "ZT")]
    return [
        (header[index], datetime.fromisoformat(line[0]).astimezone(UTC), *understood(line[index]))
        for line in lines
        for index in places
    ]


def understood(cell: str) -> tuple[float | None, str]:
    """A cell's number and quality; the archive's own word where it is none."""
    try:
        return float(cell), "Good"
    except ValueError:
        return None, cell


@contextmanager
def parquet(rows: list[Row], folder: Path) -> Iterator[tuple[str, str]]:
    """Folders by date, a row for each sample."""
    dates = sorted({time.date() for _, time, _, _ in rows})
    for date in dates:
        own = [row for row in rows if row[1].date() == date]
        names = ("tag", "time", "value", "quality")
        table = pa.table(dict(zip(names, map(list, zip(*own, strict=True)), strict=True)))
        path = folder / "archive" / f"date={date}" / "part-0.parquet"
        path.parent.mkdir(parents=True)
        pq.write_table(table, path, row_group_size=500)
    yield 'kind = "parquet"\npath = "archive"', ""


@contextmanager
def sql(rows: list[Row], folder: Path) -> Iterator[tuple[str, str]]:
    """A table of a SQLite file beside the plant file, times in UTC."""
    engine = create_engine(f"sqlite:///{folder / 'history.db'}")
    with engine.begin() as connection:
        connection.execute(text("CREATE TABLE history (tag, time, value, quality)"))
        into = text("INSERT INTO history VALUES (:tag, :time, :value, :quality)")
        connection.execute(
            into,
            [
                {"tag": tag, "time": time.isoformat(sep=" ")[:19], "value": value, "quality": code}
                for tag, time, value, code in rows
            ],
        )
    engine.dispose()
    query = "SELECT time, value, quality FROM history "
    query += "WHERE tag = :tag AND time >= :start AND time < :end"
    yield (
        f'kind = "sql"\nurl = "sqlite:///history.db"\nzone = "UTC"\nquery = """{query}"""',
        "",
    )


@contextmanager
def opcua(rows: list[Row], folder: Path) -> Iterator[tuple[str, str]]:
    """Two nodes of a server on loopback."""
    pytest.importorskip("asyncua", reason="asyncua is missing: OPC UA IS NOT TESTED")
    from tests.connectors.opcua.loopback_server import serving

    nodes: dict[str, list[tuple[datetime, float | None, int]]] = {}
    for tag, time, value, quality in rows:
        nodes.setdefault(tag, []).append((time, value, 0 if quality == "Good" else 0x808C0000))
    with serving(nodes) as (url, _):
        yield f'kind = "opcua"\nurl = "{url}"', "ns=2;s="


@contextmanager
def pi(rows: list[Row], folder: Path) -> Iterator[tuple[str, str]]:
    """Two points of a PI Web API on loopback, which wants a password."""
    from tests.connectors.pi.loopback_server import ARCHIVE, Served, serving, system_state, value

    points: dict[str, list[dict[str, Any]]] = {}
    for tag, time, number, quality in rows:
        at = f"{time:%Y-%m-%dT%H:%M:%S}Z"
        good = number is not None
        points.setdefault(tag, []).append(value(at, number) if good else system_state(at, quality))
    (folder / "pi-password").write_text("open sesame\n")
    with serving(Served(points=points, user="reader:open sesame")) as served:
        sign_in = 'sign_in = "basic"\nuser = "reader"\nsecret_file = "pi-password"'
        yield f'kind = "pi"\nurl = "{served.url}"\nserver = "{ARCHIVE}"\n{sign_in}', ""


@contextmanager
def influx(rows: list[Row], folder: Path) -> Iterator[tuple[str, str]]:
    """Two tags of an InfluxDB on loopback, which wants a token."""
    from tests.connectors.influx.loopback_server import Served, serving

    points: dict[str, list[tuple[int, Any, str]]] = {}
    for tag, time, number, quality in rows:
        points.setdefault(tag, []).append((round(time.timestamp()) * 10**9, number, quality))
    (folder / "influx-token").write_text("open-sesame\n")
    with serving(Served(points=points, token="open-sesame")) as served:
        place = 'measurement = "opc"\ntag_key = "tag"\nquality_field = "quality"'
        signing = 'secret_file = "influx-token"'
        table = f'kind = "influx"\nurl = "{served.url}"\ndatabase = "plant"\n{place}\n{signing}'
        yield table, ""


Kind = Callable[[list[Row], Path], AbstractContextManager[tuple[str, str]]]


@pytest.mark.parametrize(
    "kinds", [(parquet, pi), pytest.param((sql, opcua, influx), marks=pytest.mark.long)]
)
def test_each_kind_is_screened_as_the_export_is(
    stemwatch: Callable[..., Any],
    one_valve: Path,
    rows: list[Row],
    tmp_path: Path,
    kinds: tuple[Kind, ...],
) -> None:
    """``screen --plant`` gives the same verdict, S and J, number for number."""

    def screened(name: str, source: str, prefix: str) -> dict[str, Any]:
        plant = tmp_path / "plant.toml"
        plant.write_text(PLANT.format(source=source, prefix=prefix), encoding="utf-8")
        out = tmp_path / f"out-{name}"
        db = f"sqlite:///{tmp_path / name}.db"
        outcome = stemwatch("screen", "--plant", plant, "--out", out, "--workers", 1, "--db", db)
        assert outcome.status == 0, outcome.said
        (valve,) = json.loads((out / "valves.json").read_text(encoding="utf-8"))
        return {key: valve[key] for key in COMPARED}

    expected = screened("csv", f"path = '{one_valve}'", "")
    assert expected["verdict"] == "sticky"
    for kind in kinds:
        with kind(rows, tmp_path) as (source, prefix):
            assert screened(kind.__name__, source, prefix) == expected


@pytest.fixture
def plant_file(rows: list[Row], tmp_path: Path) -> Path:
    """A plant whose source is a Parquet archive."""
    with parquet(rows, tmp_path) as (source, prefix):
        plant = tmp_path / "plant.toml"
        plant.write_text(PLANT.format(source=source, prefix=prefix), encoding="utf-8")
    return plant


def test_a_task_carries_the_address_not_the_samples(plant_file: Path) -> None:
    """What goes to a worker is small; the worker opens the archive itself."""
    (task,) = make_plan(Request(plant=load_plant(plant_file))).tasks
    assert len(pickle.dumps(task)) < 2_000
    assert task.archive is not None
    assert task.path == str(plant_file.parent / "archive")


def test_scheduled_runs_and_pages_read_it_too(plant_file: Path) -> None:
    """The scheduler's job and the pages' reader go to the archive."""
    plant = load_plant(plant_file)
    window = Window()
    assert not plant.is_live(VALVE)
    planned = make_plan(Request(plant=plant, valves=(VALVE,), window=window))
    (screening,) = screen_tasks(planned.tasks, plant.limits)
    assert screening.verdict.value == "sticky"
    with open_store(f"sqlite:///{plant_file.parent / 'store.db'}") as store:
        recording = recording_reader(plant, store)(VALVE, window)
    assert recording is not None
    assert recording.mv is not None


def test_pages_tell_a_source_that_cannot_be_read_from_an_empty_window(
    plant_file: Path, tmp_path: Path
) -> None:
    """Nothing there is what the archive says; a broken archive says nothing about the window."""
    plant = load_plant(plant_file)
    with open_store(f"sqlite:///{tmp_path / 'store.db'}") as store:
        read = recording_reader(plant, store)
        with pytest.raises(ConnectorError, match=r"no samples between 2031.*the archive covers"):
            read(VALVE, Window(start=datetime(2031, 1, 1, tzinfo=UTC)))
        for file in (plant_file.parent / "archive").rglob("*.parquet"):
            file.write_bytes(b"PAR1")
        with pytest.raises(ConnectorError, match=r"part-0\.parquet: "):
            recording_reader(plant, store)(VALVE, Window())


def test_pages_tell_files_that_cannot_be_read_from_an_empty_window(tmp_path: Path) -> None:
    """One file without the window is an answer; only broken ones are none."""
    plant = load_plant(text_plant(tmp_path))
    later = Window(start=datetime(2031, 1, 1, tzinfo=UTC))
    with open_store(f"sqlite:///{tmp_path / 'store.db'}") as store:
        read = recording_reader(plant, store)
        (tmp_path / "exports" / "b.csv").write_bytes(b"no export")
        assert read("A", later) is None
        (tmp_path / "exports" / "a.csv").write_bytes(b"no export either")
        with pytest.raises(ConnectorError, match=r"b\.csv"):
            read("A", later)


def text_plant(folder: Path) -> Path:
    """A plant with one valve in a folder of text exports, one of which is whole."""
    (folder / "exports").mkdir()
    rows = [f"2026-03-02T06:{n // 60:02}:{n % 60:02}Z,{n % 7},{n % 7}" for n in range(600)]
    text = "\n".join(["time,A.OP,A.MV", *rows])
    (folder / "exports" / "a.csv").write_text(text, encoding="utf-8")
    file = folder / "plant.toml"
    file.write_text(
        '[[sources]]\nname = "s"\npath = "exports/*.csv"\n[[valves]]\nid = "A"\nsource = "s"\n'
        '[valves.tags]\nop = { tag = "A.OP" }\nmv = { tag = "A.MV" }\n',
        encoding="utf-8",
    )
    return file


def test_a_window_without_samples_is_a_result_with_the_reason(plant_file: Path) -> None:
    """The valve is undetermined, and what the archive covers is said."""
    window = Window(start=datetime(2031, 1, 1, tzinfo=UTC))
    plant = load_plant(plant_file)
    planned = make_plan(Request(plant=plant, valves=(VALVE,), window=window))
    (screening,) = screen_tasks(planned.tasks, plant.limits)
    assert "no samples between 2031-01-01" in screening.reason
    assert "the archive covers 2026-03-02" in screening.reason


@pytest.mark.long
def test_an_archive_folder_on_the_command_line_is_screened(
    stemwatch: Callable[..., Any], plant_file: Path, tmp_path: Path
) -> None:
    """Without a plant file the tags are given, or told by their names."""
    out, archive = tmp_path / "out", plant_file.parent / "archive"
    tags = ("--op", f"{VALVE}.OP", "--mv", f"{VALVE}.ZT")
    for more in ((), (*tags, "--valve", VALVE), ("--plant", plant_file)):
        outcome = stemwatch("screen", archive, *more, "--out", out, "--workers", 1)
        assert outcome.status == 0, outcome.said
        assert f"sticky {VALVE}" in outcome.said


@pytest.mark.parametrize(
    ("source", "answer"),
    [
        ('kind = "parkett"\npath = "a"', "kind: found the text 'parkett'; expected one of"),
        ('kind = "parquet"', "path: found nothing; expected a Parquet file, a folder"),
        ('kind = "parquet"\npath = "a"\nquery = "x"', "query: found an unknown key"),
        ('kind = "sql"\nurl = "sqlite:///a"\nquery = "DELETE FROM x"', "begins with 'delete'"),
        ('kind = "sql"\nquery = "SELECT 1"', "url: found nothing; expected a database URL"),
        ('kind = "opcua"\nurl = "http://x"', "url: found 'http://x'; expected an address with"),
        (
            'kind = "opcua"\nurl = "opc.tcp://x"\nsecurity_policy = "Basic256Sha256"',
            "certificate: found nothing; expected a file, for Basic256Sha256",
        ),
        (
            'kind = "opcua"\nurl = "opc.tcp://x"\nuser = "reader"',
            "a user without one place for the password",
        ),
        (
            'kind = "opcua"\nurl = "opc.tcp://x"\nsecret_variable = "PASSWORD"',
            "user: found nothing beside a password; expected the name to log in with",
        ),
    ],
)
def test_mistakes_in_an_archive_are_told_with_their_line(
    tmp_path: Path, source: str, answer: str
) -> None:
    """The source costs itself and its valves, and says what was expected."""
    plant = tmp_path / "plant.toml"
    plant.write_text(PLANT.format(source=source, prefix=""), encoding="utf-8")
    problems = "\n".join(str(problem) for problem in load_plant(plant).problems)
    assert answer in problems
    assert "plant.toml, line" in problems
    assert "its valve is left out (FIC-104)" in problems


def test_a_plant_without_archives_keeps_its_digest(plant: Path) -> None:
    """Settings are the same ones as before archives could be described."""
    assert "archives" not in json.dumps(load_plant(plant)._archive_settings())
