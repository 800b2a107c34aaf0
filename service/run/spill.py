"""``ResultSpill``: the results of a run on a disk, so that memory does not grow with the valves."""

from __future__ import annotations

import heapq
import pickle
import tempfile
import weakref
from collections.abc import Sequence
from typing import Any, overload

from stemwatch.models.screening_result import Screening
from stemwatch.service.report.charts.valve_plots import ValvePlots
from stemwatch.service.report.ranking import RankKey, worst_first


class _Worse:
    """A rank that compares the other way round, so that a heap has the least bad on top."""

    __slots__ = ("key",)

    def __init__(self, key: RankKey) -> None:
        self.key = key

    def __lt__(self, other: _Worse) -> bool:
        return self.key > other.key


class ResultSpill(Sequence[Screening]):
    """Screenings by their place in the run, read from a temporary file when they are asked for.

    ``plotted`` is for how many of the worst the plots are kept: those that a page shows. The file
    has no name and goes with the spill; what is in it was written by this process only.
    """

    def __init__(self, plotted: int) -> None:
        self._file = tempfile.TemporaryFile(prefix="stemwatch-")  # noqa: SIM115  # see below
        weakref.finalize(self, self._file.close)  # the space comes back with the last reader
        self._plotted = plotted
        self._where: dict[int, int] = {}  # place -> offset of the screening
        self._plots: dict[int, int] = {}  # place -> offset of its plots
        self._badness: dict[int, tuple[float, str]] = {}  # as ``Store.worst_of_run`` sorts
        self._worst: list[tuple[_Worse, int]] = []
        self._order: list[int] | None = None

    def add(self, place: int, screening: Screening, evidence: ValvePlots) -> None:
        """Keep the screening at ``place``; its plots while it is among the worst."""
        self._where[place] = self._write(screening)
        self._badness[place] = (-screening.severity, screening.valve)
        self._order = None
        heapq.heappush(self._worst, (_Worse(worst_first(screening)), place))
        gone = heapq.heappop(self._worst)[1] if len(self._worst) > self._plotted else None
        if gone != place:
            self._plots[place] = self._write(evidence)
        if gone is not None:
            self._plots.pop(gone, None)

    def evidence(self, at: int) -> ValvePlots | None:
        """The plots of the screening at ``at`` of this sequence, where they are kept."""
        return self.evidence_at(self._places()[at])

    def at_place(self, place: int) -> Screening:
        """The screening that was put at ``place``."""
        screening: Screening = self._read(self._where[place])
        return screening

    def evidence_at(self, place: int) -> ValvePlots | None:
        """The plots of the screening at ``place``, where they are kept."""
        offset = self._plots.get(place)
        return None if offset is None else self._read(offset)

    def worst(self, limit: int) -> Worst:
        """The ``limit`` most severe screenings, the worst first, read when they are asked for."""
        return Worst(self, sorted(self._badness, key=self._badness.__getitem__)[:limit])

    def __len__(self) -> int:
        return len(self._where)

    @overload
    def __getitem__(self, at: int) -> Screening: ...

    @overload
    def __getitem__(self, at: slice) -> list[Screening]: ...

    def __getitem__(self, at: int | slice) -> Screening | list[Screening]:
        """The screening at ``at`` in the order of places, or those of a slice."""
        places = self._places()
        if isinstance(at, slice):
            return [self.at_place(place) for place in places[at]]
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


class Worst(Sequence[Screening]):
    """Some places of a spill as a sequence of their own, with their plots."""

    def __init__(self, spill: ResultSpill, places: list[int]) -> None:
        self._spill, self._places = spill, places

    def evidence(self, at: int) -> ValvePlots | None:
        """The plots of the screening at ``at`` of this sequence, where they are kept."""
        return self._spill.evidence_at(self._places[at])

    def __len__(self) -> int:
        return len(self._places)

    @overload
    def __getitem__(self, at: int) -> Screening: ...

    @overload
    def __getitem__(self, at: slice) -> list[Screening]: ...

    def __getitem__(self, at: int | slice) -> Screening | list[Screening]:
        """The screening at ``at`` of this sequence, or those of a slice."""
        if isinstance(at, slice):
            return [self._spill.at_place(place) for place in self._places[at]]
        return self._spill.at_place(self._places[at])
