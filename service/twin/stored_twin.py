"""The twin of a valve of the store: from its last screening and the samples of that window."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from threading import Lock

from stemwatch.models.closed_loop.fitted_loop import FittedLoop
from stemwatch.models.recording import Recording
from stemwatch.models.screening_result import Screening
from stemwatch.service.twin.loop_twin import loop_twin

MOST_KEPT = 8  # twins of a page whose sliders are moved; each holds some signals of an hour


class TwinCache:
    """Twins by the screening that they are of; those that were asked for last are kept."""

    def __init__(self) -> None:
        self._kept: OrderedDict[tuple[int, int], FittedLoop | str] = OrderedDict()
        self._guard = Lock()

    def twin(
        self, store: int, number: int, screening: Screening, read: Callable[[], Recording | str]
    ) -> FittedLoop | str:
        """The twin of screening ``number`` of a ``store``, or why there is none. ``read`` gives the
        samples of its window, or why not; it is called only where the twin is not kept."""
        key = (store, number)
        with self._guard:
            if key in self._kept:
                self._kept.move_to_end(key)
                return self._kept[key]
        recording = read()
        if isinstance(recording, str):
            return recording  # the source may answer the next time
        twin = loop_twin(recording, screening)
        with self._guard:
            self._kept[key] = twin
            while len(self._kept) > MOST_KEPT:
                self._kept.popitem(last=False)
        return twin
