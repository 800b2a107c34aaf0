"""Blocks: neighbouring registers in one request, so that there are fewer and values are of one
instant."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

from stemwatch.connectors.modbus.read_fault import ReadFault
from stemwatch.connectors.modbus.register import Register
from stemwatch.connectors.modbus.register_address import Table

MAX_WORDS = 125  # the protocol's own limit for functions 3 and 4


@dataclass(frozen=True, eq=False)  # compared by identity, since a plan reuses its blocks
class Block:
    """One request: registers of one unit and table, in the order of their addresses."""

    registers: tuple[Register, ...]

    @property
    def unit_id(self) -> int:
        """The unit that is asked."""
        return self.registers[0].unit_id

    @property
    def table(self) -> Table:
        """The table that is asked."""
        return self.registers[0].address.table

    @property
    def first(self) -> int:
        """The protocol address of the first word."""
        return self.registers[0].first

    @cached_property
    def count(self) -> int:
        """How many words are asked for."""
        return max(register.stop for register in self.registers) - self.first

    def __str__(self) -> str:
        return f"{self.table.value} {self.first} to {self.first + self.count - 1}"

    def words_of(self, register: Register, words: Sequence[int]) -> Sequence[int]:
        """The words of ``register`` among the ``count`` words of this block."""
        start = register.first - self.first
        return words[start : start + register.kind.words]

    def halves(self) -> tuple[Block, Block] | None:
        """The block in two, at its widest gap, or in the middle where it has none.

        Devices rather refuse addresses in a gap than those of the map. ``None`` where all registers
        begin at one address, so that they cannot be divided.
        """
        return max(self._cuts(), key=self._natural, default=None)

    def avoiding(self, counts: Collection[int]) -> tuple[Block, ...]:
        """The block in as few pieces as have no ``count`` that is in ``counts``.

        A piece that has one all the same consists of registers that cannot be divided.
        """
        cuts = self._cuts() if self.count in counts else []
        if not cuts:
            return (self,)

        def better(halves: tuple[Block, Block]) -> tuple[int, int, float]:
            return sum(half.count not in counts for half in halves), *self._natural(halves)

        lower, right = max(cuts, key=better)
        return lower.avoiding(counts) + right.avoiding(counts)

    def _cuts(self) -> list[tuple[Block, Block]]:
        places = [i for i in range(1, len(self.registers)) if self._starts_apart(i)]
        return [(Block(self.registers[:cut]), Block(self.registers[cut:])) for cut in places]

    def _natural(self, halves: tuple[Block, Block]) -> tuple[int, float]:
        cut = len(halves[0].registers)
        return max(self._hole(cut), 0), -abs(cut - len(self.registers) / 2)

    def _hole(self, index: int) -> int:
        return self.registers[index].first - max(r.stop for r in self.registers[:index])

    def _starts_apart(self, index: int) -> bool:
        return self.registers[index].first > self.registers[index - 1].first


def plan_blocks(
    registers: Iterable[Register], *, max_words: int = MAX_WORDS, max_gap: int = 0
) -> tuple[Block, ...]:
    """The fewest requests for all ``registers``.

    A request has at most ``max_words`` words and includes at most ``max_gap`` unused words between
    two registers; a value is never split. Raises ``ValueError`` for a limit out of range.
    """
    if not 4 <= max_words <= MAX_WORDS:
        raise ValueError(f"max_words must be 4 to {MAX_WORDS}, received {max_words}")
    if max_gap < 0:
        raise ValueError(f"max_gap must not be negative, received {max_gap}")
    blocks: list[Block] = []
    run: list[Register] = []
    stop = 0
    for register in sorted(registers, key=_reading_order):
        fits = run and _same_memory(run[0], register) and register.first - stop <= max_gap
        if not fits or max(stop, register.stop) - run[0].first > max_words:
            if run:
                blocks.append(Block(tuple(run)))
            run, stop = [], 0
        run.append(register)
        stop = max(stop, register.stop)
    if run:
        blocks.append(Block(tuple(run)))
    return tuple(blocks)


def _reading_order(register: Register) -> tuple[int, str, int, int]:
    return register.unit_id, register.address.table.value, register.first, register.stop


def _same_memory(register: Register, other: Register) -> bool:
    return (register.unit_id, register.address.table) == (other.unit_id, other.address.table)


# After this time blocks that were split are tried whole again: a device that is being programmed
# refuses everything for a while, and must not be asked in 1500 single requests afterwards.
FORGET_S = 600.0
# After this time a single register that was refused is asked for again.
REST_S = 60.0


class BlockPlan:
    """The blocks of a device, split where it refused them, and the registers it refuses."""

    def __init__(
        self, blocks: Iterable[Block], now_s: Callable[[], float] = time.monotonic
    ) -> None:
        self._whole = tuple(blocks)
        self._blocks = list(self._whole)
        self._now_s = now_s
        self._split_at_s: float | None = None
        self._resting: dict[Block, tuple[float, ReadFault]] = {}

    def blocks(self) -> tuple[Block, ...]:
        """The blocks to ask for now."""
        if self._split_at_s is not None and self._now_s() - self._split_at_s > FORGET_S:
            self._blocks, self._split_at_s = list(self._whole), None
            self._resting.clear()
        return tuple(self._blocks)

    def split(self, block: Block) -> tuple[Block, ...]:
        """Ask for ``block`` in halves from now on; empty where it cannot be divided."""
        halves = block.halves()
        if halves is None:
            return ()
        if block in self._blocks:
            index = self._blocks.index(block)
            self._blocks[index : index + 1] = halves
        self._split_at_s = self._now_s()
        return halves

    def rest(self, block: Block, fault: ReadFault) -> None:
        """Do not ask for ``block``, which was refused and cannot be divided, for ``REST_S``."""
        self._resting[block] = (self._now_s() + REST_S, fault)

    def resting(self, block: Block) -> ReadFault | None:
        """The fault for which ``block`` is not asked for now, or ``None``."""
        if block not in self._resting:
            return None
        until_s, fault = self._resting[block]
        if self._now_s() < until_s:
            return fault
        del self._resting[block]
        return None

    @property
    def refused(self) -> tuple[str, ...]:
        """The tags that the device refuses to read."""
        return tuple(register.tag for block in self._resting for register in block.registers)
