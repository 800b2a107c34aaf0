"""One connection: words when all is well, else a fault with its reason."""

from __future__ import annotations

import asyncio
import struct

import pytest
from pymodbus import FramerType
from pymodbus.constants import ExcCodes

from stemwatch.connectors.modbus.connection import Connection
from stemwatch.connectors.modbus.device import Link, LinkKind
from stemwatch.connectors.modbus.read_fault import FaultKind, ReadFault
from stemwatch.connectors.modbus.register_address import Table
from tests.connectors.modbus.loopback_servers import Behaviour, answering, serving, sim_device, tcp


async def fault_of(line: Connection, unit_id: int = 1, count: int = 2) -> ReadFault:
    """The fault of one read."""
    with pytest.raises(ReadFault) as caught:
        await line.read(unit_id, Table.HOLDING, 0, count)
    return caught.value


def one_fault(reply, **link) -> tuple[ReadFault, bool]:
    """The fault of one read from a server that answers so, and whether the line is still up."""

    async def run() -> tuple[ReadFault, bool]:
        async with answering(reply) as port:
            line = Connection(tcp(port, **link))
            await line.open()
            fault = await fault_of(line)
            connected = line.connected
            line.close()
            return fault, connected

    return asyncio.run(run())


def tcp_reply(request: bytes, body: bytes, **changed: int) -> bytes:
    """A TCP frame around ``body`` that answers ``request``."""
    number = changed.get("number", struct.unpack(">H", request[:2])[0])
    protocol, unit_id = changed.get("protocol", 0), changed.get("unit_id", request[6])
    return struct.pack(">HHHB", number, protocol, len(body) + 1, unit_id) + body


@pytest.mark.parametrize(
    ("framer", "kind"),
    [(FramerType.SOCKET, LinkKind.TCP), (FramerType.RTU, LinkKind.RTU_OVER_TCP)],
)
def test_words_arrive_from_both_tables(framer: FramerType, kind: LinkKind) -> None:
    """Holding and input registers of one address hold different words, of two units."""
    first = Behaviour(holding={5: 11, 6: 12}, inputs={5: 21, 6: 22})
    second = Behaviour(holding={5: 91})

    async def run() -> list[list[int]]:
        async with serving(sim_device(1, first), sim_device(9, second), framer=framer) as served:
            line = Connection(tcp(served.port, kind=kind))
            await line.open()
            requested = [(1, Table.HOLDING, 2), (1, Table.INPUT, 2), (9, Table.HOLDING, 1)]
            matching = [await line.read(unit, table, 5, count) for unit, table, count in requested]
            line.close()
            return matching

    assert asyncio.run(run()) == [[11, 12], [21, 22], [91]]


@pytest.mark.parametrize(
    ("code", "text"),
    [
        (ExcCodes.ILLEGAL_ADDRESS, "exception 2 (illegal data address)"),
        (ExcCodes.DEVICE_FAILURE, "exception 4 (device failure)"),
        (ExcCodes.DEVICE_BUSY, "exception 6 (device busy)"),
        (ExcCodes.GATEWAY_NO_RESPONSE, "exception 11 (gateway target does not answer)"),
    ],
)
def test_an_exception_reply_has_its_number_and_meaning(code: ExcCodes, text: str) -> None:
    """The connection is kept: the device is there and speaks."""

    async def run() -> tuple[ReadFault, bool]:
        async with serving(sim_device(1, Behaviour(exception=code))) as served:
            line = Connection(tcp(served.port))
            await line.open()
            fault = await fault_of(line)
            connected = line.connected
            line.close()
            return fault, connected

    fault, connected = asyncio.run(run())
    assert (fault.kind, fault.reason, connected) == (FaultKind.REFUSED, text, True)


def test_silence_is_told_from_a_refusal() -> None:
    """Nothing heard within the time."""
    fault, _ = one_fault(lambda request: b"", timeout_s=0.5)
    assert (fault.kind, fault.reason) == (FaultKind.SILENT, "no answer within 0.5 s")
    assert fault.unit_is_silent


def test_a_connection_that_is_cut_does_not_wait_for_the_timeout() -> None:
    """Two hundred seconds of patience, and the answer at once."""
    fault, connected = one_fault(lambda request: None, timeout_s=200.0)
    assert (fault.kind, connected) == (FaultKind.NO_CONNECTION, False)
    assert "closed by the other side" in fault.reason


@pytest.mark.parametrize(
    "body",
    [
        b"\x03\x02\x00\x01",  # one word where two were asked for
        b"\x03\x06\x00\x01\x00\x02\x00\x03",  # three words
        b"\x04\x04\x00\x01\x00\x02",  # the answer to another function
        b"\x03\x08\x00\x01\x00\x02",  # says more than it holds
        b"\x63\x01\x02",  # a function that does not exist
    ],
)
def test_an_answer_that_is_none_is_nonsense(body: bytes) -> None:
    """Wrong length or function; a TCP connection that is out of step is begun anew."""
    fault, connected = one_fault(lambda request: tcp_reply(request, body), timeout_s=0.5)
    assert (fault.kind, connected) == (FaultKind.NONSENSE, False)


@pytest.mark.parametrize("changed", [{"number": 999}, {"unit_id": 7}, {"protocol": 1}])
def test_an_answer_to_somebody_else_is_not_taken(changed: dict[str, int]) -> None:
    """Another number, unit or protocol: the words are not ours."""
    body = b"\x03\x04\x00\x01\x00\x02"
    fault, _ = one_fault(lambda request: tcp_reply(request, body, **changed), timeout_s=0.5)
    assert fault.kind is FaultKind.NONSENSE


def test_noise_from_a_serial_server_is_nonsense_and_the_connection_is_given_up() -> None:
    """A wrong checksum: nothing is taken from it, and the answer may still come."""
    reply = bytes([1, 3, 4, 0, 1, 0, 2, 0xBA, 0xD0])
    fault, connected = one_fault(lambda request: reply, kind=LinkKind.RTU_OVER_TCP, timeout_s=0.5)
    assert (fault.kind, connected) == (FaultKind.NONSENSE, False)


def test_a_request_is_repeated_as_often_as_the_map_says() -> None:
    """The third time succeeds with two repetitions, and with one it does not."""

    async def run(retries: int) -> object:
        count = 0

        def reply(request: bytes) -> bytes:
            nonlocal count
            count += 1
            return b"" if count < 3 else tcp_reply(request, b"\x03\x02\x00\x07")

        async with answering(reply) as port:
            line = Connection(tcp(port, timeout_s=0.5, retries=retries))
            await line.open()
            try:
                return await line.read(1, Table.HOLDING, 0, 1)
            except ReadFault as fault:
                return fault.kind
            finally:
                line.close()

    assert asyncio.run(run(2)) == [7]
    assert asyncio.run(run(1)) is FaultKind.SILENT


def test_a_late_answer_is_not_taken_for_the_next_one() -> None:
    """The words of the first request arrive during the second; the second gets its own."""

    async def run() -> tuple[FaultKind, list[int]]:
        waiting: list[bytes] = []

        def reply(request: bytes) -> bytes:
            (address,) = struct.unpack(">H", request[8:10])
            answer = tcp_reply(request, b"\x03\x02" + struct.pack(">H", address))
            if not waiting:
                waiting.append(answer)
                return b""
            return waiting[0] + answer

        async with answering(reply) as port:
            line = Connection(tcp(port, timeout_s=0.5))
            await line.open()
            first = await fault_of(line, count=1)
            second = await line.read(1, Table.HOLDING, 5, 1)
            line.close()
            return first.kind, second

    assert asyncio.run(run()) == (FaultKind.SILENT, [5])


def test_a_peer_that_no_longer_hears_is_called_again() -> None:
    """After three silences in a row the connection is given up, as a new one may work."""

    async def run() -> list[bool]:
        async with answering(lambda request: b"") as port:
            line = Connection(tcp(port, timeout_s=0.5))
            await line.open()
            matching = []
            for _ in range(3):
                await fault_of(line)
                matching.append(line.connected)
            return matching

    assert asyncio.run(run()) == [True, True, False]


@pytest.mark.parametrize(
    ("link", "text"),
    [
        (tcp(1), "refused"),
        (Link(kind=LinkKind.SERIAL, target="/nowhere/ttyUSB9"), "No such file"),
        (Link(kind=LinkKind.TCP, target="no.such.host.invalid", timeout_s=5.0), "no connection"),
    ],
)
def test_why_there_is_no_connection_is_said(link: Link, text: str) -> None:
    """Refused, no such port, no such name."""

    async def run() -> ReadFault:
        with pytest.raises(ReadFault) as caught:
            await Connection(link).open()
        return caught.value

    fault = asyncio.run(run())
    assert fault.kind is FaultKind.NO_CONNECTION
    assert text in fault.reason
