"""``Register``: one signal in a device's memory, and how its words are read."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from stemwatch.connectors.modbus.datatypes import ByteOrder, DataType, decode
from stemwatch.connectors.modbus.register_address import RegisterAddress
from stemwatch.models.recording import Quality

# A measured value is zero or far larger; a float read in the wrong byte order may be smaller.
TINY = 1e-30

WRONG_ORDER = "a number below 1e-30 that is not zero: wrong byte order?"
NOT_A_NUMBER = "not a number"
INVALID = "the device says: no valid value"
BELOW = "below the lowest value the signal can have"
ABOVE = "above the highest value the signal can have"


class Reading(NamedTuple):
    """A value in engineering units; NaN with quality and reason where there is no good value."""

    value: float
    quality: Quality
    reason: str


@dataclass(frozen=True, kw_only=True)
class Register:
    """Where a tag stands and how its words become engineering units: ``raw * scale + offset``.

    ``invalid`` are raw numbers, ``invalid_words`` raw words as they stand in the registers, with
    which the device says that it has no value; ``lowest`` and ``highest`` are in engineering units.
    ``written`` is the address as the map has it.
    """

    tag: str
    unit_id: int
    address: RegisterAddress
    kind: DataType
    order: ByteOrder = ByteOrder.ABCD
    scale: float = 1.0
    offset: float = 0.0
    invalid: frozenset[float] = frozenset()
    invalid_words: frozenset[tuple[int, ...]] = frozenset()
    lowest: float | None = None
    highest: float | None = None
    unit: str = ""
    description: str = ""
    written: str = ""

    @property
    def first(self) -> int:
        """The protocol address of the first word."""
        return self.address.offset

    @property
    def stop(self) -> int:
        """The protocol address just behind the last word."""
        return self.address.offset + self.kind.words

    def read(self, words: Sequence[int]) -> Reading:
        """The reading of ``words`` (as many as ``kind`` takes), in engineering units."""
        raw = decode(words, self.kind, self.order)
        # A NaN equals nothing, so words are compared where a comparison of floats cannot decide.
        if raw in self.invalid or (self.invalid_words and tuple(words) in self.invalid_words):
            return Reading(math.nan, Quality.BAD, INVALID)
        if self.kind.is_float:
            if not math.isfinite(raw):
                return Reading(math.nan, Quality.BAD, NOT_A_NUMBER)
            if raw != 0.0 and abs(raw) < TINY:
                return Reading(math.nan, Quality.CODE, WRONG_ORDER)
        value = raw * self.scale + self.offset
        if not math.isfinite(value):
            return Reading(math.nan, Quality.BAD, NOT_A_NUMBER)
        if self.lowest is not None and value < self.lowest:
            return Reading(math.nan, Quality.RANGE, BELOW)
        if self.highest is not None and value > self.highest:
            return Reading(math.nan, Quality.RANGE, ABOVE)
        return Reading(value, Quality.GOOD, "")
