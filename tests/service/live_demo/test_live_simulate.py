"""``stemwatch simulate --modbus``: a plant of one's own, read with the map that it wrote."""

from __future__ import annotations

import asyncio
import tomllib
from datetime import UTC, datetime
from pathlib import Path

import pytest
import typer

from stemwatch.connectors.modbus import read_devices
from stemwatch.connectors.modbus.commissioning import try_map
from stemwatch.models.studies.simulator import demo_plant
from stemwatch.service.cli.simulate import map_table, wear_of
from stemwatch.service.modbus_plant import Wear
from stemwatch.service.modbus_plant.register_layout import registers
from stemwatch.service.store.store import open_store
from tests.service.live_demo.running_demo import Started

pytestmark = pytest.mark.early


@pytest.mark.long
def test_it_serves_what_its_plant_file_says_until_ctrl_c(tmp_path: Path) -> None:
    """Every register of the map has a value; a valve is repaired once work on it is recorded."""
    database = f"sqlite:///{tmp_path / 'stemwatch.db'}"
    with open_store(database) as store:
        command = ["simulate", "--modbus", "--what", "healthy", "--count", "2", "--port", "0"]
        more = ["--speed", "10", "--wear", "none", "--repairs", database]
        started = Started(tmp_path / "plant", command=(*command, *more))
        try:
            port = int(started.said(r"^Modbus on 127\.0\.0\.1:(\d+), unit 1")[1])
            file = tmp_path / "plant" / "plant.toml"
            data = tomllib.loads(file.read_text("utf-8"))
            (device,) = read_devices(data["devices"]).devices
            assert (device.link.port, device.every_s) == (port, 0.1)
            read = asyncio.run(try_map(device))
            assert len(read) == 10
            assert all(item.reading and item.reading.value is not None for item in read), read
            valve = data["valves"][0]["id"]
            started.said(r"Valves that wear: none")
            store.record_maintenance(valve, datetime.now(UTC), "packing renewed", "Ann")
            started.said(f"^{valve} was repaired", 30)
            assert started.stop() == 0, started.everything()
            assert "Traceback" not in started.everything()
        finally:
            started.kill()


@pytest.mark.long
def test_in_the_background_of_a_script_it_ends_on_sigterm(tmp_path: Path) -> None:
    """There Ctrl-C is ignored, so that SIGTERM must not be handed on as that."""
    command = ("simulate", "--modbus", "--what", "healthy", "--count", "1", "--port", "0")
    started = Started(tmp_path / "plant", command=command, in_background=True)
    try:
        started.said(r"^Modbus on 127\.0\.0\.1:(\d+), unit 1")
        assert started.terminate() == 0, started.everything()
        assert "Traceback" not in started.everything()
    finally:
        started.kill()


def test_which_valves_wear_is_said_by_tag_S_and_J() -> None:
    """The first one where nothing is asked; S alone has no jump."""
    loops = demo_plant(1)[:3]
    usual = wear_of(loops, None, 600.0)
    assert usual == {loops[0].tag: Wear(S_percent=6.0, J_percent=2.4, over_s=600.0)}
    requested = wear_of(loops, [f"{loops[1].tag}=4", f"{loops[2].tag}=3.5/1.5"], 60.0)
    assert requested[loops[1].tag] == Wear(S_percent=4.0, over_s=60.0)
    assert requested[loops[2].tag] == Wear(S_percent=3.5, J_percent=1.5, over_s=60.0)
    assert wear_of(loops, ["none"], 60.0) == {}


@pytest.mark.parametrize(
    ("text", "answer"),
    [
        ("FIC-101", "expected TAG=S or TAG=S/J"),
        ("FIC-101=a lot", "expected TAG=S or TAG=S/J"),
        ("XV-1=6", "no loop XV-1 in this plant; it has FIC-101"),
        ("FIC-101=1/2", "0 <= J <= S"),
    ],
)
def test_wear_that_cannot_be_is_a_sentence(text: str, answer: str) -> None:
    """With what was found and what was expected."""
    with pytest.raises(typer.BadParameter, match=answer):
        wear_of(demo_plant(1)[:2], [text], 600.0)


def test_the_map_is_printed_for_people() -> None:
    """Address as the protocol counts and as manuals print it."""
    loops = demo_plant(1)[:2]
    table = map_table(loops)
    cells = [list(column.cells) for column in table.columns]
    assert cells[0] == [register.tag for register in registers(loops)]
    assert cells[1][0] == "0"
    assert cells[2][0] == "40001"
    assert table.row_count == 10
