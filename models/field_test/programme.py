"""``Programme``: values of OP that an operator sets by hand, one after the other, within limits.

Every move begins and ends at the present OP, so that moves can follow in any order and none leaves
the limits. Values are changes of OP in percent from its present value (``change``); times are
seconds from the start.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise

import numpy as np

from stemwatch.models.recording import Floats

AMPLITUDE, DURATION_S = 5.0, 600.0
LEAD_S, REST_S = 20.0, 20.0  # rest before the first move, and after each move
RESOLUTION = 0.1  # percent, to which OP can be set by hand
QUICKEST_S = 5.0  # least time between two values set by hand


@dataclass(frozen=True, kw_only=True)
class TestLimits:
    """The limits of a test: ``amplitude`` percent of OP either way from its present value,
    ``duration_s``, ``pv_upset`` in units of PV (``None``: as far as PV moved in the recording), and
    OP between ``op_low`` and ``op_high``.

    Raises ``ValueError`` where one of them leaves no room.
    """

    __test__ = False  # is no test of pytest's

    amplitude: float = AMPLITUDE
    duration_s: float = DURATION_S
    pv_upset: float | None = None
    op_low: float = 5.0
    op_high: float = 95.0

    def __post_init__(self) -> None:
        if not 2.0 * RESOLUTION <= self.amplitude <= 50.0:
            raise ValueError(
                f"amplitude: expected {2.0 * RESOLUTION:g} to 50 % of OP, received "
                f"{self.amplitude:g}"
            )
        if not 60.0 <= self.duration_s <= 86400.0:
            raise ValueError(
                f"duration: expected one minute to a day, received {self.duration_s / 60.0:g} min"
            )
        if self.pv_upset is not None and self.pv_upset <= 0.0:
            raise ValueError(
                f"PV upset: expected a positive change of PV, received {self.pv_upset:g}"
            )
        if not 0.0 <= self.op_low < self.op_high <= 100.0:
            raise ValueError(
                f"OP limits: expected 0 <= low < high <= 100 %, received {self.op_low:g} and "
                f"{self.op_high:g}"
            )

    def room(self, op: float) -> tuple[float, float]:
        """How far OP may go down and up from ``op``, percent, both at least 0."""
        down = min(self.amplitude, op - self.op_low)
        up = min(self.amplitude, self.op_high - op)
        return max(_rounded_down(down), 0.0), max(_rounded_down(up), 0.0)


def _rounded_down(value: float) -> float:
    return float(np.floor(value / RESOLUTION + 1e-9) * RESOLUTION)


class MoveKind(StrEnum):
    """The kind of a move."""

    RAMP = "ramp by hand"
    STAIRCASE = "staircase"
    STEPS = "larger steps"
    AFTER_REST = "slow ramp after a rest"


@dataclass(frozen=True, kw_only=True)
class Move:
    """Values of OP, each held ``hold_s``, in steps of at most ``step``. The last one is 0."""

    kind: MoveKind
    changes: tuple[float, ...]
    hold_s: float

    @property
    def step(self) -> float:
        """The largest change from one value to the next, percent."""
        return max(abs(b - a) for a, b in pairwise((0.0, *self.changes)))

    @property
    def words(self) -> str:
        """The moves of OP in words, with their numbers."""
        return f"{self.kind.value}, {self.step:.3g} % every {self.hold_s:g} s"

    @property
    def duration_s(self) -> float:
        """From its first value to the end of the last hold."""
        return len(self.changes) * self.hold_s


@dataclass(frozen=True, kw_only=True)
class SetValue:
    """A value of OP to be set ``at_s`` seconds after the start, as a ``change`` in percent from the
    first value.
    """

    at_s: float
    change: float


@dataclass(frozen=True, kw_only=True)
class Programme:
    """Moves one after the other, with a rest before the first and after each."""

    moves: tuple[Move, ...] = ()

    @property
    def duration_s(self) -> float:
        """All moves and the rests about them; 0 without a move."""
        if not self.moves:
            return 0.0
        return LEAD_S + sum(move.duration_s + REST_S for move in self.moves)

    @property
    def begins_s(self) -> tuple[float, ...]:
        """When each move begins."""
        begins, now = [], LEAD_S
        for move in self.moves:
            begins.append(now)
            now += move.duration_s + REST_S
        return tuple(begins)

    def values(self) -> tuple[SetValue, ...]:
        """Every value that is set, in order; the first is 0 at 0 s."""
        set_values = [SetValue(at_s=0.0, change=0.0)]
        for begin, move in zip(self.begins_s, self.moves, strict=True):
            set_values += [
                SetValue(at_s=begin + k * move.hold_s, change=change)
                for k, change in enumerate(move.changes)
            ]
        return tuple(set_values)

    def changes(self, interval_s: float) -> Floats:
        """(n,) the change of OP at each sample of ``interval_s``."""
        n = int(np.ceil(self.duration_s / interval_s - 1e-9))
        values = self.values()
        times_s = np.array([value.at_s for value in values])
        change = np.array([value.change for value in values])
        index = np.searchsorted(times_s, np.arange(n) * interval_s + 1e-9, side="right") - 1
        return np.asarray(change[index])

    def plus(self, move: Move) -> Programme:
        """This programme and one more move."""
        return Programme(moves=(*self.moves, move))


def possible_moves(down: float, up: float, longest_s: float, least_hold_s: float) -> list[Move]:
    """Closed moves that stay between ``-down`` and ``up`` percent and fit into ``longest_s``.

    Staircases both ways of several steps and holds (the quickest is a ramp by hand), larger steps
    held for several times, small ramps after rests, and steps and ramps of half the size.
    """
    moves: dict[tuple[tuple[float, ...], float], Move] = {}
    for move in _moves(down, up, least_hold_s):
        if move.duration_s + LEAD_S + REST_S <= longest_s:
            moves.setdefault((move.changes, move.hold_s), move)
    return list(moves.values())


def _moves(down: float, up: float, least_hold_s: float) -> Iterator[Move]:
    if down + up < 2.0 * RESOLUTION:
        return
    quickest = max(QUICKEST_S, least_hold_s)
    for share in (1.0, 0.5):
        low, high = _rounded_down(share * down), _rounded_down(share * up)
        if low + high < 2.0 * RESOLUTION:
            continue
        for step, hold in ((0.2, 1.0), (0.5, 1.0), (1.0, 1.0), (1.0, 3.0), (2.0, 2.0), (2.0, 6.0)):
            if step < low + high:
                kind = MoveKind.RAMP if hold == 1.0 else MoveKind.STAIRCASE
                changes = _stairs(low, high, step)
                yield Move(kind=kind, changes=changes, hold_s=hold * quickest)
        for hold in (2.0, 4.0, 12.0):
            corners = [change for change in (high, -low) if abs(change) >= RESOLUTION]
            changes = tuple(x for corner in corners for x in (corner, 0.0))
            yield Move(kind=MoveKind.STEPS, changes=changes, hold_s=hold * quickest)
            if len(corners) == 2:
                ends = (high, -low, high, -low, 0.0)
                yield Move(kind=MoveKind.STEPS, changes=ends, hold_s=hold * quickest)
    for rest_s in (12.0, 36.0):
        yield from _after_rests(down, up, quickest, rest_s)


def _after_rests(down: float, up: float, hold_s: float, rest_s: float) -> Iterator[Move]:
    """The same slow ramp there and back after a rest of ``rest_s`` holds, twice."""
    stairs = _stairs(0.0, up, 0.5) if up >= down else _stairs(down, 0.0, 0.5)
    if len(stairs) < 2:
        return
    resting = (0.0,) * round(rest_s)
    yield Move(
        kind=MoveKind.AFTER_REST,
        changes=(*resting, *stairs, *resting, *stairs),
        hold_s=hold_s,
    )


def _stairs(low: float, high: float, step: float) -> tuple[float, ...]:
    """Up to ``high``, down to ``-low`` and back to 0 in steps of at most ``step``."""
    changes: list[float] = []
    for begin, end in pairwise((0.0, high, -low, 0.0)):
        count = int(np.ceil(abs(end - begin) / step - 1e-9))
        changes += [
            round(float(begin + (end - begin) * k / count), 1) + 0.0 for k in range(1, count + 1)
        ]
    return tuple(changes)
