"""``Plan``: which blocks are asked for, as far as experience with the device goes."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable

from stemwatch.connectors.modbus.blocks import Block
from stemwatch.connectors.modbus.faults import ReadFault

# After this long, blocks that were split are tried whole again: a device that is being programmed
# refuses everything for a while, and 1500 single requests are no way to go on.
FORGET_S = 600.0
# How long a register that is refused by itself is left alone.
REST_S = 60.0


class Plan:
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
            place = self._blocks.index(block)
            self._blocks[place : place + 1] = halves
        self._split_at_s = self._now_s()
        return halves

    def rest(self, block: Block, fault: ReadFault) -> None:
        """Leave ``block``, which is refused by itself, alone for a while."""
        self._resting[block] = (self._now_s() + REST_S, fault)

    def resting(self, block: Block) -> ReadFault | None:
        """Why ``block`` is left alone, or ``None``."""
        if block not in self._resting:
            return None
        until_s, fault = self._resting[block]
        if self._now_s() < until_s:
            return fault
        del self._resting[block]
        return None

    @property
    def refused(self) -> tuple[str, ...]:
        """The tags that the device does not hand out."""
        return tuple(register.tag for block in self._resting for register in block.registers)
