"""The stem: its equations, and the numbers and tables that the terms of a hypothesis fill.

The element is the canonical one of Choudhury, Thornhill and Shah (2005,
doi:10.1016/j.conengprac.2004.05.005): levels ``fs = (S + J)/2`` and ``fd = (S - J)/2``,
``F = p - x - force(x)``. What is added to it:

- whether a moving stem sticks again is decided by its own speed and the force on it. With
  ``gap = d F - fd`` the stem moves ``a gap`` in a sample, ``a = 1 - exp(-dt / DRAG_S)``; it sticks
  where that is no faster than ``RESTICK``. Without drag ``gap`` is the step of the force, and this
  is the canonical test; with drag, the stem goes on after the command has turned.
- friction may depend on place (``friction``, added to both levels), on the rest before
  (``breakaway``, added to ``fs``), on direction (``ASYMMETRY``: J (1 + a) rising, J (1 - a)
  falling) and on time (``GROWTH``: both levels times 1 + g t/T); that it may depend on the speed of
  the force (``SOONER``), only the likelihood knows (``breakaway_filter``),
- a force may depend on place (``force``), and on the way since a turn (``HYSTERESIS``, ``WAY``: see
  ``inner_friction``); a resting stem may creep, or give way to each change of the force
  (``GIVES``: see ``presliding``), stops may hold it,
- a stem with inertia (``RUN_UP_S`` > 0, where a drive is sampled fast enough to show it) is moved
  by its force balance, ``DRAG_S (RUN_UP_S dv/dt + v) = d F - fd``, ``v >= 0``; the motor's part
  of ``F``, ``p - x``, goes no further than ``DRAG_S TOP_SPEED``, at which the voltage meets its
  limit; it rests where its speed has come to 0 and the force is within ``fs``,
- between stem and reading there may be play, and the reading may drift:
  ``MV = gain (z - 50) + 50 + zero + drift (t/T - 1/2) + wander(t)``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from stemwatch.models.compiled import compiled
from stemwatch.models.recording import Floats

# Order of the numbers (22,) of a stem.
(
    S,
    J,
    ASYMMETRY,
    GROWTH,
    CREEP,
    DRAG_S,
    RESTICK,
    STOP_LOW,
    STOP_HIGH,
    PLAY,
    GAIN,
    ZERO,
    DRIFT,
    BY_PLACE,
    BY_REST,
    BY_TIME,
    RUN_UP_S,
    TOP_SPEED,
    HYSTERESIS,
    WAY,
    SOONER,
    GIVES,
) = range(22)
N_NUMBERS = 22
PLACE_LOW, PLACE_HIGH, PLACES = -20.0, 120.0, 141

_NEUTRAL = np.zeros(N_NUMBERS)
_NEUTRAL[[GAIN, STOP_LOW, STOP_HIGH, TOP_SPEED]] = 1.0, -np.inf, np.inf, np.inf
EVENT = 3.0  # weight of a breakaway, in samples


class Tables(NamedTuple):
    """The tables of m candidates, percent of span, read where their numbers say so.

    ``friction`` and ``force`` (m, PLACES) from ``PLACE_LOW`` to ``PLACE_HIGH`` percent, by linear
    interpolation; ``breakaway`` (m, n + 1) over the samples rested; ``wander`` (m, n + 1) of the
    reading over time.
    """

    friction: Floats
    force: Floats
    breakaway: Floats
    wander: Floats


@dataclass
class Stem:
    """Numbers (22,) and tables of one run.

    ``friction`` and ``force`` (141,) over place, ``breakaway`` (n + 1,) over the samples rested,
    ``wander`` (n + 1,) of the reading over time, all in percent of span. A term that fills a table
    sets ``numbers[BY_PLACE]``, ``numbers[BY_REST]`` or ``numbers[BY_TIME]`` to 1.
    """

    numbers: Floats
    friction: Floats
    force: Floats
    breakaway: Floats
    wander: Floats
    interval_s: float

    @classmethod
    def neutral(cls, samples: int, interval_s: float) -> Stem:
        """A stem without friction whose tables suit a recording of ``samples``."""
        return Stems.neutral(1, samples, interval_s).each[0]


@compiled()
def _clear(
    numbers: Floats, friction: Floats, force: Floats, breakaway: Floats, wander: Floats
) -> None:
    """Reset the stems of ``numbers`` (m, 22) to neutral, and the tables that their flags name."""
    for row in range(numbers.shape[0]):
        if numbers[row, BY_PLACE] != 0.0:
            friction[row], force[row] = 0.0, 0.0
        if numbers[row, BY_REST] != 0.0:
            breakaway[row] = 0.0
        if numbers[row, BY_TIME] != 0.0:
            wander[row] = 0.0
        # One by one: a row at a time would have numba's error about shapes compiled.
        for i in range(_NEUTRAL.size):
            numbers[row, i] = _NEUTRAL[i]


@dataclass(frozen=True)
class Stems:
    """Stems that run side by side: each is a view of a row of ``numbers`` (m, 22) and tables."""

    numbers: Floats
    tables: Tables
    each: tuple[Stem, ...]

    @classmethod
    def neutral(cls, count: int, samples: int, interval_s: float) -> Stems:
        """``count`` stems without friction whose tables suit a recording of ``samples``."""
        numbers = np.tile(_NEUTRAL, (count, 1))
        by_place = np.zeros((count, PLACES)), np.zeros((count, PLACES))
        over_time = np.zeros((count, samples + 1)), np.zeros((count, samples + 1))
        tables = Tables(*by_place, *over_time)
        stem_of_each = (Stem(*row, interval_s) for row in zip(numbers, *tables, strict=True))
        return cls(numbers, tables, tuple(stem_of_each))

    def clear(self, count: int) -> None:
        """Reset the first ``count`` stems to neutral; tables only where they were used."""
        _clear(self.numbers[:count], *self.tables)

    def first(self, count: int) -> tuple[Floats, Tables]:
        """Numbers and tables of the first ``count``."""
        return self.numbers[:count], Tables(*(table[:count] for table in self.tables))


def places() -> Floats:
    """(141,) the places of the tables, percent of travel."""
    return np.linspace(PLACE_LOW, PLACE_HIGH, PLACES)
