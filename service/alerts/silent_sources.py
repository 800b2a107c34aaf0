"""Sources and tags that fell silent: one alert for each cause, however many valves it concerns."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

from stemwatch.models.words import counted
from stemwatch.service.alerts.dead_tags import (
    MANY,
    VALVE,
    dead_tags,
    raised_of,
    severity_without_data,
)
from stemwatch.service.config import Plant
from stemwatch.service.store.alerts.alerts import AlertKind, RaisedAlert, to_do
from stemwatch.service.store.samples.sources import SourceState
from stemwatch.service.store.store import Store

BACK = "good samples arrive again"
GONE = "the plant file does not name this source any more"
JOINED = "part of one alert for its device"


def watch_sources(
    store: Store, plant: Plant, since: datetime, now: datetime | None = None
) -> list[int]:
    """Raise an alert for each device without a good sample and each valve with a dead tag, close
    those that are over. The numbers of the new ones; raises ``StoreError``.

    ``since`` is when collecting began, or the clock was set: silence before that is not the
    source's fault. A good sample from the future proves nothing, since the clock was set back.
    Watched folders are not checked, because nobody promises how often a file arrives there.
    """
    now = now or datetime.now(UTC)
    states = {state.source: state for state in store.sources.states()}
    limit = timedelta(seconds=plant.alerts.silent_after_s)
    open_now = store.alerts.open_causes((f"{AlertKind.NO_DATA.value}:",))
    raised: list[RaisedAlert] = []
    alive: list[str] = []
    for name in plant.devices:
        state = states.get(name)
        good = None if state is None else state.last_good
        if good is not None and good - now > limit:
            good = None
        last = since if good is None else max(since, good)
        if now - last > limit:
            raised.append(_silent(plant, name, state, last))
        elif good is not None and now - good < limit:
            alive.append(name)
    if now - since > limit:
        dead = dead_tags(store, plant, alive, limit, now)
        raised += raised_of(store, plant, dead, open_now, now)
    _close(store, plant, open_now, {alert.cause for alert in raised}, alive)
    return store.alerts.raise_all(raised)


def _close(
    store: Store, plant: Plant, open_now: set[str], still_silent: set[str], alive: list[str]
) -> None:
    """Close alerts that are over, and those that another alert now covers."""
    by_reason: dict[str, list[str]] = {BACK: [], GONE: [], JOINED: []}
    for cause in sorted(open_now - still_silent):
        source = _source(cause, plant)
        if source not in plant.devices:
            by_reason[GONE].append(cause)
        elif {_cause(source), MANY + source} & still_silent:
            by_reason[JOINED].append(cause)
        elif source in alive:
            by_reason[BACK].append(cause)
    for reason, causes in by_reason.items():
        store.alerts.clear(causes, reason)


def _source(cause: str, plant: Plant) -> str:
    """The device that a cause is about; empty for a valve that the plant file does not name."""
    if cause.startswith(VALVE):
        entry = plant.valves.get(cause.removeprefix(VALVE))
        return "" if entry is None else entry.source
    return cause.removeprefix(MANY if cause.startswith(MANY) else f"{AlertKind.NO_DATA.value}:")


def _cause(source: str) -> str:
    return f"{AlertKind.NO_DATA.value}:{source}"


def _silent(plant: Plant, name: str, state: SourceState | None, last: datetime) -> RaisedAlert:
    valves = [valve for valve in plant.valves.values() if valve.source == name]
    fault = f" ({state.fault})" if state is not None and state.fault else ""
    worst = max((valve.criticality for valve in valves), default=1)
    return RaisedAlert(
        cause=_cause(name),
        kind=AlertKind.NO_DATA,
        severity=severity_without_data(worst),
        text=(
            f"No good sample of {name} since {last:%Y-%m-%d %H:%M} UTC{fault}; its "
            f"{counted(len(valves), 'valve is', 'valves are')} not watched."
        ),
        source=name,
        evidence={
            "valves": len(valves),
            "last_good": last.isoformat(),
            **to_do("Check the connection and the device."),
        },
    )
