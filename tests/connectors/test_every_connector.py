"""The contract of ``Connector``, held against every installed one.

A new connector joins by an entry point and a function here that makes something to read and says
what its table in a plant file is.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from sqlalchemy import create_engine, text

from stemwatch.connectors.archive.settings import ArchiveSettings
from stemwatch.connectors.connector import (
    Connector,
    ConnectorError,
    TagMapping,
    UnknownTag,
    ValveTags,
    Window,
)
from stemwatch.connectors.historian.connector import HistorianFile, TextExportSettings
from stemwatch.connectors.registry import installed_connectors, settings_of
from stemwatch.models.recording import Quality, Role

Table = dict[str, Any]  # of [[sources]], without name and kind

START = datetime(2026, 1, 5, 6, tzinfo=UTC)
VALVE = ValveTags(
    valve="FIC1",
    tags={
        Role.OP: TagMapping(tag="FIC1.OP", unit="%"),
        Role.PV: TagMapping(tag="FIC1.PV", low=0.0, high=40.0),
    },
)


def csv(folder: Path) -> Table:
    """600 samples of 1 s from START: OP = i mod 100, PV = 20 t/h, sample 7 of OP bad, 9 absent."""
    rows = "".join(
        f"{(START + timedelta(seconds=i)).isoformat()},{'Bad' if i == 7 else i % 100},20\n"
        for i in range(600)
        if i != 9
    )
    path = folder / "export.csv"
    path.write_text("Time,FIC1.OP,FIC1.PV\n" + rows)
    return {"path": "export.csv"}


def samples() -> list[tuple[str, datetime, float | None, str]]:
    """(tag, time, value, quality) of the same 600 samples, for archives."""
    times = [(i, START + timedelta(seconds=i)) for i in range(600) if i != 9]
    op = [("FIC1.OP", t, None, "Bad") if i == 7 else ("FIC1.OP", t, float(i % 100), "Good")
          for i, t in times]  # fmt: skip
    return op + [("FIC1.PV", t, 20.0, "Good") for _, t in times]


def parquet(folder: Path) -> Table:
    """A folder with a file for each tag, a row for each sample."""
    for tag in ("FIC1.OP", "FIC1.PV"):
        _, times, values, quality = zip(*(s for s in samples() if s[0] == tag), strict=True)
        table = pa.table({"time": times, "value": values, "quality": quality})
        (folder / "archive" / f"tag={tag}").mkdir(parents=True)
        pq.write_table(table, folder / "archive" / f"tag={tag}" / "part-0.parquet")
    return {"path": "archive"}


def sql(folder: Path) -> Table:
    """A table of a SQLite file."""
    engine = create_engine(f"sqlite:///{folder / 'history.db'}")
    with engine.begin() as connection:
        connection.execute(text("CREATE TABLE history (tag, time, value, quality)"))
        into = text("INSERT INTO history VALUES (:tag, :time, :value, :quality)")
        rows = [
            {"tag": tag, "time": time.isoformat(sep=" ")[:19], "value": value, "quality": quality}
            for tag, time, value, quality in samples()
        ]
        connection.execute(into, rows)
    engine.dispose()
    return {
        "url": "sqlite:///history.db",
        "query": "SELECT time, value, quality FROM history "
        "WHERE tag = :tag AND time >= :start AND time < :end",
        "tags_query": "SELECT tag, COUNT(value) AS samples FROM history GROUP BY tag",
        "zone": "UTC",
    }


@pytest.fixture(scope="module")
def opcua_url() -> Iterator[str]:
    """The address of a server with the same samples."""
    pytest.importorskip("asyncua", reason="asyncua is missing: OPC UA IS NOT TESTED")
    from tests.connectors.opcua.loopback_server import serving

    nodes: dict[str, list[tuple[datetime, float | None, int]]] = {"FIC1.OP": [], "FIC1.PV": []}
    for tag, time, value, quality in samples():
        nodes[tag].append((time, value, 0 if quality == "Good" else 0x808C0000))
    with serving(nodes) as (url, _):
        yield url


@pytest.fixture(scope="module")
def opcua_table(opcua_url: str) -> Table:
    """Of that server."""
    return {"url": opcua_url}


@pytest.fixture(scope="module")
def pi_table() -> Iterator[Table]:
    """Of a PI Web API with the same samples."""
    from tests.connectors.pi.loopback_server import ARCHIVE, Served, serving, system_state, value

    points: dict[str, list[dict[str, Any]]] = {"FIC1.OP": [], "FIC1.PV": []}
    for tag, time, number, quality in samples():
        written = f"{time:%Y-%m-%dT%H:%M:%S}Z"
        good = value(written, number) if quality == "Good" else system_state(written, "Bad Input")
        points[tag].append(good)
    with serving(Served(points=points)) as served:
        yield {"url": served.url, "server": ARCHIVE, "sign_in": "anonymous"}


@pytest.fixture(scope="module")
def influx_table() -> Iterator[Table]:
    """Of an InfluxDB with the same samples."""
    from tests.connectors.influx.loopback_server import Served, serving

    points: dict[str, list[tuple[int, Any, str]]] = {"FIC1.OP": [], "FIC1.PV": []}
    for tag, time, number, quality in samples():
        points[tag].append((int(time.timestamp()) * 10**9, number, quality))
    with serving(Served(points=points)) as served:
        table = {"url": served.url, "database": "plant", "quality_field": "quality"}
        yield table | {"measurement": "opc", "tag_key": "tag"}


PREPARED = {"csv": csv, "parquet": parquet, "sql": sql}
SERVED = ("influx", "opcua", "pi")
UNCOUNTED = ("influx", "opcua", "pi")  # counting would mean reading everything
PREFIXES = {"opcua": "ns=2;s="}
INSTALLED = sorted(installed_connectors())


@pytest.fixture(params=INSTALLED)
def named(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[str, Connector]:
    """Each connector with its name, opened as its table in a plant file says."""
    kind = request.param
    if kind in SERVED:
        table: Table = request.getfixturevalue(f"{kind}_table")
    elif kind in PREPARED:
        table = PREPARED[kind](tmp_path)
    else:
        pytest.fail(f"connector {kind!r} has nothing to read here; add it to PREPARED")
    settings = settings_of(kind).model_validate({"name": "history", "kind": kind, **table})
    if isinstance(settings, ArchiveSettings):
        return kind, settings.address(tmp_path, None).open()
    assert isinstance(settings, TextExportSettings)
    return kind, HistorianFile(tmp_path / settings.path)


@pytest.fixture
def connector(named: tuple[str, Connector]) -> Connector:
    """The connector alone."""
    return named[1]


@pytest.fixture
def valve(named: tuple[str, Connector]) -> ValveTags:
    """The valve's tags as this connector spells them."""
    prefix = PREFIXES.get(named[0], "")
    tags = {role: replace(item, tag=prefix + item.tag) for role, item in VALVE.tags.items()}
    return replace(VALVE, tags=tags)


def test_it_has_the_methods_of_the_protocol(connector: Connector) -> None:
    """It has the protocol's methods."""
    assert isinstance(connector, Connector)


def test_tags_are_listed_with_samples(named: tuple[str, Connector]) -> None:
    """Every tag is listed, with the number of its samples where that is cheap to tell."""
    name, connector = named
    samples = {info.tag: info.samples for info in connector.tags()}
    prefix, counts = PREFIXES.get(name, ""), name not in UNCOUNTED
    assert samples == {f"{prefix}FIC1.OP": 598 * counts, f"{prefix}FIC1.PV": 599 * counts}


def test_recording_is_even_utc_and_masked(connector: Connector, valve: ValveTags) -> None:
    """One even clock in UTC; bad and absent samples are masked with their reason."""
    recording = connector.read(valve)
    assert (recording.start, recording.interval_s, len(recording)) == (START, 1.0, 600)
    assert recording.op.quality[[6, 7, 8, 9, 10]].tolist() == [
        Quality.GOOD,
        Quality.BAD,
        Quality.GOOD,
        Quality.MISSING,
        Quality.GOOD,
    ]
    assert recording.op.values[10] == 10.0


def test_ranges_become_percent(connector: Connector, valve: ValveTags) -> None:
    """With low and high the values are percent of span."""
    pv = connector.read(valve).signals[Role.PV]
    assert (pv.unit, pv.values[0]) == ("%", 50.0)


def test_no_sample_lies_outside_the_window(connector: Connector, valve: ValveTags) -> None:
    """Samples from start to before stop, and none else."""
    window = Window(start=START + timedelta(seconds=60), stop=START + timedelta(seconds=120))
    recording = connector.read(valve, window)
    assert (recording.start, recording.end) == (window.start, window.stop)
    assert recording.op.values[0] == 60.0


def test_empty_window_is_an_error(connector: Connector, valve: ValveTags) -> None:
    """A window without samples is a ConnectorError, not an empty recording."""
    with pytest.raises(ConnectorError):
        connector.read(valve, Window(start=START + timedelta(days=9)))


def test_an_unknown_tag_lists_the_nearest(connector: Connector, valve: ValveTags) -> None:
    """A tag that is not there is an UnknownTag that lists the nearest."""
    tag = valve.tags[Role.OP].tag + "P"
    wrong = ValveTags(valve="FIC1", tags={Role.OP: TagMapping(tag=tag)})
    with pytest.raises(UnknownTag, match=r"FIC1\.OP'"):
        connector.read(wrong)


def test_provenance_names_source_and_digest(connector: Connector, valve: ValveTags) -> None:
    """A recording knows where it came from."""
    provenance = connector.read(valve).provenance
    assert provenance.source
    assert provenance.digest
    assert provenance.decisions
