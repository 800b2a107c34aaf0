"""The signals of a valve over a window, from the store where it has them, else from the source."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta

import numpy as np
from fastapi import HTTPException

from stemwatch.connectors.connector import ConnectorError, Window
from stemwatch.models.recording import Floats, Recording, Role
from stemwatch.service.config.schema import Tag
from stemwatch.service.report.charts.thinning import ThinningGrid, lowest_and_highest
from stemwatch.service.store.samples.plot_points import PlotPoints
from stemwatch.service.store.screenings.records import EARLIEST, LATEST
from stemwatch.service.store.store import Store
from stemwatch.service.web.api.schemas import SignalsAnswer, Trace
from stemwatch.service.web.site import Site

DRAWN_ROLES = (Role.OP, Role.MV, Role.PV, Role.SP)
IN_PERCENT = (Role.OP, Role.MV)
POINTS = 1600
LONGEST = timedelta(days=31)
DIGITS = 5
NO_TAGS = (
    "The plant file does not name this valve, so that its signals cannot be found; the numbers "
    "above stand in the database."
)
NO_READER = "This page has no way to the valve's source; start it with stemwatch serve."
NOTHING = "There are no samples in this window."


@dataclass(frozen=True, kw_only=True)
class SignalWindow:
    """A valve and a window with both ends, UTC."""

    valve: str
    start: datetime
    stop: datetime

    @property
    def window(self) -> Window:
        """The window as a connector is asked for it."""
        return Window(start=self.start, stop=self.stop)

    def at_most(self, length: timedelta) -> SignalWindow:
        """The end of the window where it is longer than ``length``."""
        start = max(self.start, self.stop - length)
        return SignalWindow(valve=self.valve, start=start, stop=self.stop)


def signals_of(site: Site, window: SignalWindow) -> SignalsAnswer:
    """OP, MV, PV and SP over time. OP and MV in percent where the plant file gives their range."""
    tags = tags_of(site, window.valve)
    if not tags or site.plant is None:
        return _answer(window, [], None, 0.0, NO_TAGS)
    source = site.plant.valves[window.valve].source
    if Role.OP in tags and site.store.samples.has_tag(source, tags[Role.OP].tag):
        return _stored(site.store, source, window, tags)
    return _from_source(site, window)


def tags_of(site: Site, valve: str) -> Mapping[Role, Tag]:
    """The tags of a valve that are drawn; empty where the plant does not know it."""
    if site.plant is None or valve not in site.plant.valves:
        return {}
    tags = site.plant.valves[valve].tags.by_role()
    return {role: tags[role] for role in DRAWN_ROLES if role in tags}


def _stored(
    store: Store, source: str, window: SignalWindow, tags: Mapping[Role, Tag]
) -> SignalsAnswer:
    traces, bucket_s = [], 0.0
    for role, tag in tags.items():
        plot_points = store.samples.plot_points(source, tag.tag, window.start, window.stop, POINTS)
        if plot_points is None:
            continue
        bucket_s = max(bucket_s, plot_points.bucket_s)
        values, unit = _in_percent(role, tag, plot_points.values)
        points = PlotPoints(at_s=plot_points.at_s, values=values)
        traces.append(_trace(role, tag.tag, unit, points))
    bounds = store.samples.bounds(source, tags[Role.OP].tag)
    empty = not any(trace.at_s for trace in traces)
    return _answer(window, traces, bounds, bucket_s, NOTHING if empty else "")


def _in_percent(role: Role, tag: Tag, values: Floats) -> tuple[Floats, str]:
    if role in IN_PERCENT and tag.low is not None and tag.high is not None:
        return 100.0 * (values - tag.low) / (tag.high - tag.low), "%"
    return values, tag.unit or ("%" if role in IN_PERCENT else "")


def _from_source(site: Site, window: SignalWindow) -> SignalsAnswer:
    recording, sentence = read_recording(site, window)
    if recording is None or recording.start is None:
        return _answer(window, [], None, 0.0, sentence or NOTHING)
    grid = ThinningGrid.of(len(recording), POINTS)
    count = lowest_and_highest(recording.op.values, grid).size
    since_s = recording.interval_s * (grid.first + grid.step * np.arange(count, dtype=np.float64))
    times = np.asarray(recording.start.timestamp() + since_s)
    traces = []
    for role in DRAWN_ROLES:
        signal = recording.get(role)
        if signal is not None:
            signal = signal if role in IN_PERCENT else signal.in_process_unit()
            points = PlotPoints(at_s=times, values=lowest_and_highest(signal.values, grid))
            traces.append(_trace(role, signal.tag, signal.unit, points))
    bucket_s = 0.0 if grid.bucket == 1 else grid.bucket * recording.interval_s
    return _answer(window, traces, None, bucket_s, "")


def read_recording(site: Site, window: SignalWindow) -> tuple[Recording | None, str]:
    """The recording of a window, or ``None`` and a sentence that says why."""
    if site.read is None:
        return None, NO_READER
    try:
        recording = site.read(window.valve, window.window)
    except ConnectorError as error:
        return None, str(error)
    if recording is None or not len(recording):
        return None, NOTHING
    return recording, ""


def _answer(
    window: SignalWindow,
    traces: list[Trace],
    bounds: tuple[datetime, datetime] | None,
    bucket_s: float,
    sentence: str,
) -> SignalsAnswer:
    first, last = bounds or (None, None)
    return SignalsAnswer(
        valve=window.valve,
        start_s=window.start.timestamp(),
        stop_s=window.stop.timestamp(),
        first_s=None if first is None else first.timestamp(),
        last_s=None if last is None else last.timestamp(),
        bucket_s=bucket_s,
        traces=traces,
        says=sentence,
    )


def _trace(role: Role, tag: str, unit: str, points: PlotPoints) -> Trace:
    return Trace(
        role=role.value,
        label=role.value.upper(),
        tag=tag,
        unit=unit,
        at_s=np.round(points.at_s, 3).tolist(),
        values=json_numbers(points.values),
    )


def json_numbers(values: Floats) -> list[float | None]:
    """Rounded to what can be seen, null for NaN, which JSON does not have."""
    finite = np.isfinite(values)
    if not finite.any():
        return [None] * values.size
    size = float(np.ptp(values[finite])) or abs(float(values[finite][0])) or 1.0
    places = max(0, DIGITS - 1 - int(np.floor(np.log10(size))))
    rounded = np.round(values, places).tolist()
    return [value if fine else None for value, fine in zip(rounded, finite.tolist(), strict=True)]


SHORTEST = timedelta(seconds=1)


def window_of(valve: str, start: datetime, stop: datetime) -> SignalWindow:
    """The window from ``start`` to ``stop``. Raises 422 where it is empty, too long or outside the
    allowed dates."""
    if not (EARLIEST <= start <= LATEST and EARLIEST <= stop <= LATEST):
        raise HTTPException(422, f"a window between {EARLIEST.year} and {LATEST.year} is expected")
    if stop - start < SHORTEST:
        raise HTTPException(422, "a window that ends at least a second after it begins is expected")
    if stop - start > LONGEST:
        raise HTTPException(
            422, f"at most {LONGEST.days} days are drawn at once; received {(stop - start).days}"
        )
    return SignalWindow(valve=valve, start=start.astimezone(UTC), stop=stop.astimezone(UTC))
