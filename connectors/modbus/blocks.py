"""Neighbouring registers are asked for together: fewer requests, and tags of one instant."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

from stemwatch.connectors.modbus.address import Table
from stemwatch.connectors.modbus.register import Register

MAX_WORDS = 125  # the protocol's own limit for functions 3 and 4


@dataclass(frozen=True, eq=False)  # a block is itself: a plan asks for it again and again
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
        """The block in two, at its widest hole, or in the middle where it has none.

        A hole comes first: devices refuse what is not there rather than what a map names. ``None``
        where there is nothing to divide: registers that all begin at one address.
        """
        return max(self._cuts(), key=self._natural, default=None)

    def avoiding(self, counts: Collection[int]) -> tuple[Block, ...]:
        """The block in as few pieces as bear none of ``counts`` as their ``count``.

        A piece that bears one of them all the same has registers that cannot be divided.
        """
        cuts = self._cuts() if self.count in counts else []
        if not cuts:
            return (self,)

        def better(halves: tuple[Block, Block]) -> tuple[int, int, float]:
            return sum(half.count not in counts for half in halves), *self._natural(halves)

        left, right = max(cuts, key=better)
        return left.avoiding(counts) + right.avoiding(counts)

    def _cuts(self) -> list[tuple[Block, Block]]:
        places = [i for i in range(1, len(self.registers)) if self._apart(i)]
        return [(Block(self.registers[:cut]), Block(self.registers[cut:])) for cut in places]

    def _natural(self, halves: tuple[Block, Block]) -> tuple[int, float]:
        cut = len(halves[0].registers)
        return max(self._hole(cut), 0), -abs(cut - len(self.registers) / 2)

    def _hole(self, place: int) -> int:
        return self.registers[place].first - max(r.stop for r in self.registers[:place])

    def _apart(self, place: int) -> bool:
        return self.registers[place].first > self.registers[place - 1].first


def plan_blocks(
    registers: Iterable[Register], *, max_words: int = MAX_WORDS, max_gap: int = 0
) -> tuple[Block, ...]:
    """As few requests as hold all ``registers``.

    A request has at most ``max_words`` words and bridges at most ``max_gap`` words that nobody
    asked for; no value is torn apart. Raises ``ValueError`` for a limit that no request can keep.
    """
    if not 4 <= max_words <= MAX_WORDS:
        raise ValueError(f"max_words must be 4 to {MAX_WORDS}, received {max_words}")
    if max_gap < 0:
        raise ValueError(f"max_gap must not be negative, received {max_gap}")
    blocks: list[Block] = []
    run: list[Register] = []
    stop = 0
    for register in sorted(registers, key=_place):
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


def _place(register: Register) -> tuple[int, str, int, int]:
    return register.unit_id, register.address.table.value, register.first, register.stop


def _same_memory(one: Register, other: Register) -> bool:
    return (one.unit_id, one.address.table) == (other.unit_id, other.address.table)
