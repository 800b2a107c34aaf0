"""PI: what its Web API says, and what it does when it does not."""

from __future__ import annotations

import gzip
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import httpx
import pytest
from pydantic import ValidationError

from stemwatch.connectors.archive import http_reader
from stemwatch.connectors.connector import (
    ConnectorError,
    TagMapping,
    UnknownTag,
    ValveTags,
    Window,
)
from stemwatch.connectors.pi import PiArchive, web_api
from stemwatch.connectors.pi.connector import PiSettings
from stemwatch.models.recording import Quality, Role
from tests.connectors.pi.loopback_server import (
    ARCHIVE,
    Served,
    serving,
    system_state,
    value,
    web_id,
)

START = datetime(2026, 1, 5, 6, tzinfo=UTC)
VALVE = ValveTags(
    valve="FIC1",
    tags={Role.OP: TagMapping(tag="FIC1.OP", unit="%"), Role.MV: TagMapping(tag="FIC1.POS")},
)


def at(second: float) -> str:
    """A time as PI writes it, with seven decimals."""
    return (START + timedelta(seconds=second)).strftime("%Y-%m-%dT%H:%M:%S.%f") + "0Z"


@pytest.fixture
def served() -> Iterator[Served]:
    """600 values of 1 s of OP and position."""
    points = {
        tag: [value(at(i), float(i % 100)) for i in range(600)] for tag in ("FIC1.OP", "FIC1.POS")
    }
    with serving(Served(points=points, units={"FIC1.OP": "%"})) as item:
        yield item


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Waits between attempts are noted, not spent."""
    waits: list[float] = []
    monkeypatch.setattr("stemwatch.connectors.archive.http_reader.time.sleep", waits.append)
    return waits


def archive(served: Served, folder: Path = Path(), **table: Any) -> PiArchive:
    """The archive as a table in a plant file describes it."""
    given = {"name": "pi", "kind": "pi", "url": served.url, "server": ARCHIVE, **table}
    given.setdefault("sign_in", "anonymous")
    opened = PiSettings.model_validate(given).address(folder, None).open()
    assert isinstance(opened, PiArchive)
    return opened


def test_a_page_ends_where_the_server_says_and_nothing_is_lost_or_doubled(served: Served) -> None:
    """600 values in pages of 100, some at one instant."""
    for tag in served.points:
        served.points[tag][250:250] = [value(at(250), 49.0)] * 3
    recording = archive(served, page=100).read(VALVE)
    assert len(recording) == 600
    assert recording.op.values.tolist() == [float(i % 100) for i in range(600)]
    assert all("plot" not in path and "interpolated" not in path for path in served.asked)
    assert served.methods == {"GET"}


def test_a_server_that_gives_less_at_a_time_is_asked_for_less(served: Served) -> None:
    """Its refusal names maxCount."""
    served.most = 150
    assert len(archive(served, page=1000).read(VALVE)) == 600


def test_a_page_full_of_one_instant_is_an_error_and_no_endless_loop(served: Served) -> None:
    """More values at one instant than a page holds."""
    served.points["FIC1.OP"] = [value(at(0), 1.0)] * 500
    with pytest.raises(ConnectorError, match="larger page"):
        archive(served, page=100).read(VALVE)


def test_all_tags_of_a_valve_are_asked_for_in_one_request(served: Served) -> None:
    """One request for the values, one for each point."""
    archive(served).read(VALVE)
    assert [path.split("?")[0].rsplit("/", 1)[-1] for path in served.asked] == [
        "points",
        "points",
        "recorded",
    ]


def test_digital_states_and_marks_are_no_numbers(served: Served) -> None:
    """A system state by its name; questionable and substituted values; an error of one value."""
    op = served.points["FIC1.OP"]
    op[10] = system_state(at(10), "I/O Timeout")
    op[11] = value(at(11), 55.0, Questionable=True)
    op[12] = value(at(12), 55.0, Substituted=True)
    op[13] = value(at(13), {"Errors": ["cannot convert"]}, Good=False)
    op[14] = value(at(14), 55.0, Good=False)
    recording = archive(served).read(VALVE)
    assert recording.op.quality[9:16].tolist() == [
        Quality.GOOD,
        *[Quality.BAD] * 5,
        Quality.GOOD,
    ]
    assert any("I/O Timeout" in line for line in recording.provenance.decisions)
    accepted = archive(served, good_quality=["Questionable", "Substituted"]).read(VALVE)
    assert accepted.op.quality[11:13].tolist() == [Quality.GOOD, Quality.GOOD]


def test_a_mode_in_words_is_read_as_a_mode(served: Served) -> None:
    """A digital point whose states are AUTO and MAN."""
    served.points["FIC1.MODE"] = [
        value(at(i), {"Name": "MAN" if i < 100 else "AUTO", "Value": int(i >= 100)})
        for i in range(600)
    ]
    tags = {**VALVE.tags, Role.MODE: TagMapping(tag="FIC1.MODE")}
    recording = archive(served).read(ValveTags(valve="FIC1", tags=tags))
    mode = recording.signals[Role.MODE].values
    assert mode[50] != mode[200]


def test_values_that_change_seldom_are_read_from_before_the_window(served: Served) -> None:
    """PI keeps a value when it changes; ``before_s`` before a window is read too."""
    served.points["FIC1.POS"] = [value(at(i), float(i)) for i in range(0, 600, 60)]
    window = Window(start=START + timedelta(seconds=90), stop=START + timedelta(seconds=300))
    recording = archive(served).read(VALVE, window)
    assert (recording.start, recording.end) == (window.start, window.stop)
    assert "startTime=2026-01-05T05%3A01%3A30" in served.asked[-1]


def test_an_empty_answer_says_so(served: Served) -> None:
    """Items is empty where nothing was recorded."""
    with pytest.raises(ConnectorError, match="no samples between"):
        archive(served).read(VALVE, Window(start=START + timedelta(days=9)))


def test_an_error_inside_a_success_is_an_error(served: Served) -> None:
    """The answer is 200, and the stream in it has Errors."""
    served.errors_of["FIC1.POS"] = ["The PI Data Archive timed out."]
    with pytest.raises(ConnectorError, match="timed out"):
        archive(served).read(VALVE)


@pytest.mark.parametrize("status", [429, 502, 503, 504])
def test_a_busy_server_is_asked_again_and_not_at_once(
    served: Served, quick: list[float], status: int
) -> None:
    """Two refusals, then the answer; Retry-After is heeded."""
    busy = (status, {"Retry-After": "7"}, {"Errors": ["busy"]})
    served.faults = [busy, busy]
    assert len(archive(served).read(VALVE)) == 600
    assert quick[0] == 7.0
    assert quick[1] > quick[0]


def test_a_server_that_stays_busy_is_given_up(served: Served, quick: list[float]) -> None:
    """After four attempts, with what it said."""
    served.faults = [(503, {}, {"Errors": ["maintenance until noon"]})] * 9
    with pytest.raises(ConnectorError, match="503: maintenance until noon"):
        archive(served).read(VALVE)
    assert len(quick) == http_reader.ATTEMPTS - 1


def test_a_refused_sign_in_says_what_to_check_and_shows_no_secret(
    served: Served, tmp_path: Path
) -> None:
    """Wrong password, and the right one from a file."""
    served.user = "reader:right one"
    (tmp_path / "secret").write_text("wrong one\n")
    table = {"sign_in": "basic", "user": "reader", "secret_file": "secret"}
    with pytest.raises(ConnectorError, match="refuses this account") as refused:
        archive(served, tmp_path, **table).read(VALVE)
    assert "wrong one" not in str(refused.value)
    (tmp_path / "secret").write_text("right one\n")
    result = archive(served, tmp_path, **table)
    assert len(result.read(VALVE)) == 600
    assert "right one" not in repr(result.address)


def test_the_token_is_read_from_the_environment(
    served: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Bearer, and an error that names the variable where it is not set."""
    served.token = "let-me-read"
    table = {"sign_in": "bearer", "secret_variable": "PI_TOKEN"}
    with pytest.raises(ConnectorError, match="PI_TOKEN is not set"):
        archive(served, **table).read(VALVE)
    monkeypatch.setenv("PI_TOKEN", "let-me-read")
    assert len(archive(served, **table).read(VALVE)) == 600


def test_a_redirect_is_not_followed(served: Served) -> None:
    """It would carry the secret to another host."""
    served.faults = [(302, {"Location": "https://elsewhere/piwebapi"}, b"")]
    with pytest.raises(ConnectorError, match="another address"):
        archive(served).read(VALVE)
    assert len(served.asked) == 1


@pytest.mark.parametrize("body", [b"<html>login</html>", b"[]", b'"words"'])
def test_something_that_is_no_web_api_is_named(served: Served, body: bytes) -> None:
    """A login page or another service."""
    served.faults = [(200, {}, body)]
    with pytest.raises(ConnectorError, match="no JSON object"):
        archive(served).read(VALVE)


def test_an_unreachable_server_is_named(served: Served) -> None:
    """Its address stands in the error."""
    removed = archive(served)
    object.__setattr__(removed.address, "url", "http://127.0.0.1:9/piwebapi")
    with pytest.raises(ConnectorError, match=r"127\.0\.0\.1:9"):
        removed.read(VALVE)


def test_points_are_found_by_pattern_with_a_valve_proposed(served: Served) -> None:
    """Names decide where they leave no doubt; other points are not listed."""
    served.points |= {"FIC1.PV": [], "FIC1.SP": [], "TI-9": []}
    infos = {info.tag: info for info in archive(served, pattern="FIC*").tags()}
    assert set(infos) == {"FIC1.OP", "FIC1.POS", "FIC1.PV", "FIC1.SP"}
    assert infos["FIC1.OP"].proposed_role is Role.OP
    assert infos["FIC1.OP"].proposed_valve == "FIC1"


def test_many_points_come_page_by_page(served: Served) -> None:
    """A plant of 2,300 points."""
    served.points = {f"T{i:04}.PV": [] for i in range(2300)}
    assert len(archive(served).tags()) == 2300


def test_a_tag_may_be_a_web_id(served: Served) -> None:
    """For points that were renamed, or of another data archive."""
    tags = {role: TagMapping(tag=f"webid:{web_id(m.tag)}") for role, m in VALVE.tags.items()}
    assert len(archive(served).read(ValveTags(valve="FIC1", tags=tags))) == 600
    with pytest.raises(UnknownTag, match="webid:nothing"):
        archive(served).read(
            ValveTags(valve="FIC1", tags={Role.OP: TagMapping(tag="webid:nothing")})
        )


def test_a_wrong_data_archive_is_named(served: Served) -> None:
    """Its name stands in the error."""
    with pytest.raises(UnknownTag, match="data server OTHER"):
        archive(served, server="OTHER").tags()


@pytest.mark.parametrize(
    ("table", "result"),
    [
        ({"url": "https://user:secret@host/piwebapi"}, "without a password in it"),
        ({"url": "http://host/piwebapi", "sign_in": "basic", "user": "a"}, "one place"),
        (
            {
                "url": "http://host/piwebapi",
                "sign_in": "bearer",
                "secret_variable": "PI_TOKEN",
            },
            "https",
        ),
        ({"url": "https://host", "sign_in": "kerberos", "user": "a"}, "no user and secret"),
        (
            {"url": "https://host", "sign_in": "basic", "secret_variable": "P"},
            "a name, for sign_in",
        ),
    ],
)
def test_mistakes_in_the_table_say_what_is_expected(table: Any, result: str) -> None:
    """Before anything is asked."""
    given = {"name": "pi", "kind": "pi", "server": ARCHIVE, "sign_in": "anonymous", **table}
    with pytest.raises(ValidationError, match=result):
        PiSettings.model_validate(given)


def test_kerberos_without_its_package_says_which(served: Served) -> None:
    """The packages are not among the development tools."""
    with pytest.raises(ConnectorError, match="httpx-gssapi"):
        archive(served, sign_in="kerberos").read(VALVE)


def test_a_sites_own_authority_is_needed_and_enough(tmp_path: Path) -> None:
    """The file must hold certificates."""
    (tmp_path / "ca.pem").write_text("no certificate")
    table = {"url": "https://127.0.0.1:9/piwebapi", "server": ARCHIVE, "sign_in": "anonymous"}
    settings = PiSettings.model_validate(
        {"name": "pi", "kind": "pi", "authority": "ca.pem", **table}
    )
    with pytest.raises(ConnectorError, match="certificates in PEM form"):
        settings.address(tmp_path, None).open().read(VALVE)


def test_the_client_asks_without_writing() -> None:
    """No method but ``get`` of the client is used anywhere in the connector."""
    source = "".join(Path(m.__file__).read_text("utf-8") for m in (web_api, http_reader))
    writing = [f".{name}(" for name in ("post", "put", "patch", "delete", "request", "send")]
    assert [word for word in writing if f"_client{word}" in source] == []
    assert hasattr(httpx.Client, "get")


def test_a_page_that_comes_again_is_an_error_and_no_endless_loop(served: Served) -> None:
    """A cache between answers everything with the first page: values and points."""
    served.same_page = True
    with pytest.raises(ConnectorError, match="same page again"):
        archive(served, page=100).read(VALVE)
    served.points |= {f"TI{n}": [] for n in range(1500)}
    with pytest.raises(ConnectorError, match="same page again"):
        archive(served).tags()


@pytest.mark.parametrize(
    "body",
    [b"[" * 100_000, b'{"WebId": ' + b"9" * 5000 + b"}", b'{"a": "\xff"}'],
    ids=["nested without end", "a number of 5,000 digits", "no UTF-8"],
)
def test_an_answer_that_breaks_the_parser_is_named(served: Served, body: bytes) -> None:
    """It is no JSON object that a PI Web API sends."""
    served.faults = [(200, {}, body)]
    with pytest.raises(ConnectorError, match="no JSON object"):
        archive(served).read(VALVE)


@pytest.mark.parametrize("packed", [False, True])
def test_an_answer_without_end_does_not_fill_the_memory(
    served: Served, monkeypatch: pytest.MonkeyPatch, packed: bool
) -> None:
    """It is left where it is larger than what was asked for can be, unpacked."""
    monkeypatch.setattr(http_reader, "ANSWER_BYTES", 100_000)
    body = b" " * 3_000_000
    headers = {"Content-Encoding": "gzip"} if packed else {}
    served.faults = [(200, headers, gzip.compress(body) if packed else body)]
    with pytest.raises(ConnectorError, match="larger than 100 values for each tag"):
        archive(served, page=100).read(VALVE)


def test_numbers_too_large_for_any_signal_are_no_values(served: Served) -> None:
    """As an integer of hundreds of digits; the others stay."""
    served.points["FIC1.OP"][5] = value(at(5), 10**400)
    recording = archive(served).read(VALVE)
    assert recording.op.quality[5] != Quality.GOOD
    assert recording.op.usable.sum() == 599


def test_what_a_server_says_is_one_line_of_the_log(served: Served) -> None:
    """Line ends and control signs in it would forge others."""
    said = "out\r\nERROR forged \x1b[31mline" + "x" * 5000
    served.faults = [(500, {}, {"Errors": [said]})]
    with pytest.raises(ConnectorError) as failed:
        archive(served).read(VALVE)
    assert str(failed.value).isprintable()
    assert len(str(failed.value)) < 600


@pytest.mark.parametrize("token", ["geheim\nX-Other: 1", "geheim\x00", "gehéim", "geheim 2"])
def test_a_token_that_no_header_can_hold_is_not_shown(
    served: Served, monkeypatch: pytest.MonkeyPatch, token: str
) -> None:
    """The variable is named; a NUL cannot stand in one, but in a file."""
    monkeypatch.setattr("stemwatch.connectors.secret.Secret.reveal", lambda _: token)
    with pytest.raises(ConnectorError, match="the token that PI_TOKEN holds") as failed:
        archive(served, sign_in="bearer", secret_variable="PI_TOKEN").read(VALVE)
    assert "geh" not in str(failed.value)


def test_a_web_id_leads_nowhere_else(served: Served) -> None:
    """Whatever a tag holds, or the server gives as one: no other address is asked for."""
    for tag in ("webid:../../system/info", "webid:F1?x=1", "webid://elsewhere/x", "webid:"):
        with pytest.raises(UnknownTag, match="is no WebId"):
            archive(served).read(ValveTags(valve="V", tags={Role.OP: TagMapping(tag=tag)}))
    assert not served.asked
    served.faults = [(200, {}, {"WebId": "../../system"})]
    with pytest.raises(ConnectorError, match="where a WebId is expected"):
        archive(served).tags()
    assert len(served.asked) == 1


def test_an_answer_that_comes_late_is_not_taken_for_the_next(served: Served) -> None:
    """The first is given up and asked for again; the values are those that were asked for."""
    served.late_s = [0.0, 2.5]
    recording = archive(served, timeout_s=1.0).read(VALVE)
    assert recording.op.values.tolist() == [float(i % 100) for i in range(600)]
    assert len(served.asked) == 4
