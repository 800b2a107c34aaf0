"""What shows best that a valve may stick, where its latest window by itself shows little."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from datetime import datetime

from stemwatch.models.without_position.several_recordings import clearest
from stemwatch.models.without_position.suspicion import Suspicion, WithoutPosition
from stemwatch.service.report.charts.suspicion_pictures import ShownSuspicion
from stemwatch.service.report.charts.window_pictures import unpack_pictures
from stemwatch.service.store.screenings.records import EarlierAnswer


def of_earlier_window(
    told: WithoutPosition | None,
    start: datetime | None,
    answers: Sequence[EarlierAnswer],
    packed_pictures: Callable[[int], bytes],
) -> ShownSuspicion | None:
    """The pictures of the clearest of the windows in ``answers`` that ended before the latest one
    began at ``start``; ``told`` is what OP and PV say with all of them counted.

    ``packed_pictures`` gives what is kept of a screening. ``None`` where the valve is not
    suspected, where its latest window raises the suspicion by itself, and where the clearest window
    has no pictures.
    """
    if told is None or told.verdict is not Suspicion.SUSPECTED or start is None:
        return None
    earlier = [before for before in answers if before.end <= start]
    shown = clearest([told, *(before.answer for before in earlier)])
    if not shown:
        return None
    window = earlier[shown - 1]
    pictures = unpack_pictures(packed_pictures(window.screening)).suspicion
    return ShownSuspicion(pictures, window.end) if pictures else None
