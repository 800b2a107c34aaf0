"""``Device``: one connection, the registers behind it, and how they are polled."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from stemwatch.connectors.modbus.blocks import MAX_WORDS, Block, plan_blocks
from stemwatch.connectors.modbus.register import Register

FASTEST_S, SLOWEST_S = 0.1, 10.0
DEFAULT_PORT = 502


class LinkKind(StrEnum):
    """What carries the requests."""

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
