"""The tables of ``stemwatch modbus read``."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from rich.table import Table as Grid

from stemwatch.connectors.modbus.commissioning import (
    Interpretation,
    TriedRegister,
    interpretations,
    other_orders,
)
from stemwatch.connectors.modbus.datatypes import ByteOrder, DataType, Number
from stemwatch.connectors.modbus.device import Device
from stemwatch.connectors.modbus.read_fault import FaultKind, ReadFault
from stemwatch.connectors.modbus.register_address import RegisterAddress
from stemwatch.models.words import counted
from stemwatch.service.cli.views import escape

_ADVICE = {
    FaultKind.NO_CONNECTION: ". Check host and port, and that no firewall stands between",
    FaultKind.SILENT: ". Check the unit id; on serial lines also speed, parity and wiring",
    FaultKind.NONSENSE: ". Check the framing (--rtu or not), speed and parity",
}
_ADVICE_FOR_CODE = {
    1: ". The device does not know this table: try holding instead of input, or the other way",
    2: ". The registers are not there: check the address (counted from 0 or from 1?) and --count",
    3: ". Fewer registers at once may be allowed: try a smaller --count",
    10: ". The gateway does not know this unit id",
    11: ". The gateway reaches no such unit: check the unit id and the line behind it",
}


def advice(fault: ReadFault) -> str:
    """What to look at after ``fault``, as the end of its sentence."""
    return _ADVICE_FOR_CODE.get(fault.code or 0, _ADVICE.get(fault.kind, ""))


def words_table(title: str, address: RegisterAddress, words: Sequence[int]) -> Grid:
    """Each word with its addresses, as hexadecimal, unsigned and signed number."""
    grid = Grid(title=escape(title), title_justify="left")
    for name in ("address", "Modicon", "word", "UINT16", "INT16"):
        grid.add_column(name, justify="right")
    for index, word in enumerate(words):
        register_address = RegisterAddress(address.table, address.offset + index)
        signed = word - 65_536 if word >= 32_768 else word
        grid.add_row(
            str(register_address), register_address.modicon, f"0x{word:04X}", str(word), str(signed)
        )
    return grid


def interpretations_table(address: RegisterAddress, words: Sequence[int]) -> Grid:
    """Types down, byte orders across, for the value that begins at ``address``; unlikely ones
    dim."""
    title = f"the value that begins at {address} ({address.modicon}), in every type and order"
    grid = Grid(title=title, title_justify="left")
    grid.add_column("type", no_wrap=True)
    for order in ByteOrder:
        grid.add_column(order.value, justify="right", no_wrap=True)
    by_kind: dict[DataType, dict[ByteOrder, Interpretation]] = {}
    for meaning in interpretations(words):
        by_kind.setdefault(meaning.kind, {})[meaning.order] = meaning
    for kind, row in by_kind.items():
        cells = [_cell(row[order]) if order in row else "" for order in ByteOrder]
        grid.add_row(kind.value, *cells)
    return grid


def map_table(device: Device, registers: Sequence[TriedRegister]) -> Grid:
    """The map of ``device`` as it was read: addresses, words, value, and why there is none."""
    caption = (
        f"{counted(len(registers), 'register')}, requests for each poll: {len(device.blocks())}"
    )
    title = f"{device.name} at {device.link}: {caption}"
    grid = Grid(title=escape(title), title_justify="left")
    for name in ("tag", "as written", "address", "Modicon", "unit id", "type", "words"):
        grid.add_column(name, no_wrap=name != "tag", overflow="fold")
    grid.add_column("value", justify="right", no_wrap=True)
    grid.add_column("remark")
    for answer in registers:
        register = answer.register
        kind = register.kind.value
        grid.add_row(
            escape(register.tag),
            escape(register.written),
            str(register.address),
            register.address.modicon,
            str(register.unit_id),
            f"{kind} {register.order.value}" if register.kind.words > 1 else kind,
            " ".join(f"{word:04X}" for word in answer.words),
            _value(answer),
            escape(answer.fault or (answer.reading.reason if answer.reading else "")),
        )
    return grid


def doubts(registers: Sequence[TriedRegister]) -> Iterator[str]:
    """One line for each register whose value looks likelier in another byte order."""
    for answer in registers:
        if others := other_orders(answer):
            readings = ", ".join(
                f"{meaning.order.value} {_number(meaning.value)}" for meaning in others
            )
            yield (
                f"[yellow]{escape(answer.register.tag)}[/]: {answer.register.order.value} gives no "
                f"likely value; raw in other orders: {readings}"
            )


def _cell(meaning: Interpretation) -> str:
    text = _number(meaning.value)
    return text if meaning.likely else f"[dim]{text}[/]"


def _number(value: Number) -> str:
    return f"{value:.7g}" if isinstance(value, float) else str(value)


def _value(register: TriedRegister) -> str:
    if register.reading is None or register.reading.reason:
        return "-"
    return escape(f"{register.reading.value:.6g} {register.register.unit}".strip())
