"""InfluxDB: what it says at /query, in three layouts, and what is said when it does not."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from stemwatch.connectors.archive import http_reader
from stemwatch.connectors.connector import ConnectorError, TagMapping, ValveTags, Window
from stemwatch.connectors.influx import InfluxArchive
from stemwatch.connectors.influx.connector import InfluxSettings
from stemwatch.models.recording import Quality, Role
from tests.connectors.influx.loopback_server import Served, serving

START = datetime(2026, 1, 5, 6, tzinfo=UTC)
NS = int(START.timestamp()) * 10**9
VALVE = ValveTags(
    valve="FIC1",
    tags={Role.OP: TagMapping(tag="FIC1.OP", unit="%"), Role.MV: TagMapping(tag="FIC1.POS")},
)
LAYOUTS = {
    "tag_key": {"measurement": "opc", "tag_key": "tag"},
    "field": {"measurement": "opc"},
    "measurement": {},
}


@pytest.fixture
def served() -> Iterator[Served]:
    """600 points of 1 s of OP and position."""
    rows = [(NS + i * 10**9, float(i % 100), "Good") for i in range(600)]
    with serving(Served(points={"FIC1.OP": list(rows), "FIC1.POS": list(rows)})) as item:
        yield item


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Waits between attempts are noted, not spent."""
    waits: list[float] = []
    monkeypatch.setattr("stemwatch.connectors.archive.http_reader.time.sleep", waits.append)
    return waits


def archive(served: Served, folder: Path = Path(), **changes: Any) -> InfluxArchive:
    """The archive of a table of a plant file."""
    table = {"name": "influx", "kind": "influx", "url": served.url, "database": "plant"}
    settings = InfluxSettings.model_validate(table | LAYOUTS[served.layout] | changes)
    opened = settings.address(folder, None).open()
    assert isinstance(opened, InfluxArchive)
    return opened


@pytest.mark.parametrize("layout", LAYOUTS)
def test_three_layouts_give_the_same_recording(served: Served, layout: str) -> None:
    """The tag's name may be an Influx tag, a field or a measurement."""
    served.layout = layout
    recording = archive(served).read(VALVE)
    assert (recording.start, recording.interval_s, len(recording)) == (START, 1.0, 600)
    assert recording.mv.values[250] == 50.0
    assert {info.tag for info in archive(served).tags()} == {"FIC1.OP", "FIC1.POS"}
    assert served.methods == {"GET"}


def test_a_page_ends_in_the_middle_of_an_instant_and_nothing_is_lost(served: Served) -> None:
    """Points at one instant are told apart by how many of them were read."""
    served.points["FIC1.OP"][99:99] = [(NS + 99 * 10**9, 7.0, "Good")] * 3
    recording = archive(served, page=100).read(VALVE)
    assert len(recording) == 600
    assert recording.op.values[99] == 99.0  # the last one counts
    window = Window(start=START + timedelta(seconds=60), stop=START + timedelta(seconds=120))
    assert len(archive(served, page=100).read(VALVE, window)) == 60


def test_a_page_that_does_not_lead_on_is_an_error_and_no_endless_loop(served: Served) -> None:
    """A cache that repeats the first page; more points at one instant than a page holds."""
    served.same_page = True
    with pytest.raises(ConnectorError, match="expected it to heed time and OFFSET"):
        archive(served, page=100).read(VALVE)
    served.same_page = False
    served.points["FIC1.OP"] = [(NS, 1.0, "Good")] * 300
    with pytest.raises(ConnectorError, match="more than 100 points of a tag stand at one instant"):
        archive(served, page=100).read(VALVE)


def test_quality_codes_are_read_where_a_field_has_them(served: Served) -> None:
    """A bad one is bad; a value that is no number is missing."""
    served.points["FIC1.OP"][5] = (NS + 5 * 10**9, 40.0, "Bad")
    served.points["FIC1.OP"][6] = (NS + 6 * 10**9, "Shutdown", "Good")
    served.points["FIC1.OP"][8] = (NS + 8 * 10**9, None, "Good")
    op = archive(served, quality_field="quality").read(VALVE).op
    assert [Quality(q) for q in op.quality[4:10]] == [
        Quality.GOOD,
        Quality.BAD,
        Quality.MISSING,
        Quality.GOOD,
        Quality.MISSING,
        Quality.GOOD,
    ]


def test_a_tag_cannot_become_a_query(served: Served) -> None:
    """Quotation marks stay inside the name."""
    tag = 'x\' OR time > 0; DROP MEASUREMENT "opc" --'
    valve = ValveTags(valve="FIC1", tags={Role.OP: TagMapping(tag=tag)})
    with pytest.raises(ConnectorError):
        archive(served).read(valve)
    asked = served.asked[0]["q"]
    assert "= 'x\\' OR time > 0; DROP MEASUREMENT \"opc\" --' ORDER BY" in asked


def test_the_token_is_sent_and_shown_nowhere(
    served: Served, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From a file or a variable; a refused one says what to check."""
    served.token = "open-sesame"
    (tmp_path / "token").write_text("open-sesame\n")
    assert len(archive(served, tmp_path, secret_file="token").read(VALVE)) == 600
    monkeypatch.setenv("INFLUX_TOKEN", "wrong-word")
    with pytest.raises(ConnectorError, match="may read this database") as refused:
        archive(served, secret_variable="INFLUX_TOKEN").read(VALVE)
    assert "wrong-word" not in str(refused.value)


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ((200, {"results": [{"error": "no such shard"}]}), "no such shard"),
        ((200, b"<html>login</html>"), "none of an InfluxDB"),
        ((200, {"results": [7]}), "none of an InfluxDB"),
        ((400, {"error": "database name required"}), "400: database name required"),
        ((302, {}), "answered 302"),
        (
            (200, {"results": [{"series": [{"columns": ["time", "v"], "values": [["x", 1]]}]}]}),
            "found the time 'x'",
        ),
    ],
)
def test_errors_are_reported_even_inside_a_success(
    served: Served, fault: tuple[int, Any], message: str
) -> None:
    """Also an error inside a success."""
    served.faults = [fault]
    with pytest.raises(ConnectorError, match=message):
        archive(served).read(VALVE)


def test_a_busy_server_is_asked_again(served: Served, quick: list[float]) -> None:
    """Twice busy, then there."""
    served.faults = [(503, {}), (429, {})]
    assert len(archive(served).read(VALVE)) == 600
    assert quick == [0.5, 1.0]


def test_an_unreachable_server_is_named_after_the_last_attempt() -> None:
    """After the last attempt, with the address."""
    with pytest.raises(ConnectorError, match=r"127\.0\.0\.1:9"):
        archive(Served(points={}, url="http://127.0.0.1:9")).read(VALVE)


@pytest.mark.parametrize(
    ("table", "expected"),
    [
        ({"tag_key": "tag"}, "measurement as well"),
        ({"url": "influx"}, "address of an InfluxDB"),
        ({"url": "http://plant:8086", "secret_file": "t"}, "https://"),
        ({"secret_variable": "T", "secret_file": "t"}, "secret_variable or secret_file"),
    ],
)
def test_mistakes_in_the_table_say_what_is_expected(table: dict[str, str], expected: str) -> None:
    """Each by its key."""
    whole = {"name": "i", "kind": "influx", "url": "https://host:8086", "database": "plant"}
    with pytest.raises(ValidationError, match=expected):
        InfluxSettings.model_validate(whole | table)


SERIES = {"columns": ["time", "v"], "values": [[NS, 1.0]]}
NO_TABLES = [
    b"[" * 100_000,
    b'{"results": ' + b"9" * 5000 + b"}",
    b'{"a": "\xff"}',
    {"results": [{"series": None}]},
    {"results": [{"series": ["opc"]}]},
    {"results": [{"series": [{"values": [[NS, 1.0]]}]}]},
    {"results": [{"series": [{**SERIES, "columns": "tv"}]}]},
    {"results": [{"series": [{**SERIES, "columns": [["time"], "v"]}]}]},
    {"results": [{"series": [{**SERIES, "values": [5]}]}]},
    {"results": [{"series": [{**SERIES, "values": [[10**30, 1.0]]}]}]},
    {"results": [{"series": [{**SERIES, "values": [[True, 1.0]]}]}]},
]


@pytest.mark.parametrize("body", NO_TABLES, ids=range(len(NO_TABLES)))
def test_an_answer_of_another_shape_is_named(served: Served, body: Any) -> None:
    """Whatever it is: the server, and that it is no answer of an InfluxDB."""
    served.faults = [(200, body)]
    with pytest.raises(ConnectorError, match=r"InfluxDB http://\S+, plant: (the answer|found)"):
        archive(served).read(VALVE)


def test_an_answer_without_end_does_not_fill_the_memory(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is left where it is larger than what was asked for can be."""
    monkeypatch.setattr(http_reader, "ANSWER_BYTES", 100_000)
    served.faults = [(200, b" " * 3_000_000)]
    with pytest.raises(ConnectorError, match="larger than 100 values"):
        archive(served, page=100).read(VALVE)


def test_points_from_after_the_window_are_refused(served: Served) -> None:
    """A server that does not heed the end would be read for ever."""
    window = Window(start=START, stop=START + timedelta(seconds=100))
    rows = [[NS + i * 10**9, 1.0] for i in range(200)]
    served.faults = [(200, {"results": [{"series": [{**SERIES, "values": rows}]}]})]
    with pytest.raises(ConnectorError, match="from outside"):
        archive(served).read(VALVE, window)


def test_what_a_server_says_is_one_line_of_the_log(served: Served) -> None:
    """Line ends and control signs in it would forge others."""
    served.faults = [(400, {"error": "out\r\nERROR forged \x1b[31mline" + "x" * 5000})]
    with pytest.raises(ConnectorError) as failed:
        archive(served).read(VALVE)
    assert str(failed.value).isprintable()
    assert len(str(failed.value)) < 600


def test_a_redirect_is_not_followed(served: Served, monkeypatch: pytest.MonkeyPatch) -> None:
    """It would carry the token to whoever it names."""
    monkeypatch.setenv("INFLUX_TOKEN", "geheim")
    moved: Any = (307, {}, {"Location": f"{served.url}/elsewhere"})
    served.faults = [moved]
    with pytest.raises(ConnectorError, match="answered 307") as failed:
        archive(served, secret_variable="INFLUX_TOKEN").read(VALVE)
    assert len(served.asked) == 1
    assert "geheim" not in str(failed.value)
