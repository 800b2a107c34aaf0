"""``ResultSpill``: the results of a run in a temporary file, so that memory stays bounded."""

from __future__ import annotations

import heapq
import pickle
import tempfile
import weakref
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any, overload

from stemwatch.models.oscillation_groups.plant_groups import ThinnedLoop
from stemwatch.models.screening_result import Screening
from stemwatch.service.interruption import interrupts_held
from stemwatch.service.presenter.urgency import UrgencyKey
from stemwatch.service.report.charts.valve_plots import ValvePlots
from stemwatch.service.report.ranking import provisional_urgency

MOST_LOOPS = 4000  # loops of a run that are compared with each other; each takes 0.1 MB of disk


class _ReversedRank:
    """A rank with reversed order, so that the heap has the least urgent result on top."""

    __slots__ = ("key",)

    def __init__(self, key: UrgencyKey) -> None:
        self.key = key

    def __lt__(self, other: _ReversedRank) -> bool:
        return self.key > other.key


class ResultSpill(Sequence[Screening]):
    """The screenings of a run by their place, read from a temporary file on access.

    Plots are kept for the ``plotted`` most urgent results only, which pages show;
    ``criticality_of`` a valve is as the plant states it. The file has no name, is written by this
    process only, and is deleted with the object.
    """

    def __init__(self, plotted: int, criticality_of: Callable[[str], str] = lambda _: "") -> None:
        with interrupts_held():  # between the two lines Ctrl-C would leave the file open
            self._file = tempfile.TemporaryFile(prefix="stemwatch-")  # noqa: SIM115  # see below
            weakref.finalize(self, self._file.close)  # with the last reference disk space is freed
        self._plotted = plotted
        self._criticality_of = criticality_of
        self._where: dict[int, int] = {}  # place -> offset of the screening
        self._plots: dict[int, int] = {}  # place -> offset of its plots
        self._thinned_loops: list[int] = []  # offsets
        self._urgency: dict[int, UrgencyKey] = {}
        self._worst: list[tuple[_ReversedRank, int]] = []
        self._order: list[int] | None = None

    def add(self, index: int, screening: Screening, evidence: ValvePlots) -> None:
        """Store the screening at ``index``, and its plots while it is among the worst."""
        self._where[index] = self._write(screening)
        if evidence.thinned_loop is not None:
            if len(self._thinned_loops) < MOST_LOOPS:
                self._thinned_loops.append(self._write(evidence.thinned_loop))
            evidence = replace(evidence, thinned_loop=None)
        urgency = provisional_urgency(screening, self._criticality_of(screening.valve))
        self._urgency[index] = urgency
        self._order = None
        heapq.heappush(self._worst, (_ReversedRank(urgency), index))
        dropped = heapq.heappop(self._worst)[1] if len(self._worst) > self._plotted else None
        if dropped != index:
            self._plots[index] = self._write(evidence)
        if dropped is not None:
            self._plots.pop(dropped, None)

    def evidence(self, rank: int) -> ValvePlots | None:
        """The plots of the screening at position ``rank``, where they are kept."""
        return self.evidence_at(self._places()[rank])

    def thinned_loops(self) -> Iterator[ThinnedLoop]:
        """The thinned loops for comparison, in the order in which they arrived."""
        return (self._read(offset) for offset in self._thinned_loops)

    def at_place(self, index: int) -> Screening:
        """The screening that was stored at ``index``."""
        screening: Screening = self._read(self._where[index])
        return screening

    def evidence_at(self, index: int) -> ValvePlots | None:
        """The plots of the screening at ``index``, where they are kept."""
        offset = self._plots.get(index)
        return None if offset is None else self._read(offset)

    def worst(self, limit: int) -> WorstScreenings:
        """The ``limit`` most urgent screenings, the first of them first, read on access."""
        return WorstScreenings(self, sorted(self._urgency, key=self._urgency.__getitem__)[:limit])

    def __len__(self) -> int:
        return len(self._where)

    @overload
    def __getitem__(self, rank: int) -> Screening: ...

    @overload
    def __getitem__(self, at: slice) -> list[Screening]: ...

    def __getitem__(self, at: int | slice) -> Screening | list[Screening]:
        """The screening at ``at`` in the order of places, or those of a slice."""
        places = self._places()
        if isinstance(at, slice):
            return [self.at_place(index) for index in places[at]]
        return self.at_place(places[at])

    def _places(self) -> list[int]:
        if self._order is None:
            self._order = sorted(self._where)
        return self._order

    def _write(self, value: Any) -> int:
        offset = self._file.seek(0, 2)
        pickle.dump(value, self._file, protocol=pickle.HIGHEST_PROTOCOL)
        return offset

    def _read(self, offset: int) -> Any:
        self._file.seek(offset)
        return pickle.load(self._file)


class WorstScreenings(Sequence[Screening]):
    """Selected screenings of a spill as a sequence, with their plots."""

    def __init__(self, spill: ResultSpill, places: list[int]) -> None:
        self._spill, self._places = spill, places

    def evidence(self, rank: int) -> ValvePlots | None:
        """The plots of the screening at position ``rank``, where they are kept."""
        return self._spill.evidence_at(self._places[rank])

    def __len__(self) -> int:
        return len(self._places)

    @overload
    def __getitem__(self, rank: int) -> Screening: ...

    @overload
    def __getitem__(self, at: slice) -> list[Screening]: ...

    def __getitem__(self, at: int | slice) -> Screening | list[Screening]:
        """The screening at ``at`` of this sequence, or those of a slice."""
        if isinstance(at, slice):
            return [self._spill.at_place(index) for index in self._places[at]]
        return self._spill.at_place(self._places[at])
