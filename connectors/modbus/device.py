"""``Device``: one connection, the registers behind it, and how they are polled."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum

from stemwatch.connectors.modbus.blocks import MAX_WORDS, Block, plan_blocks
from stemwatch.connectors.modbus.register import Register

FASTEST_S, SLOWEST_S = 0.1, 10.0
DEFAULT_PORT = 502


class LinkKind(StrEnum):
    """How a device is reached."""

    TCP = "tcp"
    RTU_OVER_TCP = "rtuovertcp"  # a serial server that passes RTU frames on as they are
    SERIAL = "serial"


@dataclass(frozen=True, kw_only=True)
class Link:
    """Where a device is reached.

    ``target`` is a host name or address, or the name of a serial port; ``port`` is used for TCP,
    the line settings for serial ports. ``timeout_s`` is how long one answer is waited for,
    ``retries`` how often one request is repeated, ``pause_s`` the rest between two requests.
    ``latest_answer_s`` is how long after its request an answer may still come; 0 stands for ten
    seconds, or five times ``timeout_s`` where that is longer.
    """

    kind: LinkKind
    target: str
    port: int = DEFAULT_PORT
    baudrate: int = 19200
    bytesize: int = 8
    parity: str = "N"
    stopbits: int = 1
    timeout_s: float = 1.0
    retries: int = 0
    pause_s: float = 0.0
    latest_answer_s: float = 0.0

    @property
    def is_rtu(self) -> bool:
        """Whether frames are RTU: without a number that ties an answer to its request."""
        return self.kind is not LinkKind.TCP

    @property
    def answers_until_s(self) -> float:
        """Seconds after its request until which an answer may still come."""
        return max(self.latest_answer_s or max(10.0, 5 * self.timeout_s), self.timeout_s)

    def __str__(self) -> str:
        if self.kind is LinkKind.SERIAL:
            line = f"{self.baudrate} {self.bytesize}{self.parity}{self.stopbits}"
            return f"{self.target} ({line})"
        host = f"[{self.target}]" if ":" in self.target else self.target
        return f"{host}:{self.port}" + (" (RTU)" if self.is_rtu else "")


@dataclass(frozen=True, kw_only=True)
class Device:
    """A device as the plant file describes it; ``name`` is the source that valves refer to.

    ``every_s`` is the time between two polls. ``max_words`` and ``max_gap`` limit one request, see
    ``plan_blocks``.
    """

    name: str
    link: Link
    registers: tuple[Register, ...]
    every_s: float = 1.0
    max_words: int = MAX_WORDS
    max_gap: int = 8

    @property
    def tags(self) -> tuple[str, ...]:
        """The tags, in the order of the map."""
        return tuple(register.tag for register in self.registers)

    def blocks(self) -> tuple[Block, ...]:
        """The requests of one poll."""
        return plan_blocks(self.registers, max_words=self.max_words, max_gap=self.max_gap)


REQUEST_BYTES = 8  # unit, function, address, count, checksum
REPLY_BYTES = 5  # unit, function, byte count, checksum
TURNAROUND_S = 0.005  # a quick device; many take ten times as long, so this is a lower limit
FAST_BAUDRATE = 19_200  # above it the silence between frames is 1.75 ms, not 3.5 characters
FAST_SILENCE_S = 0.00175


def poll_time_s(blocks: Iterable[Block], link: Link) -> float:
    """Seconds that reading all ``blocks`` takes at least on the serial line of ``link``.

    Each request: ``8 + 5 + 2 words`` characters of start, data, parity and stop bits, two silences
    of 3.5 characters (1.75 ms above 19200 baud; Modbus over Serial Line 1.02, section 2.5.1.1),
    the device's own time of 5 ms, and the pause that the map asks for.
    """
    bits = 1 + link.bytesize + (link.parity != "N") + link.stopbits
    character_s = bits / link.baudrate
    silence_s = FAST_SILENCE_S if link.baudrate > FAST_BAUDRATE else 3.5 * character_s
    total_s = 0.0
    for block in blocks:
        characters = REQUEST_BYTES + REPLY_BYTES + 2 * block.count
        total_s += characters * character_s + 2 * silence_s + TURNAROUND_S + link.pause_s
    return total_s
