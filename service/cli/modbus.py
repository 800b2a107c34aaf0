"""``stemwatch modbus read``: read registers of a device, for commissioning."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from stemwatch.connectors.modbus.device import Device, Link

modbus_app = typer.Typer(
    name="modbus",
    no_args_is_help=True,
    rich_markup_mode="rich",
    help="Look at Modbus devices. Only ever reads.",
)
LINE = "Serial lines and RTU"


@modbus_app.callback()
def _modbus() -> None:
    """Look at Modbus devices. Only ever reads."""


@modbus_app.command()
def read(
    host: Annotated[
        str, typer.Argument(help="HOST, HOST:PORT, or a serial port such as /dev/ttyUSB0 or COM3.")
    ] = "",
    unit: Annotated[int, typer.Option(min=0, max=255, help="Unit id.")] = 1,
    register: Annotated[
        list[str] | None,
        typer.Option(help="holding:0 counts from 0; 40001 and HR1 count from 1. May be repeated."),
    ] = None,
    count: Annotated[int, typer.Option(min=1, max=125, help="How many registers.")] = 4,
    map_file: Annotated[
        Path | None, typer.Option("--map", help="plant.toml whose devices are tried.")
    ] = None,
    device: Annotated[str, typer.Option(help="Only this device of the map.")] = "",
    timeout_s: Annotated[
        float, typer.Option(min=0.02, max=60, help="Seconds to wait for an answer.")
    ] = 2.0,
    rtu: Annotated[
        bool, typer.Option("--rtu", help="RTU frames over TCP.", rich_help_panel=LINE)
    ] = False,
    baudrate: Annotated[int, typer.Option(min=300, help="Bits/s.", rich_help_panel=LINE)] = 19200,
    parity: Annotated[str, typer.Option(help="N, E or O.", rich_help_panel=LINE)] = "N",
    stopbits: Annotated[int, typer.Option(min=1, max=2, help="1 or 2.", rich_help_panel=LINE)] = 1,
) -> None:
    """Read registers once and show raw words beside each interpretation.

    With --map every register of plant.toml is read and shown with its addresses, its words and its
    value; a value that looks misread is shown in the other byte orders too. With HOST and
    --register the words are shown in every type and byte order. Nothing is ever written.
    """
    from stemwatch.service.cli import views

    if map_file is not None:
        if host:
            raise typer.BadParameter("give HOST or --map, not both: the map names its own hosts")
        _try_maps(map_file, device)
        views.say_next("where every value is right, `stemwatch serve --plant FILE` polls them.")
        return
    if not host:
        raise typer.BadParameter("give HOST, or --map plant.toml", param_hint="HOST")
    link = _link(host, timeout_s, rtu, baudrate, parity, stopbits)
    for written in register or ["holding:0"]:
        _show_words(link, unit, written, count)
    views.say_next(
        "write the type and byte order whose value is right into [[devices.registers]] of the "
        "plant file; `stemwatch modbus read --map plant.toml` then reads by it."
    )


def _link(
    host: str, timeout_s: float, rtu: bool, baudrate: int, parity: str, stopbits: int
) -> Link:
    from stemwatch.connectors.modbus.device import DEFAULT_PORT, Link, LinkKind

    if parity.upper() not in ("N", "E", "O"):
        raise typer.BadParameter(f"{parity!r} is not N, E or O", param_hint="--parity")
    if host.startswith("/") or host.upper().startswith("COM"):
        return Link(
            kind=LinkKind.SERIAL,
            target=host,
            baudrate=baudrate,
            parity=parity.upper(),
            stopbits=stopbits,
            timeout_s=timeout_s,
        )
    name, port = _split(host)
    kind = LinkKind.RTU_OVER_TCP if rtu else LinkKind.TCP
    return Link(kind=kind, target=name, port=port or DEFAULT_PORT, timeout_s=timeout_s)


def _split(host: str) -> tuple[str, int]:
    """Host and port (0 where left out) of ``host``, ``host:port``, ``[::1]:port`` or ``::1``."""
    if host.startswith("["):
        name, _, port_text = host[1:].partition("]")
        text = port_text.removeprefix(":")
    elif host.count(":") == 1:
        name, _, text = host.partition(":")
    else:
        name, text = host, ""
    if text and not (text.isascii() and text.isdigit() and 1 <= int(text) <= 65535):
        raise typer.BadParameter(f"{text!r} is not a port from 1 to 65535", param_hint="HOST")
    return name, int(text or 0)


def _show_words(link: Link, unit: int, written: str, count: int) -> None:
    from stemwatch.connectors.connector import ConnectorError
    from stemwatch.connectors.modbus.commissioning import read_raw_words
    from stemwatch.connectors.modbus.read_fault import ReadFault
    from stemwatch.connectors.modbus.register_address import AddressError, Table, parse_address
    from stemwatch.service.cli import modbus_views, views

    table, colon, number = written.partition(":")
    try:
        if colon and table.lower() in tuple(Table) and number.isdecimal():
            address = parse_address(hex(int(number)), Table(table.lower()))
        else:
            address = parse_address(written)
    except AddressError as error:
        hint = f"{error}; on the command line holding:0 or input:0 counts from 0"
        raise typer.BadParameter(hint, param_hint="--register") from error
    try:
        words = asyncio.run(read_raw_words(link, unit, address, count))
    except ReadFault as fault:
        request_text = f"{link}, unit {unit}, {address} to {address.offset + count - 1}"
        raise ConnectorError(
            f"{request_text}: {fault.reason}{modbus_views.advice(fault)}"
        ) from fault
    views.out.print(modbus_views.words_table(f"{link}, unit {unit}", address, words))
    views.out.print(modbus_views.interpretations_table(address, words))


def _try_maps(file: Path, name: str) -> None:
    from stemwatch.connectors.connector import ConnectorError
    from stemwatch.connectors.modbus.commissioning import try_map
    from stemwatch.connectors.modbus.read_fault import ReadFault
    from stemwatch.service.cli import modbus_views, views

    failed = []
    for device in _devices(file, name):
        try:
            registers = asyncio.run(try_map(device))
        except ReadFault as fault:
            failed.append(f"{device.name} at {device.link}: {fault.reason}")
            continue
        views.out.print(modbus_views.map_table(device, registers))
        for line in modbus_views.doubts(registers):
            views.out.print(line, highlight=False)
    if failed:
        raise ConnectorError("; ".join(failed))


def _devices(file: Path, name: str) -> list[Device]:
    """The devices of a plant file; what is wrong with the others is said on standard error."""
    from stemwatch.connectors.modbus.read_devices import read_devices
    from stemwatch.service.cli import options, views
    from stemwatch.service.config.toml import read_toml

    data, lines = read_toml(options.need_file(file, "--map"))
    tables = data.get("devices", [])
    tables = [table for table in tables if isinstance(table, dict)] if tables else []
    devices = read_devices(tables, lines.of, file.name, folder=file.absolute().parent)
    for problem in devices.problems:
        views.say_error(str(problem))
    chosen = [device for device in devices.devices if name in ("", device.name)]
    if not chosen:
        names = ", ".join(device.name for device in devices.devices) or "none that can be read"
        missing = f"no device {name!r}" if name else "no [[devices]] to try"
        raise typer.BadParameter(f"{missing} in {file.name}; it has {names}", param_hint="--map")
    return chosen
