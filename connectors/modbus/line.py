"""``Line``: one connection to a device. The only file that knows pymodbus.

It can ask for holding and input registers and nothing else: what leaves passes a gate that lets
functions 3 and 4 through, whatever is called above it.
"""

from __future__ import annotations

import asyncio
import logging
import os
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from stemwatch.connectors.modbus.address import Table
from stemwatch.connectors.modbus.device import Link, LinkKind
from stemwatch.connectors.modbus.faults import (
    FaultKind,
    ReadFault,
    no_connection,
    nonsense,
    refused,
    silent,
)

if TYPE_CHECKING:
    from pymodbus.client import AsyncModbusSerialClient, AsyncModbusTcpClient
    from pymodbus.pdu import ModbusPDU

    Client = AsyncModbusTcpClient | AsyncModbusSerialClient

READING = frozenset({3, 4})
FUNCTION = {Table.HOLDING: 3, Table.INPUT: 4}
# A peer that lost our connection without saying so would otherwise be asked in vain for ever.
_SILENCES_BEFORE_CLOSING = 3
_LOST = "the connection was closed by the other side"


class OnlyReading(Exception):
    """Something tried to send a function other than 3 and 4; nothing was sent."""


def gate(frame: bytes, *, rtu: bool) -> bytes:
    """``frame`` as it is, if its function is 3 or 4. Raises ``OnlyReading`` for any other.

    The function stands behind the unit id: in byte 1 of an RTU frame, in byte 7 of a TCP frame.
    """
    function = frame[1] if rtu else frame[7]
    if function not in READING:
        raise OnlyReading(
            f"function {function} was not sent: stemwatch reads registers (functions 3 and 4) and "
            "never writes to a plant"
        )
    return frame


class Line:
    """A connection that is opened, asked, and opened again after it was lost.

    Not for two askers at a time: Modbus knows one open request for each line.
    """

    def __init__(self, link: Link) -> None:
        self.link = link
        self._client: Client | None = None
        self._why = ""  # the last opening failed
        self._asking = False
        self._heard = 0  # bytes since the last request
        self._silences = 0

    @property
    def connected(self) -> bool:
        """Whether there is a connection, as far as anyone can know without asking."""
        return self._client is not None and self._client.connected

    async def open(self) -> None:
        """Connect. Raises ``ReadFault`` with what stood in the way."""
        if self._client is None:
            self._client = _new_client(self.link, self)
            _listen_in(self._client, self._note_opening, self._fail)
        self._why = f"no answer within {self.link.timeout_s:g} s"
        self._silences = 0
        if not await self._client.connect():
            raise no_connection(self._why)

    def close(self) -> None:
        """Hang up; ``open`` connects again."""
        if self._client is not None:
            self._client.close()

    async def read(self, unit_id: int, table: Table, first: int, count: int) -> list[int]:
        """``count`` words of ``table`` from protocol address ``first`` on.

        Repeats the request ``link.retries`` times where nothing or nonsense was heard. Raises
        ``ReadFault`` with the reason where no words came.
        """
        for attempt in range(self.link.retries + 1):
            try:
                return await self._ask(unit_id, table, first, count)
            except ReadFault as fault:
                once_more = fault.kind in (FaultKind.SILENT, FaultKind.NONSENSE) and self.connected
                if not once_more or attempt == self.link.retries:
                    self._hang_up_after(fault)
                    raise
        raise AssertionError  # the loop above returns or raises

    async def _ask(self, unit_id: int, table: Table, first: int, count: int) -> list[int]:
        from pymodbus.exceptions import ConnectionException, ModbusException

        client = self._client
        if client is None or not client.connected:
            raise no_connection(self._why)
        ask = (
            client.read_holding_registers if table is Table.HOLDING else client.read_input_registers
        )
        self._heard, self._asking = 0, True
        try:
            reply = await ask(first, count=count, device_id=unit_id)
        except ConnectionException as error:
            raise no_connection(_LOST) from error
        except ModbusException as error:
            raise self._unanswered() from error
        finally:
            self._asking = False
        if self.link.pause_s:
            await asyncio.sleep(self.link.pause_s)
        return self._words(reply, table, count)

    def _words(self, reply: ModbusPDU, table: Table, count: int) -> list[int]:
        self._silences = 0
        if reply.isError():
            raise refused(reply.exception_code)
        if reply.function_code != FUNCTION[table]:
            raise nonsense("an answer to another function")
        if len(reply.registers) != count:
            raise nonsense("an answer of another length than asked for")
        return list(reply.registers)

    def _unanswered(self) -> ReadFault:
        if self._heard:
            return nonsense("bytes that are no answer (another framing, speed or parity?)")
        self._silences += 1
        return silent(self.link.timeout_s)

    def _hang_up_after(self, fault: ReadFault) -> None:
        """Begin anew where nothing more can be hoped for on this connection.

        A TCP stream in which something was misread has lost its beat. An RTU line finds it again at
        the next silence, and other units answer on it.
        """
        out_of_step = fault.kind is FaultKind.NONSENSE and self.link.kind is LinkKind.TCP
        deaf = self._silences >= _SILENCES_BEFORE_CLOSING and self.link.kind is not LinkKind.SERIAL
        if out_of_step or deaf:
            self._why = fault.reason
            self.close()

    def pass_through(self, sending: bool, frame: bytes) -> bytes:
        """Every frame on its way out and every byte on its way in comes through here."""
        if sending:
            return gate(frame, rtu=self.link.is_rtu)
        self._heard += len(frame)
        return frame

    def _note_opening(self, error: OSError) -> None:
        plain = os.strerror(error.errno) if error.errno and error.errno > 0 else str(error)
        self._why = plain or type(error).__name__

    def _fail(self, error: Exception) -> None:
        """End the open request at once, rather than at its timeout."""
        if self._client is None or not self._asking:
            return
        if not self._client.ctx.response_future.done():
            self._client.ctx.response_future.set_exception(error)


def _new_client(link: Link, line: Line) -> Client:
    from pymodbus import FramerType
    from pymodbus.client import AsyncModbusSerialClient, AsyncModbusTcpClient
    from pymodbus.exceptions import ConnectionException

    # On every error pymodbus writes the last frames to standard error; here faults are data.
    for name in ("pymodbus", "pymodbus_internal"):
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)

    def changed(connected: bool) -> None:
        if not connected:
            line._fail(ConnectionException(_LOST))

    # We repeat and reconnect ourselves: with chance in the waits, and with a reason for each.
    shared: dict[str, Any] = {
        "timeout": link.timeout_s,
        "retries": 0,
        "reconnect_delay": 0,
        "trace_packet": line.pass_through,
        "trace_connect": changed,
    }
    client: Client
    if link.kind is LinkKind.SERIAL:
        client = AsyncModbusSerialClient(
            link.target,
            framer=FramerType.RTU,
            baudrate=link.baudrate,
            bytesize=link.bytesize,
            parity=link.parity,
            stopbits=link.stopbits,
            **shared,
        )
    else:
        framer = FramerType.RTU if link.is_rtu else FramerType.SOCKET
        client = AsyncModbusTcpClient(link.target, port=link.port, framer=framer, **shared)
    client.set_max_no_responses(2**31)  # when to hang up is decided above
    return client


def _listen_in(
    client: Client, note: Callable[[OSError], None], fail: Callable[[Exception], None]
) -> None:
    """Learn why an opening failed, and that bytes made no sense, which pymodbus keeps to itself."""
    from pymodbus.exceptions import ModbusException

    create, receive = client.ctx.call_create, client.ctx.callback_data

    async def opening() -> Any:
        try:
            return await create()
        except OSError as error:
            note(error)
            raise

    def receiving(data: bytes, addr: tuple[Any, ...] | None = None) -> int:
        try:
            return receive(data, addr)
        except ModbusException as error:
            # Raised into the event loop it would be logged there and help nobody.
            fail(error)
            return len(data)

    client.ctx.call_create = opening
    vars(client.ctx)["callback_data"] = receiving
