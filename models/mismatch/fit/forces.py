"""The force on the stem, which is the command after delay and actuator, in a cache of the latest
ones.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from stemwatch.models.mismatch.stem_model.delay import delayed
from stemwatch.models.mismatch.term import Term
from stemwatch.models.recording import Floats
from stemwatch.models.stickslip.kernel import Marks
from stemwatch.models.stickslip.onsets import Samples

_Key = tuple[tuple[str, ...], bytes]  # the terms that shape a command, and their coordinates


class Shaping(NamedTuple):
    """Terms that shape a command, in the order of the chain, each with the place of its coordinates
    among those of the force; the first of these is the delay, seconds."""

    terms: tuple[tuple[Term, slice], ...]
    slugs: tuple[str, ...]


@dataclass(frozen=True)
class Forces:
    """The forces (rows, n), percent, that were computed last from the command ``op`` (n,).

    Many candidates that run side by side have the same force, which is then computed once. A run
    begins anew where ``start`` (n,) is marked.
    """

    op: Floats
    start: Marks
    interval_s: float
    rows: Floats
    _spare: Floats  # (2, n): one to write to, and the command by the last delay
    _delay: list[float] = field(default_factory=list)  # the last one, in samples
    _made: dict[_Key, int] = field(default_factory=dict)

    @classmethod
    def none_yet(cls, op: Floats, start: Marks, interval_s: float, rows: int) -> Forces:
        """An empty cache with room for ``rows`` forces."""
        return cls(op, start, interval_s, np.empty((rows, op.size)), np.empty((2, op.size)))

    def of(self, shapings: Iterable[tuple[Shaping, Floats]]) -> Samples:
        """(m,) the row of each candidate's force. ``shapings`` holds, for each set of terms, the
        coordinates (candidates, k) of the candidates that have it; at most as many candidates as
        there are rows.
        """
        keys: list[_Key] = []
        making: dict[_Key, tuple[Shaping, Floats]] = {}
        made = self._made
        for shaping, values in shapings:
            slugs, data, size = shaping.slugs, values.tobytes(), values.shape[1] * values.itemsize
            for i, begin in enumerate(range(0, len(data), size)):
                key = slugs, data[begin : begin + size]
                keys.append(key)
                row = made.pop(key, None)
                if row is None:
                    making[key] = shaping, values[i]
                else:
                    made[key] = row  # used again, so it is now the last to be replaced
        for key, (shaping, own) in making.items():
            made[key] = self._make(self._room(), shaping.terms, own)
        return np.array([made[key] for key in keys])

    def _room(self) -> int:
        """A free row, or the one that has been unused the longest."""
        if len(self._made) < self.rows.shape[0]:
            return len(self._made)
        return self._made.pop(next(iter(self._made)))

    def _make(self, row: int, terms: Sequence[tuple[Term, slice]], values: Floats) -> int:
        """The force of coordinates ``values`` (k,) into ``row``."""
        late = values[0] / self.interval_s
        if not terms:
            delayed(self.op, self.start, late, self.rows[row])
            return row
        p = self._late(late)
        # The two take turns, so that the last is written to the row.
        target, other = self.rows[row], self._spare[0]
        if len(terms) % 2 == 0:
            target, other = other, target
        for term, coordinate_slice in terms:
            term.shape(p, self.start, self.interval_s, values[coordinate_slice], target)
            p, target, other = target, other, target
        return row

    def _late(self, samples: float) -> Floats:
        """(n,) the command later by a delay, of which candidates in a row mostly have the same."""
        kept: Floats = self._spare[1]
        if self._delay != [samples]:
            delayed(self.op, self.start, samples, kept)
            self._delay[:] = [samples]
        return kept
