"""From a device's table to its ``Link``, and back."""

from __future__ import annotations

from stemwatch.connectors.modbus.device import DEFAULT_PORT, Link, LinkKind
from stemwatch.connectors.modbus.faulty import Mistake
from stemwatch.connectors.modbus.tables import DeviceTable

_OF_TCP = ("host", "port")
_OF_SERIAL = ("serial_port", "baudrate", "bytesize", "parity", "stopbits")
_OF_BOTH = ("timeout_s", "retries", "pause_s", "latest_answer_s")


def link_of(table: DeviceTable) -> Link:
    """The link that ``table`` describes. Raises ``Mistake`` where keys of a serial port stand
    beside TCP or the other way round, or where the host or the port is not named."""
    serial = table.type is LinkKind.SERIAL
    foreign = _OF_TCP if serial else _OF_SERIAL
    for key in foreign:
        if getattr(table, key) is not None:
            found = f'{key} beside type = "{table.type.value}"'
            own = ", ".join(_OF_SERIAL if serial else _OF_TCP)
            raise Mistake(key, found, f"{own}, or another type")
    target = table.serial_port if serial else table.host
    if target is None:
        key, example = ("serial_port", "/dev/ttyUSB0") if serial else ("host", "192.168.1.20")
        raise Mistake(key, "nothing", f'where the device is, such as {key} = "{example}"')
    return Link(
        kind=table.type,
        target=target,
        port=table.port or DEFAULT_PORT,
        baudrate=table.baudrate or 19200,
        bytesize=table.bytesize or 8,
        parity=table.parity or "N",
        stopbits=table.stopbits or 1,
        timeout_s=table.timeout_s,
        retries=table.retries,
        pause_s=table.pause_s,
        latest_answer_s=table.latest_answer_s,
    )


def keys_of(link: Link) -> dict[str, str | int | float]:
    """What ``link_of`` makes ``link`` from: the plant file's keys with their values, defaults
    included, and none that another type of link has."""
    given: dict[str, str | int | float] = {"type": link.kind.value}
    if link.kind is LinkKind.SERIAL:
        given["serial_port"] = link.target
        given |= {key: getattr(link, key) for key in _OF_SERIAL[1:]}
    else:
        given |= {"host": link.target, "port": link.port}
    return given | {key: getattr(link, key) for key in _OF_BOTH}
