"""``Connection``: one connection to a device. The only file that uses pymodbus.

It reads holding and input registers and nothing else: every outgoing frame is checked, and only
functions 3 and 4 are sent, whatever is called above it.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
from typing import TYPE_CHECKING, Any

from stemwatch.connectors.modbus.device import Link, LinkKind
from stemwatch.connectors.modbus.pending_requests import REFUSAL, PendingRequests, SentRequest
from stemwatch.connectors.modbus.read_fault import (
    FaultKind,
    ReadFault,
    invalid_answer,
    no_connection,
    not_asked,
    refused,
    silent,
)
from stemwatch.connectors.modbus.register_address import FUNCTION, Table

if TYPE_CHECKING:
    from pymodbus.client import AsyncModbusSerialClient, AsyncModbusTcpClient
    from pymodbus.pdu import ModbusPDU

    Client = AsyncModbusTcpClient | AsyncModbusSerialClient

READING = frozenset(FUNCTION.values())
_REFUSAL_BYTES = 5  # unit, function, code, checksum: an RTU answer without data
# After so many time-outs in a row: the other side may have lost the connection without closing it.
_SILENCES_BEFORE_CLOSING = 3
_LOST = "the connection was closed by the other side"


class OnlyReading(Exception):
    """Something tried to send a function other than 3 and 4; nothing was sent."""


def only_reading(frame: bytes, *, rtu: bool) -> bytes:
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


class Connection:
    """A connection that is opened, used for requests, and opened again after it was lost.

    Not for two callers at a time: Modbus allows one open request for each line.

    RTU frames have no number that ties an answer to its request. A request is therefore not sent
    while an answer that looks the same may still come, even after a reconnection: some serial
    servers pass a late answer on to whichever client is connected then.
    """

    def __init__(self, link: Link) -> None:
        self.link = link
        self._client: Client | None = None
        self._why = ""  # why the last attempt to connect failed
        self._heard = 0  # bytes received since the last request
        self._silences = 0  # time-outs in a row
        self._request: SentRequest | None = None  # the open one
        self._unanswered = PendingRequests(link.answers_until_s)
        self._closed_in_doubt = False

    @property
    def connected(self) -> bool:
        """Whether there is a connection, as far as is known without a request."""
        return self._client is not None and self._client.connected

    async def open(self) -> None:
        """Connect. Raises ``ReadFault`` with the reason where that fails."""
        if self._client is None:
            self._client = _new_client(self.link, self)
            _hook_into_pymodbus(self._client, self)
        self._why = f"no answer within {self.link.timeout_s:g} s"
        self._silences = 0
        self._closed_in_doubt = False
        if self.link.kind is LinkKind.TCP:
            self._unanswered.forget()
        if not await self._client.connect():
            raise no_connection(self._why)

    async def reopen(self) -> bool:
        """Connect again at once where the connection was closed because an answer may come late, so
        that the other units can be read. Returns whether there is a connection now."""
        if self._closed_in_doubt and not self.connected:
            with contextlib.suppress(ReadFault):
                await self.open()
        return self.connected

    def close(self) -> None:
        """Close the connection; ``open`` connects again."""
        if self._client is not None:
            self._client.close()

    def lengths_to_avoid(self, unit_id: int, table: Table) -> frozenset[int]:
        """The lengths in words that must not be requested of this unit and table now: late answers
        of these lengths may still come and could not be told apart."""
        return self._unanswered.counts(unit_id, table) if self.link.is_rtu else frozenset()

    async def read(self, unit_id: int, table: Table, first: int, count: int) -> list[int]:
        """``count`` words of ``table`` from protocol address ``first`` on.

        Repeats the request ``link.retries`` times where no answer or an invalid one came. Raises
        ``ReadFault`` with the reason where there are no words.
        """
        request = SentRequest(unit_id, table, first, count)
        # An answer to an earlier request for the same words is as good as one to this request.
        looks_alike = any(request.looks_alike(other) for other in self._unanswered)
        if looks_alike and self.link.is_rtu:
            raise not_asked(self.link.timeout_s)
        for attempt in range(self.link.retries + 1):
            try:
                words = await self._send(request, looks_alike)
            except ReadFault as fault:
                if fault.answer_may_come and self.link.kind is LinkKind.RTU_OVER_TCP:
                    self._close_with_fault(fault)
                    self._closed_in_doubt = True
                last = attempt == self.link.retries or not fault.answer_may_come
                if last or not await self.reopen():
                    self._close_if_unusable(fault)
                    raise
            else:
                return words
        raise AssertionError  # the loop above returns or raises

    async def _send(self, request: SentRequest, looks_alike: bool) -> list[int]:
        from pymodbus.exceptions import ConnectionException, ModbusException

        client = self._client
        if client is None or not client.connected:
            raise no_connection(self._why)
        holding = request.table is Table.HOLDING
        read_registers = client.read_holding_registers if holding else client.read_input_registers
        self._unanswered.note_sent(request)
        self._heard, self._request = 0, request
        try:
            reply = await read_registers(
                request.first, count=request.count, device_id=request.unit_id
            )
        except ConnectionException as error:
            raise no_connection(_LOST) from error
        except ModbusException as error:
            raise self._no_answer() from error
        finally:
            self._request = None
        if self.link.pause_s:
            await asyncio.sleep(self.link.pause_s)
        return self._words(reply, request, looks_alike)

    def _words(self, reply: ModbusPDU, request: SentRequest, looks_alike: bool) -> list[int]:
        """The words of ``reply``; ``looks_alike``: an earlier answer that looks so may still
        come."""
        self._silences = 0
        numbered = self.link.kind is LinkKind.TCP and reply.transaction_id != 0
        if reply.isError():
            open_ones = self._unanswered.counts(request.unit_id, request.table)
            if not numbered and len(open_ones) > 1:
                raise invalid_answer("a refusal that may be the answer to an earlier request")
            self._unanswered.note_answer(request)
            raise refused(reply.exception_code)
        if reply.function_code != FUNCTION[request.table]:
            raise invalid_answer("an answer to another function")
        if len(reply.registers) != request.count:
            raise invalid_answer("an answer of another length than asked for")
        if looks_alike and not numbered:
            raise invalid_answer("an answer without a number that may be to an earlier request")
        self._unanswered.note_answer(request)
        return list(reply.registers)

    def _no_answer(self) -> ReadFault:
        if self._heard:
            return invalid_answer("bytes that are no answer (another framing, speed or parity?)")
        self._silences += 1
        return silent(self.link.timeout_s)

    def _close_if_unusable(self, fault: ReadFault) -> None:
        """Close a TCP connection whose frame boundaries are lost or that has timed out several
        times.

        After an invalid answer the frame boundaries of a TCP stream are unknown. A serial line
        recovers with the next silence, and other units answer on it.
        """
        out_of_step = fault.kind is FaultKind.NONSENSE and self.link.kind is LinkKind.TCP
        deaf = self._silences >= _SILENCES_BEFORE_CLOSING and self.link.kind is LinkKind.TCP
        if out_of_step or deaf:
            self._close_with_fault(fault)

    def _close_with_fault(self, fault: ReadFault) -> None:
        self._why = fault.reason
        self.close()

    def take_late_answers(self, data: bytes) -> int:
        """How many bytes at the start of ``data`` are answers to earlier requests. These requests
        then count as answered, and what looks like them may be requested again."""
        late_bytes = 0
        while frame := self._first_frame(data[late_bytes:]):
            answered_request = self._unanswered.answered_by(frame)
            if answered_request is None or (
                self._request and answered_request.looks_alike(self._request)
            ):
                break
            self._unanswered.note_answer(answered_request)
            late_bytes += len(frame)
        return late_bytes

    def _first_frame(self, data: bytes) -> bytes:
        """The RTU answer at the start of ``data``; empty where there is no complete, valid one."""
        if len(data) < _REFUSAL_BYTES or data[1] & ~REFUSAL not in READING:
            return b""
        size = _REFUSAL_BYTES + (0 if data[1] & REFUSAL else data[2])
        frame = data[:size]
        sound = len(frame) == size and _checksum(frame[:-2]) == frame[-2:]
        return frame if sound else b""

    def pass_through(self, sending: bool, frame: bytes) -> bytes:
        """Called for every outgoing frame, which is checked, and for all incoming bytes."""
        if sending:
            return only_reading(frame, rtu=self.link.is_rtu)
        self._heard += len(frame)
        return frame

    def note_opening(self, error: OSError) -> None:
        """The opening failed with ``error``."""
        error_text = os.strerror(error.errno) if error.errno and error.errno > 0 else str(error)
        self._why = error_text or type(error).__name__

    def fail(self, error: Exception) -> None:
        """End the open request at once, rather than at its timeout."""
        if self._client is None or self._request is None:
            return
        if not self._client.ctx.response_future.done():
            self._client.ctx.response_future.set_exception(error)


def _checksum(frame: bytes) -> bytes:
    from pymodbus.framer import FramerRTU

    return FramerRTU.compute_CRC(frame).to_bytes(2, "big")


def _new_client(link: Link, line: Connection) -> Client:
    from pymodbus import FramerType
    from pymodbus.client import AsyncModbusSerialClient, AsyncModbusTcpClient
    from pymodbus.exceptions import ConnectionException

    # On every error pymodbus writes the last frames to standard error; faults are reported here.
    for name in ("pymodbus", "pymodbus_internal"):
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)

    def changed(connected: bool) -> None:
        if not connected:
            line.fail(ConnectionException(_LOST))

    # Repeats and reconnections are done above, with random waits and a reason for each.
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
    client.set_max_no_responses(2**31)  # when to close the connection is decided above
    return client


def _hook_into_pymodbus(client: Client, line: Connection) -> None:
    """Hook into pymodbus to learn why an opening failed, which answers came late, and which bytes
    were invalid; its interface does not tell."""
    from pymodbus.exceptions import ModbusException

    create, receive = client.ctx.call_create, client.ctx.callback_data

    async def opening() -> Any:
        try:
            return await create()
        except OSError as error:
            line.note_opening(error)
            raise

    def receiving(data: bytes, addr: tuple[Any, ...] | None = None) -> int:
        late = line.take_late_answers(data) if line.link.is_rtu else 0
        if late == len(data):
            return late
        try:
            return late + receive(data[late:], addr)
        except ModbusException as error:
            # Raised into the event loop it would only be logged there.
            line.fail(error)
            return len(data)

    client.ctx.call_create = opening
    vars(client.ctx)["callback_data"] = receiving
