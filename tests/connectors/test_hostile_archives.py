"""Archives that die, fall silent, garble or vanish while they are read.

An error that names them, in time, or the true recording; never a part of it as if it were all, and
never another number.
"""

from __future__ import annotations

import gc
import random
import time
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest
from sqlalchemy import URL, make_url

from stemwatch.connectors.connector import Connector, ConnectorError, ValveTags
from stemwatch.connectors.historian import HistorianFile
from stemwatch.connectors.influx.connector import InfluxAddress
from stemwatch.connectors.opcua.connector import OpcUaAddress
from stemwatch.connectors.parquet import ParquetArchive
from stemwatch.connectors.pi.connector import PiAddress
from tests.connectors import example_archives as made
from tests.connectors.faulty_line import faulty_line
from tests.connectors.influx.loopback_server import Row as InfluxRow
from tests.connectors.influx.loopback_server import Served as InfluxServed
from tests.connectors.influx.loopback_server import serving as influx_serving
from tests.connectors.opcua.loopback_server import serving
from tests.connectors.opcua.test_opcua_archive import PREFIX
from tests.connectors.opcua.test_opcua_archive import history as opcua_history
from tests.connectors.pi.loopback_server import ARCHIVE as PI_ARCHIVE
from tests.connectors.pi.loopback_server import Served
from tests.connectors.pi.loopback_server import serving as pi_serving
from tests.connectors.pi.loopback_server import system_state as pi_state
from tests.connectors.pi.loopback_server import value as pi_value
from tests.connectors.sql.conftest import address, fill
from tests.service.store.conftest import _administer
from tests.service.store.conftest import postgres_server as postgres_server

FAULTS = [
    ("cut", 0),
    ("cut", 6_000),
    ("cut", 30_000),
    ("silent", 0),
    ("silent", 6_000),
    ("garbled", 6_000),
]
# An archive behind HTTP is asked four times, so that its silence takes long.
EACH_FAULT_OF_HTTP = pytest.mark.parametrize(
    ("fault", "most"),
    [one if one[0] != "silent" else pytest.param(*one, marks=pytest.mark.long) for one in FAULTS],
)


# What breaks amid a conversation the libraries leave to the collection of garbage, with a warning.
pytestmark = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")


@pytest.fixture(autouse=True)
def _collected() -> Iterator[None]:
    """Such warnings come in the test that they belong to; what was there before is not looked
    through again."""
    gc.freeze()
    yield
    gc.collect()


def failure(archive: Connector, valve: ValveTags) -> str:
    """The error of a reading that cannot succeed, which came in time."""
    started = time.monotonic()
    with pytest.raises(ConnectorError) as failed:
        archive.read(valve)
    assert time.monotonic() - started < 90.0, "it has two seconds for an answer"
    return str(failed.value)


@pytest.fixture
def history(postgres_server: str) -> Iterator[URL]:
    """A PostgreSQL database with a history."""
    url = make_url(postgres_server)
    if "host" not in url.query:
        pytest.skip("this server of PostgreSQL is not ours, and not reached by a socket file")
    name = f"history_{uuid.uuid4().hex[:12]}"
    _administer(postgres_server, f'CREATE DATABASE "{name}"')
    url = url.set(database=name)
    fill(url.render_as_string(hide_password=False))
    yield url
    _administer(postgres_server, f'DROP DATABASE "{name}" WITH (FORCE)')


@pytest.mark.postgres
@pytest.mark.parametrize(("fault", "most"), FAULTS)
def test_a_sql_historian_that_fails_amid_the_rows(history: URL, fault: str, most: int) -> None:
    """The database is named, and one that hangs is given up by ``timeout_s``."""
    with faulty_line(f"{history.query['host']}/.s.PGSQL.5432", fault, most) as line:
        through = history.set(host="127.0.0.1", port=line.port, query={})
        archive = address(through.render_as_string(hide_password=False), chunk=50, timeout_s=2.0)
        message = failure(archive.open(), made.valve())
    assert message.startswith("database historian: the database "), message
    assert fault != "silent" or not most or "has said nothing for 2 s" in message
    assert "geheim" not in message


@pytest.mark.parametrize(
    ("fault", "most"),
    # Each answer that does not come, the farewells among them, takes its two seconds.
    [
        fault if fault == ("cut", 6_000) else pytest.param(*fault, marks=pytest.mark.long)
        for fault in FAULTS
    ],
)
def test_an_opc_ua_server_that_fails_amid_its_history(fault: str, most: int) -> None:
    """The server is named, and each answer has ``timeout_s``."""
    with serving(opcua_history(), most=100) as (url, _):
        port, path = url.removeprefix("opc.tcp://127.0.0.1:").split("/")
        with faulty_line(int(port), fault, most) as line:
            at = f"opc.tcp://127.0.0.1:{line.port}/{path}"
            message = failure(
                OpcUaAddress(url=at, page=100, timeout_s=2.0).open(), made.valve(PREFIX)
            )
    assert message.startswith(f"{at}: the server could not be asked")


@pytest.fixture
def pi_port() -> Iterator[int]:
    """The port of a PI Web API with the recording."""
    points: dict[str, list[dict[str, Any]]] = {}
    for tag, time_, number, _ in made.narrow_rows():
        stamp = f"{time_:%Y-%m-%dT%H:%M:%S}Z"
        one = pi_state(stamp, "Bad Input") if number is None else pi_value(stamp, number)
        points.setdefault(tag, []).append(one)
    with pi_serving(Served(points=points)) as served:
        yield urlsplit(served.url).port or 0


def pi_address(port: int, timeout_s: float = 2.0) -> PiAddress:
    """The same server through a line."""
    url = f"http://127.0.0.1:{port}/piwebapi"
    return PiAddress(url=url, server=PI_ARCHIVE, timeout_s=timeout_s, page=100)


@EACH_FAULT_OF_HTTP
def test_a_pi_server_that_fails_amid_its_values(
    pi_port: int, fault: str, most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The server is named, and each of its four attempts has ``timeout_s``."""
    monkeypatch.setattr("stemwatch.connectors.archive.http_reader.FIRST_WAIT_S", 0.01)
    with faulty_line(pi_port, fault, most) as line:
        said = failure(pi_address(line.port).open(), made.valve())
    assert said.startswith(f"PI http://127.0.0.1:{line.port}/piwebapi: "), said


@pytest.fixture
def influx_port() -> Iterator[int]:
    """The port of an InfluxDB with the recording."""
    points: dict[str, list[InfluxRow]] = {}
    for tag, time_, number, _ in made.narrow_rows():
        if number is not None:
            points.setdefault(tag, []).append((int(time_.timestamp()) * 10**9, number, "Good"))
    with influx_serving(InfluxServed(points=points, layout="measurement")) as served:
        yield urlsplit(served.url).port or 0


def influx_address(port: int, timeout_s: float = 2.0) -> InfluxAddress:
    """The same server through a line."""
    url = f"http://127.0.0.1:{port}"
    return InfluxAddress(url=url, database="plant", timeout_s=timeout_s, page=100)


@EACH_FAULT_OF_HTTP
def test_an_influx_server_that_fails_amid_its_points(
    influx_port: int, fault: str, most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As PI."""
    monkeypatch.setattr("stemwatch.connectors.archive.http_reader.FIRST_WAIT_S", 0.01)
    with faulty_line(influx_port, fault, most) as line:
        said = failure(influx_address(line.port).open(), made.valve())
    assert said.startswith(f"InfluxDB http://127.0.0.1:{line.port}, plant: "), said


@pytest.mark.parametrize("most", [0, 6_000])
@pytest.mark.parametrize("kind", ["PI", "InfluxDB"])
def test_an_answer_that_comes_in_drops_is_given_up(
    pi_port: int, influx_port: int, kind: str, most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where it is the head that drips, which no time-out of a single read ends."""
    monkeypatch.setattr("stemwatch.connectors.archive.http_reader.LONGEST_ANSWER", 1)
    monkeypatch.setattr("stemwatch.connectors.archive.http_reader.ATTEMPTS", 1)
    with faulty_line(pi_port if kind == "PI" else influx_port, "drops", most) as line:
        archive = (pi_address if kind == "PI" else influx_address)(line.port).open()
        begun = time.monotonic()
        said = failure(archive, made.valve())
    assert "does not come to an end" in said
    assert time.monotonic() - begun < 30.0  # the head alone would take two minutes


@pytest.mark.long
def test_lines_without_a_fault_give_the_recording(
    history: URL, pi_port: int, influx_port: int, tmp_path: Path
) -> None:
    """What fails above is the fault and not the line."""
    true = HistorianFile(made.write_csv(tmp_path / "export.csv")).read(made.valve())
    with faulty_line(f"{history.query['host']}/.s.PGSQL.5432") as line:
        through = history.set(host="127.0.0.1", port=line.port, query={})
        at = through.render_as_string(hide_password=False)
        made.same(true, address(at, chunk=50, timeout_s=60.0).open().read(made.valve()))
    with serving(opcua_history(), most=100) as (url, _):
        port, path = url.removeprefix("opc.tcp://127.0.0.1:").split("/")
        with faulty_line(int(port)) as line:
            at = f"opc.tcp://127.0.0.1:{line.port}/{path}"
            made.same(true, OpcUaAddress(url=at, page=100).open().read(made.valve(PREFIX)))
    with faulty_line(pi_port) as line:
        made.same(true, pi_address(line.port, 60.0).open().read(made.valve()))
    with faulty_line(influx_port) as line:
        read = influx_address(line.port, 60.0).open().read(made.valve())
        assert np.array_equal(read.op.values[read.op.usable], true.op.values[true.op.usable])


@pytest.fixture
def checked(tmp_path: Path) -> Path:
    """A Parquet file whose pages have checksums, and whose numbers are not packed."""
    path = tmp_path / "archive" / "part-0.parquet"
    how = {"compression": "none", "use_dictionary": False, "write_page_checksum": True}
    return made.write(made.narrow_table(), path, **how)


def test_a_flipped_bit_in_parquet_is_no_other_number(checked: Path) -> None:
    """Anywhere in the file: an error that names it, or the true recording all the same."""
    content = checked.read_bytes()
    true = ParquetArchive(checked.parent).read(made.valve())
    draw = random.Random(5)
    errors = 0
    for _ in range(60):
        damaged = bytearray(content)
        damaged[draw.randrange(4, len(content))] ^= 1 << draw.randrange(8)
        checked.write_bytes(damaged)
        try:
            made.same(true, ParquetArchive(checked.parent).read(made.valve()))
        except ConnectorError:
            errors += 1
    assert errors >= 30


@pytest.mark.parametrize("part", [0.0, 0.3, 0.9, 0.999])
def test_a_parquet_file_that_is_cut_off_is_named(checked: Path, part: float) -> None:
    """A copy that stopped, a disk that was full."""
    content = checked.read_bytes()
    checked.write_bytes(content[: int(len(content) * part)])
    message = failure(ParquetArchive(checked.parent), made.valve())
    assert "part-0.parquet" in message


@pytest.mark.parametrize("how", ["removed", "cut off", "of another table"])
def test_a_parquet_file_that_changes_under_the_reader_is_named(checked: Path, how: str) -> None:
    """After its footer was read; the next reading takes the file as it is by then."""
    archive = ParquetArchive(checked.parent)
    archive.tags()
    content = checked.read_bytes()
    if how == "removed":
        checked.unlink()
    elif how == "cut off":
        checked.write_bytes(content[: len(content) // 2])
    else:
        checked.write_bytes(b"x" * len(content))
    assert "part-0.parquet" in failure(archive, made.valve())
    checked.write_bytes(content)
    assert len(ParquetArchive(checked.parent).read(made.valve())) == made.COUNT
