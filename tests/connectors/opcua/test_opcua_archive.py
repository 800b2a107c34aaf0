"""The history of a real OPC UA server on loopback."""

from __future__ import annotations

import ast
import inspect
import pickle
import sys
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("asyncua", reason="asyncua is missing: OPC UA IS NOT TESTED")

from asyncua.client.client import Client
from asyncua.common.node import Node
from asyncua.ua.status_codes import StatusCodes

from stemwatch.connectors import opcua
from stemwatch.connectors.connector import (
    ConnectorError,
    TagMapping,
    UnknownTag,
    ValveTags,
    Window,
)
from stemwatch.connectors.historian import HistorianFile
from stemwatch.connectors.historian.tags.tag_names import parse_tag
from stemwatch.connectors.opcua import OpcUaAddress, Security
from stemwatch.connectors.opcua.connector import OpcUaSettings, is_bad
from stemwatch.connectors.opcua.session import FoundNode
from stemwatch.connectors.secret import Secret
from stemwatch.models.recording import Quality, Role
from tests.connectors import example_archives as made
from tests.connectors.opcua.loopback_server import Conforming, Sample, even, serving

PREFIX = "ns=2;s=FIC1."
BAD = int(StatusCodes.BadSensorFailure)
PACKAGE = Path(inspect.getfile(opcua)).parent


def history() -> dict[str, list[Sample]]:
    """The recording that the text export holds too, by node."""
    nodes: dict[str, list[Sample]] = {f"FIC1.{ending}": [] for ending in ("OP", "ZT", "PV")}
    for tag, time, value, quality in made.narrow_rows():
        nodes[tag].append((time, value, 0 if quality == "Good" else BAD))
    return nodes


@pytest.fixture(scope="module")
def served() -> Iterator[tuple[str, Conforming]]:
    """A server that gives at most 100 values at a time."""
    with serving(history(), most=100) as (url, store):
        yield url, store


@pytest.mark.parametrize("page", [97, 50_000])
def test_it_gives_what_the_text_export_gives(
    served: tuple[str, Conforming], tmp_path: Path, page: int
) -> None:
    """By continuation points where the server has more, and by asking again from the last time
    where it only cuts off."""
    url, store = served
    from_csv = HistorianFile(made.write_csv(tmp_path / "export.csv")).read(made.valve())
    before = store.pages
    recording = OpcUaAddress(url=url, page=page).open().read(made.valve(PREFIX))
    made.same(from_csv, recording)
    assert store.pages - before >= 3 * (made.COUNT // 100)


def test_only_samples_inside_the_window_are_returned(served: tuple[str, Conforming]) -> None:
    """From start to before stop; what was read before it for held values is not in it."""
    start = made.START + timedelta(seconds=60)
    window = Window(start=start, stop=start + timedelta(seconds=60))
    recording = OpcUaAddress(url=served[0]).open().read(made.valve(PREFIX), window)
    assert (recording.start, recording.end) == (window.start, window.stop)
    with pytest.raises(ConnectorError, match=r"no samples between .* Ask for another window"):
        OpcUaAddress(url=served[0]).open().read(
            made.valve(PREFIX), Window(start=made.START + timedelta(days=9))
        )


def test_a_status_that_is_not_good_is_bad_with_its_name(served: tuple[str, Conforming]) -> None:
    """The planner reads the server's own word for it."""
    recording = OpcUaAddress(url=served[0]).open().read(made.valve(PREFIX))
    assert recording.op.quality[made.BAD] == Quality.BAD
    assert any("BadSensorFailure" in decision for decision in recording.provenance.decisions)


@pytest.mark.parametrize("good", [[], ["UncertainLastUsableValue"]])
def test_a_status_that_the_plant_calls_good_is_good(good: list[str]) -> None:
    """``good_quality`` has the names of status codes; without it an uncertain value is bad."""
    codes = [0, int(StatusCodes.UncertainLastUsableValue)] * 20
    times = (made.START + timedelta(seconds=i) for i in range(40))
    rows = [(time, float(i), code) for i, (time, code) in enumerate(zip(times, codes, strict=True))]
    with serving({"FIC1.OP": rows}, most=100) as (url, _):
        table = {"name": "s", "kind": "opcua", "url": url, "good_quality": good}
        archive = OpcUaSettings.model_validate(table).address(Path(), None).open()
        op = archive.read(ValveTags(valve="V", tags={Role.OP: TagMapping(tag=f"{PREFIX}OP")})).op
    assert op.quality.tolist() == [Quality.GOOD, Quality.GOOD if good else Quality.BAD] * 20


def test_bad_uncertain_and_calculated_statuses_are_not_good() -> None:
    """Bad and uncertain are not, nor what the archive drew or calculated itself."""
    codes = {
        0x00000000: False,  # Good
        0x00000400: False,  # Good, raw
        0x00A20000: False,  # GoodEntryInserted
        0x00000402: True,  # interpolated
        0x00000401: True,  # calculated
        0x40000000: True,  # Uncertain
        0x40900000: True,  # UncertainLastUsableValue
        0x80000000: True,  # Bad
        BAD: True,
    }
    result = is_bad(np.array(list(codes), dtype=np.int64))
    assert result.tolist() == list(codes.values())


def test_tags_are_the_nodes_with_a_history(served: tuple[str, Conforming]) -> None:
    """Browsed below Objects; a variable without history is none."""
    infos = OpcUaAddress(url=served[0]).open().tags()
    assert {info.tag for info in infos} == {f"{PREFIX}{end}" for end in ("OP", "ZT", "PV")}


def test_roles_and_valves_are_proposed_from_the_names_of_nodes(
    served: tuple[str, Conforming],
) -> None:
    """The text of the node id tells loop and role, without the namespace before it."""
    infos = {info.tag: info for info in OpcUaAddress(url=served[0]).open().tags()}
    assert {tag: (info.proposed_role, info.proposed_valve) for tag, info in infos.items()} == {
        f"{PREFIX}OP": (Role.OP, "FIC1"),
        f"{PREFIX}ZT": (Role.MV, "FIC1"),
        f"{PREFIX}PV": (Role.PV, "FIC1"),
    }


def test_a_number_for_a_node_id_leaves_its_names_to_tell() -> None:
    """A variable OP below a block FIC-101 is the output of FIC-101."""
    node = FoundNode("ns=2;i=1042", "OP", "FIC-101")
    assert [parse_tag(name).loop for name in node.names()] == ["", "", "FIC-101"]
    named = FoundNode("ns=2;i=1043", "FIC-102.OP", "Unit 100")
    assert parse_tag(named.names()[1]).loop == "FIC-102"


def test_an_unknown_node_names_the_nearest(served: tuple[str, Conforming]) -> None:
    """An unknown node names the nearest; a text that is no node id says what one is."""
    archive = OpcUaAddress(url=served[0]).open()
    for tag, text in (("ns=2;s=FIC1.OPP", r"nearest are 'ns=2;s=FIC1\.OP'"),
                      ("FIC1.OP;;", "no node id|no node")):  # fmt: skip
        with pytest.raises(UnknownTag, match=text):
            archive.read(ValveTags(valve="A", tags={Role.OP: TagMapping(tag=tag)}))
    tags = dict(made.valve(PREFIX).tags) | {Role.SP: TagMapping(tag="ns=2;s=FIC1.SP")}
    valve = ValveTags(valve="FIC1", tags=tags)
    assert set(archive.present(valve).tags) == {Role.OP, Role.MV, Role.PV}


@pytest.mark.long
def test_several_values_at_one_time_across_a_page() -> None:
    """Asking again from the last time neither loses nor repeats what bears that time."""
    values = [float(i) for i in range(100)]
    samples = even(values, made.START, {})
    samples[10:12] = [(samples[9][0], 9.5, 0), (samples[9][0], 9.7, 0)]
    with serving({"A": samples}) as (url, _):
        item = OpcUaAddress(url=url, page=11).open()
        recording = item.read(ValveTags(valve="A", tags={Role.OP: TagMapping(tag="ns=2;s=A")}))
    assert recording.clock.repeated_times == 2
    assert np.isfinite(recording.op.values[12:]).all()


def test_an_unreachable_server_is_named_without_its_password(tmp_path: Path, monkeypatch) -> None:
    """The address is named and the password is not; nor is it in what travels to a worker."""
    monkeypatch.setenv("OPCUA_PASSWORD", "geheim")
    password = Secret(variable="OPCUA_PASSWORD")
    address = OpcUaAddress(
        url="opc.tcp://127.0.0.1:1/x",
        security=Security(user="reader", password=password),
        timeout_s=2.0,
    )
    assert b"geheim" not in pickle.dumps(address)
    with pytest.raises(
        ConnectorError, match=r"127\.0\.0\.1:1/x: the server could not be"
    ) as result:
        address.open().read(made.valve(PREFIX))
    assert "geheim" not in repr(address) + str(result.value)


def test_without_the_extra_it_says_what_to_install(monkeypatch) -> None:
    """The package is loaded only when a server is asked."""
    monkeypatch.setitem(sys.modules, "asyncua.client.client", None)
    with pytest.raises(ConnectorError, match=r"pip install 'stemwatch\[opcua\]'"):
        OpcUaAddress(url="opc.tcp://127.0.0.1:1/x").open().read(made.valve(PREFIX))


WRITING = {
    name
    for kind in (Client, Node)
    for name, _ in inspect.getmembers(kind)
    if name.startswith(("write", "set_", "add_", "delete", "call", "import", "register", "move"))
    or name in ("history_update", "create_subscription", "unregister_nodes", "load_enums")
} - {"set_security", "set_user", "set_password"}


def test_no_code_names_a_call_that_writes() -> None:
    """No attribute, name or text of the connector is a call of the library that changes
    anything."""
    assert {"write_value", "write_values", "call_method", "history_update"} <= WRITING
    result = []
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            names = {
                getattr(node, "attr", None),
                getattr(node, "id", None),
                node.value if isinstance(node, ast.Constant) else None,
            }
            result += [
                f"{path.name}: {name}"
                for name in names
                if isinstance(name, str) and name in WRITING
            ]
    assert result == []


def test_only_one_file_knows_the_library() -> None:
    """What could send anything stands in session.py."""
    knowing = {
        path.name
        for path in PACKAGE.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(node, ast.ImportFrom) and str(node.module).split(".")[0] == "asyncua"
    }
    assert knowing == {"session.py"}
