"""Sources that fell silent: one alert for each, whatever number of valves hangs on it."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

from stemwatch.service.plantfile import Plant
from stemwatch.service.store.alerts import AlertKind, AlertSeverity, Raised
from stemwatch.service.store.sources import SourceState
from stemwatch.service.store.store import Store

BACK = "good samples arrive again"
GONE = "the plant file does not name this source any more"


def watch_sources(
    store: Store, plant: Plant, since: datetime, now: datetime | None = None
) -> list[int]:
    """Raise an alert for each device without a good sample, close those that are over.

    ``since`` is when collecting began: before that no source can be blamed. Watched folders are
    not looked at: how often somebody drops a file there is nobody's promise.
    """
    now = now or datetime.now(UTC)
    states = {state.source: state for state in store.sources.states()}
    limit = timedelta(seconds=plant.alerts.silent_after_s)
    raised: list[Raised] = []
    over: list[str] = []
    for name in plant.devices:
        state = states.get(name)
        last = max(since, state.last_good) if state and state.last_good else since
        if now - last > limit:
            raised.append(_silent(plant, name, state, last))
        elif state is not None and state.last_good is not None and now - state.last_good < limit:
            over.append(_cause(name))
    store.alerts.clear(over, BACK)
    named = {_cause(name) for name in plant.devices}
    gone = store.alerts.open_causes((f"{AlertKind.NO_DATA.value}:",)) - named
    store.alerts.clear(sorted(gone), GONE)
    return store.alerts.raise_all(raised)


def _cause(source: str) -> str:
    return f"{AlertKind.NO_DATA.value}:{source}"


def _silent(plant: Plant, name: str, state: SourceState | None, last: datetime) -> Raised:
    valves = [valve for valve in plant.valves.values() if valve.source == name]
    why = f" ({state.fault})" if state is not None and state.fault else ""
    worst = max((valve.criticality for valve in valves), default=1)
    severity = AlertSeverity.HIGH if worst == 3 else AlertSeverity.MEDIUM
    return Raised(
        cause=_cause(name),
        kind=AlertKind.NO_DATA,
        severity=severity,
        text=(
            f"No good sample of {name} since {last:%Y-%m-%d %H:%M} UTC{why}; its {len(valves)} "
            "valves are not watched. Check the connection and the device."
        ),
        source=name,
        evidence={"valves": len(valves), "last_good": last.isoformat()},
    )
