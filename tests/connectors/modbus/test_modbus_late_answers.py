"""Answers that come after their time-out: RTU frames bear no number that ties them to a request.

Every word of the simulated units names its register and the poll in which it was asked for, so
that a sample of another register, or of another poll, is seen for what it is.
"""

from __future__ import annotations

import asyncio
import os
import random
import tty
from collections import Counter
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import replace
from typing import Any, cast

import pytest
from pymodbus.framer import FramerRTU

from stemwatch.connectors.modbus.connection import Connection
from stemwatch.connectors.modbus.device import Device, Link, LinkKind
from stemwatch.connectors.modbus.poller import DevicePoller
from stemwatch.connectors.modbus.read_fault import FaultKind, ReadFault
from stemwatch.connectors.modbus.register_address import Table
from stemwatch.connectors.modbus.sample_batch import SampleBatch
from tests.connectors.modbus.loopback_servers import answering, device, register, tcp

POLLS_TOLD_APART = 64
# Three blocks of one unit, alike in length and too far apart to be asked for together.
BLOCKS = tuple(range(first, first + 4) for first in (0, 100, 200))
# Half of what was met in plants: a time-out of 1 s, answers after 0.05 s or after 1.05 to 4 s.
TIMEOUT_S, EVERY_S, PROMPT_S, LATE_S = 0.5, 0.5, 0.025, (0.525, 2.0)


def word(address: int, poll: int) -> int:
    """What register ``address`` holds during ``poll``."""
    return address * POLLS_TOLD_APART + poll % POLLS_TOLD_APART


def rtu(unit_id: int, pdu: bytes) -> bytes:
    """``pdu`` as an RTU frame."""
    frame = bytes([unit_id]) + pdu
    return frame + FramerRTU.compute_CRC(frame).to_bytes(2, "big")


class Units:
    """Units on one line that answer each request after the seconds that ``delay_s`` draws.

    The words are those of the moment of the request. What is sent goes to ``send``.
    """

    def __init__(self, delay_s: Callable[[], float]) -> None:
        self.poll = 0
        self.asked = self.connections = 0
        self.send: Callable[[bytes], object] = lambda data: None
        self._delay_s = delay_s

    def receive(self, request: bytes) -> None:
        """Answer ``request``, now or later."""
        self.asked += 1
        unit_id, function = request[:2]
        first, count = (int.from_bytes(request[at : at + 2], "big") for at in (2, 4))
        words = [word(address, self.poll) for address in range(first, first + count)]
        data = b"".join(each.to_bytes(2, "big") for each in words)
        answer = rtu(unit_id, bytes([function, len(data)]) + data)
        asyncio.get_running_loop().call_later(self._delay_s(), lambda: self.send(answer))


def mostly_prompt(rng: random.Random) -> Callable[[], float]:
    """Four answers of five are prompt, the fifth comes after the time-out."""
    return lambda: PROMPT_S if rng.random() < 0.8 else rng.uniform(*LATE_S)


@asynccontextmanager
async def behind_tcp(units: Units, *, one_wire: bool = False) -> AsyncIterator[Link]:
    """``units`` behind a serial server. With ``one_wire`` what arrives late on the serial side is
    handed to whoever is connected then; without it, to the connection that asked."""

    class Talk(asyncio.Protocol):
        """One connection."""

        def connection_made(self, transport: asyncio.BaseTransport) -> None:
            units.connections += 1
            self.transport = cast(asyncio.Transport, transport)
            open_transports.append(self.transport)
            if one_wire:
                units.send = self.transport.write

        def data_received(self, data: bytes) -> None:
            if not one_wire:
                units.send = self.transport.write
            units.receive(data)

    open_transports: list[asyncio.Transport] = []
    server = await asyncio.get_running_loop().create_server(Talk, "127.0.0.1", 0)
    try:
        port = server.sockets[0].getsockname()[1]
        yield tcp(port, kind=LinkKind.RTU_OVER_TCP, timeout_s=TIMEOUT_S)
    finally:
        server.close()
        for transport in open_transports:
            transport.abort()
        await asyncio.sleep(0)


@asynccontextmanager
async def behind_pty(units: Units) -> AsyncIterator[Link]:
    """``units`` on a serial line: a pseudo-terminal, whose other end they hold."""
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    loop = asyncio.get_running_loop()
    loop.add_reader(ours, lambda: units.receive(os.read(ours, 256)))
    units.send = lambda data: os.write(ours, data)
    try:
        yield Link(kind=LinkKind.SERIAL, target=os.ttyname(theirs), timeout_s=TIMEOUT_S)
    finally:
        units.send = lambda data: None
        loop.remove_reader(ours)
        os.close(theirs)
        os.close(ours)


def mapped(link: Link, **more: Any) -> Device:
    """The map of the three blocks."""
    registers = [register(f"R{address}", address) for block in BLOCKS for address in block]
    return device(link, *registers, every_s=EVERY_S, **more)


async def polled(line: Any, polls: int, seed: int) -> Counter[str]:
    """Poll ``polls`` times over ``line``; how many samples were right, wrong-but-good and bad."""
    units = Units(mostly_prompt(random.Random(seed)))
    result: Counter[str] = Counter()
    async with line(units) as link:
        batches: list[SampleBatch] = []
        poller = DevicePoller(mapped(link), batches.append, rng=random.Random(seed))
        loop = asyncio.get_running_loop()
        await poller.start()
        for poll in range(polls):
            units.poll, started = poll, loop.time()
            batch = await poller.poll(poll)
            for tag, value, reason in zip(batch.tags, batch.values, batch.reasons, strict=True):
                right = value == word(int(tag[1:]), poll)
                result["bad" if reason else "right" if right else "wrong"] += 1
            await asyncio.sleep(max(EVERY_S - (loop.time() - started), 0.0))
        await poller.stop()
    return result


LINES = {
    "sockets": behind_tcp,
    "sockets of one wire": lambda units: behind_tcp(units, one_wire=True),
    "pty": behind_pty,
}


async def all_polled(lines: int, polls: int) -> dict[str, Counter[str]]:
    """``lines`` lines of each kind polled side by side, ``polls`` times each."""
    counts = {
        kind: asyncio.gather(*(polled(line, polls, seed) for seed in range(lines)))
        for kind, line in LINES.items()
    }
    return {kind: sum(await each, Counter()) for kind, each in counts.items()}


def never_wrong(result: dict[str, Counter[str]]) -> None:
    """No good sample is another register's or another poll's, and there are good ones."""
    for counts in result.values():
        assert counts["wrong"] == 0
        assert counts["right"] > counts.total() / 10


def test_a_late_answer_is_never_the_value_of_another_register() -> None:
    """One answer of five comes late, over sockets and a pseudo-terminal."""
    never_wrong(asyncio.run(all_polled(20, 10)))


@pytest.mark.long
def test_ten_thousand_polls_with_late_answers_give_no_wrong_value() -> None:
    """The same for 10,080 polls of three blocks."""
    never_wrong(asyncio.run(all_polled(70, 48)))


@pytest.mark.parametrize("line", LINES.values(), ids=LINES)
def test_when_every_answer_is_late_no_read_gives_words(line: Any) -> None:
    """Each answer would fit the read after the one it belongs to."""

    async def run() -> tuple[list[int], list[str]]:
        units = Units(lambda: 0.5 + 0.4)  # far from both, for a busy machine
        words: list[int] = []
        reasons: list[str] = []
        async with line(units) as link:
            connection = Connection(replace(link, timeout_s=0.5))
            await connection.open()
            for turn in range(12):
                try:
                    words += await connection.read(1, Table.HOLDING, 100 * (turn % 3), 4)
                except ReadFault as fault:
                    reasons.append(fault.reason)
                    await connection.reopen()
            connection.close()
        return words, reasons

    words, reasons = asyncio.run(run())
    assert words == []
    assert len(reasons) == 12
    assert reasons[0] == "no answer within 0.5 s"
    assert reasons[1].startswith("not asked: an answer that did not come within 0.5 s may still")


class Script:
    """Units that do with each request what the next word of a script says."""

    def __init__(self, *delays_s: float | None) -> None:
        self.delays_s = list(delays_s)

    def __call__(self) -> float:
        delay_s = self.delays_s.pop(0) if self.delays_s else 0.0
        return 1e6 if delay_s is None else delay_s


async def reads(link: Link, *asked: tuple[int, int], unit_id: int = 1, wait_s: float = 0.0) -> list:
    """Read ``(first, count)`` one after the other: the words, or the kind of the fault."""
    line = Connection(link)
    await line.open()
    result: list[Any] = []
    for first, count in asked:
        try:
            result.append(await line.read(unit_id, Table.HOLDING, first, count))
        except ReadFault as fault:
            result.append(fault.kind)
            await line.reopen()
        await asyncio.sleep(wait_s)
    line.close()
    return result


def words_of(first: int, count: int) -> list[int]:
    """What the units hold there while no poll is counted."""
    return [word(address, 0) for address in range(first, first + count)]


def test_another_length_is_asked_for_while_an_answer_may_still_come() -> None:
    """It can be told apart; the same length cannot, until the answer has come or cannot come."""

    async def run() -> tuple[list, list]:
        # Long against what a busy machine adds: the third read must fall before the late answer.
        async with behind_pty(Units(Script(2.6))) as link:
            link = replace(link, timeout_s=0.6)
            heard = await reads(link, (0, 4), (100, 3), (100, 4), (0, 4), wait_s=0.8)
            lost = replace(link, latest_answer_s=0.9)
        async with behind_pty(Units(Script(None))) as other:
            lost = replace(lost, target=other.target)
            return heard, await reads(lost, (0, 4), (100, 4), (100, 4), wait_s=0.6)

    heard, lost = asyncio.run(run())
    three, four = words_of(100, 3), words_of(0, 4)
    assert heard == [FaultKind.SILENT, three, FaultKind.NOT_ASKED, four]
    assert lost == [FaultKind.SILENT, words_of(100, 4), words_of(100, 4)]


def test_a_refusal_that_may_be_to_an_earlier_request_is_not_believed() -> None:
    """Else a register that is there would be left out of the polls."""

    class Refusing(Units):
        def receive(self, request: bytes) -> None:
            refusal = rtu(request[0], bytes([request[1] | 0x80, 2]))
            asyncio.get_running_loop().call_later(self._delay_s(), lambda: self.send(refusal))

    async def run() -> list:
        # Half a time-out after the one, and half before the next: a busy machine is late as well.
        async with behind_pty(Refusing(Script(2.4, None, 0.0))) as link:
            return await reads(replace(link, timeout_s=1.6), (0, 4), (0, 3), (9, 5), (9, 2))

    silent, doubted = FaultKind.SILENT, FaultKind.NONSENSE
    assert asyncio.run(run()) == [silent, doubted, doubted, doubted]


def test_rtu_over_tcp_is_called_again_after_each_silence_and_serial_lines_are_not() -> None:
    """What arrives late on a connection that was given up reaches nobody."""

    async def run() -> tuple[list[bool], int]:
        units = Units(Script(None, None))
        async with behind_tcp(units) as link:
            line = Connection(replace(link, timeout_s=0.5))
            await line.open()
            states = []
            for first, count in ((0, 4), (100, 3), (200, 2)):
                with suppress(ReadFault):
                    await line.read(1, Table.HOLDING, first, count)
                states += [line.connected, await line.reopen()]
            line.close()
            return states, units.connections

    states, connections = asyncio.run(run())
    assert states == [False, True, False, True, True, True]
    assert connections == 3


def test_a_repeated_request_may_be_answered_by_the_first_answer() -> None:
    """The words are those of the register that is asked for, and of this poll."""

    async def run() -> list:
        async with behind_pty(Units(Script(0.75, 1.5))) as link:
            link = replace(link, timeout_s=0.5, retries=1)
            return await reads(link, (0, 4), (100, 4), (100, 3))

    answered = [words_of(0, 4), FaultKind.NOT_ASKED, words_of(100, 3)]
    assert asyncio.run(run()) == answered


def test_a_dead_unit_behind_a_serial_server_does_not_take_the_others_with_it() -> None:
    """Each of its silences costs the connection; a new one is there before the next unit's turn."""

    class Some(Units):
        def receive(self, request: bytes) -> None:
            if request[0] != 2:
                super().receive(request)

    async def run() -> tuple[list[SampleBatch], int]:
        units = Some(lambda: 0.0)
        async with behind_tcp(units) as link:
            registers = [register("DEAD", 0, unit_id=2), register("ALIVE", 7, unit_id=3)]
            plc = device(replace(link, timeout_s=0.5), *registers)
            poller = DevicePoller(plc, lambda batch: None)
            await poller.start()
            batches = [await poller.poll(poll) for poll in range(20)]
            await poller.stop()
            return batches, units.connections

    batches, connections = asyncio.run(run())
    assert all(batch.values[1] == word(7, 0) and batch.reasons[1] == "" for batch in batches)
    assert all(batch.reasons[0] == "no answer within 0.5 s" for batch in batches)
    assert connections == 2


def test_a_tcp_answer_without_a_number_is_doubted_after_a_silence() -> None:
    """Some devices answer with the number 0, whatever the request's is."""
    waiting: list[bytes] = []

    def reply(request: bytes) -> bytes:
        (first,) = request[8:10][1:]
        answer = bytes(6) + request[6:8] + bytes([2, 0, first])
        answer = answer[:5] + bytes([5]) + answer[6:]
        if waiting:
            return waiting.pop()
        waiting.append(answer)
        return b"" if first == 1 else answer

    async def run() -> list:
        async with answering(reply) as port:
            link = tcp(port, timeout_s=0.5)
            prompt = await reads(link, (9, 1))
            waiting.clear()
            return prompt + await reads(link, (1, 1), (2, 1))

    assert asyncio.run(run()) == [[9], FaultKind.SILENT, FaultKind.NONSENSE]


def test_noise_on_a_serial_line_is_nonsense_and_the_line_goes_on() -> None:
    """A wrong checksum: nothing is taken from it, and nobody hangs up."""

    class Noisy(Units):
        def receive(self, request: bytes) -> None:
            self.send(bytes([1, 3, 4, 0, 1, 0, 2, 0xBA, 0xD0]))

    async def run() -> tuple[FaultKind, bool]:
        async with behind_pty(Noisy(lambda: 0.0)) as link:
            line = Connection(replace(link, timeout_s=0.5))
            await line.open()
            with pytest.raises(ReadFault) as caught:
                await line.read(1, Table.HOLDING, 0, 2)
            connected = line.connected
            line.close()
            return caught.value.kind, connected

    assert asyncio.run(run()) == (FaultKind.NONSENSE, True)
