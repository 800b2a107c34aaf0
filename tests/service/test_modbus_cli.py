"""``stemwatch modbus read``: what someone at commissioning sees."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from stemwatch.connectors.connector import ConnectorError
from stemwatch.service.cli import views
from stemwatch.service.cli.modbus import modbus_app
from tests.connectors.modbus.loopback_servers import Behaviour, serving, sim_device

HOLDING = {0: 0x8000, 1: 0xC216, 9: 250}
MAP = """
[[devices]]
name = "plc-1"
host = "127.0.0.1"
port = {port}

[[devices.registers]]
tag = "PV"
address = "40001"
type = "FLOAT32"
byte_order = "CDAB"
unit = "t/h"

[[devices.registers]]
tag = "SWAPPED"
address = "40001"
type = "FLOAT32"
byte_order = "ABCD"

[[devices.registers]]
tag = "ZT"
register = "holding"
address = 9
type = "UINT16"
scale = 0.1
unit = "%"

[[devices.registers]]
tag = "GONE"
register = "holding"
address = 900
type = "UINT16"

[[devices.registers]]
tag = "WRONG"
address = 40003
type = "UINT16"
"""


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    """A device on loopback, served by another thread."""
    ready, stop = threading.Event(), threading.Event()
    ports: list[int] = []

    async def serve() -> None:
        async with serving(sim_device(1, Behaviour(holding=HOLDING))) as served:
            ports.append(served.port)
            ready.set()
            await asyncio.to_thread(stop.wait)

    thread = threading.Thread(target=asyncio.run, args=(serve(),))
    thread.start()
    assert ready.wait(20)
    yield ports[0]
    stop.set()
    thread.join()


@pytest.fixture
def modbus(capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch):
    """Runs ``stemwatch modbus ARGUMENTS``; gives the error it ended with, and what it printed."""

    def run(*arguments: object) -> tuple[BaseException | None, str]:
        for console in (views.out, views.err):
            monkeypatch.setattr(console, "_width", 200)
        result = CliRunner().invoke(modbus_app, [str(argument) for argument in arguments])
        text = " ".join((result.output + str(result.exception or "")).split())
        return result.exception, text

    return run


def test_words_are_shown_beside_every_interpretation(modbus, port: int) -> None:
    """Protocol and Modicon address, hexadecimal, signed and unsigned, and each type and order."""
    error, text = modbus("read", f"127.0.0.1:{port}", "--register", "40001", "--count", 2)
    assert error is None
    for shown in ("holding 0", "40001", "0x8000", "32768", "-32768", "0xC216", "-37.625"):
        assert shown in text
    for kind in ("INT16", "UINT32", "FLOAT32"):
        assert kind in text
    assert "FLOAT64" not in text


@pytest.mark.parametrize("written", ["holding:9", "40010", "HR10"])
def test_a_register_is_named_in_any_way(modbus, port: int, written: str) -> None:
    """Counted from 0 behind the table, or from 1."""
    _, text = modbus("read", f"127.0.0.1:{port}", "--register", written, "--count", 1)
    assert "0x00FA" in text
    assert "250" in text


def test_a_map_is_tried(modbus, port: int, tmp_path: Path) -> None:
    """Addresses as written and as the protocol has them, words, values, reasons, and doubts."""
    file = tmp_path / "plant.toml"
    file.write_text(MAP.format(port=port), "utf-8")
    error, text = modbus("read", "--map", file)
    assert error is None
    assert "4 registers, requests for each poll: 2" in text
    for shown in ("8000 C216", "-37.625 t/h", "00FA", "25 %", "holding 9", "40010"):
        assert shown in text
    assert "exception 2 (illegal data address)" in text
    assert "SWAPPED: ABCD gives no likely value; raw in other orders: CDAB -37.625" in text
    assert "registers[WRONG].address: found the number 40003, which has two readings" in text


@pytest.mark.parametrize(
    ("arguments", "answer"),
    [
        ((), "HOST"),
        (("h", "--map", "x.toml"), "not both"),
        (("--map", "nowhere.toml"), "there is no file"),
        (("127.0.0.1:x",), "is not a port"),
        (("h", "--register", "9"), "holding:0 or input:0 counts from 0"),
        (("h", "--register", "holding:²"), "holding:0 or input:0 counts from 0"),
        (("/dev/null", "--parity", "X"), "is not N, E or O"),
    ],
)
def test_wrong_usage_is_explained(modbus, arguments, answer: str) -> None:
    """What was given, and what would be right."""
    error, text = modbus("read", *arguments)
    assert isinstance(error, SystemExit)
    assert error.code == 2
    assert answer in text.replace("│ ", "")


@pytest.mark.parametrize(
    ("register", "answer"),
    [
        ("holding:5000", "check the address (counted from 0 or from 1?)"),
        ("input:395", "exception 2"),
    ],
)
def test_a_refusal_comes_with_what_to_check(modbus, port: int, register: str, answer: str) -> None:
    """The device's own words, and the usual cause."""
    arguments = ("--register", register, "--count", 10)
    error, text = modbus("read", f"127.0.0.1:{port}", *arguments)
    assert isinstance(error, ConnectorError)
    assert answer in text


def test_a_device_that_is_not_there_is_a_sentence(modbus) -> None:
    """Where, why, and what to check."""
    error, text = modbus("read", "127.0.0.1:1")
    assert isinstance(error, ConnectorError)
    assert "127.0.0.1:1, unit 1" in text
    assert "refused" in text.lower()
    assert "Check host and port" in text
