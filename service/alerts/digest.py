"""One message of everything that is new, for each notifier, however many valves it is about."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from stemwatch.service.plantfile import Plant
from stemwatch.service.store.alerts import AlertSeverity, StoredAlert
from stemwatch.service.store.store import Store

_ORDER = list(AlertSeverity)
SHOWN = 50


def tell(store: Store, plant: Plant, *, run_id: int | None = None) -> bool:
    """Queue messages about the open alerts that nobody was told of; whether there were any."""
    alerts = sorted(store.deliveries.untold(), key=lambda one: _ORDER.index(one.severity))
    if not alerts:
        return False
    messages: dict[str, dict[str, Any]] = {}
    for notifier in plant.notifiers.values():
        least = _ORDER.index(AlertSeverity(notifier.least_severity))
        wanted = [one for one in alerts if _ORDER.index(one.severity) <= least]
        if wanted:
            messages[notifier.name] = message_of(wanted, plant.name, run_id)
    numbers = sorted(one.id for one in alerts)
    key = f"alerts-{numbers[0]}-{numbers[-1]}-{len(numbers)}"
    return store.deliveries.put(messages, key, numbers)


def message_of(alerts: Sequence[StoredAlert], plant: str, run_id: int | None) -> dict[str, Any]:
    """The message about ``alerts``: ``subject``, ``text``, and each alert as JSON."""
    where = f"{plant}: " if plant else ""
    first = alerts[0].text.split(". ")[0]
    many = f"{len(alerts)} new alerts, the first: " if len(alerts) > 1 else ""
    lines = [f"[{one.severity.value}] {one.text}" for one in alerts[:SHOWN]]
    if len(alerts) > SHOWN:
        lines.append(f"... and {len(alerts) - SHOWN} more, on the page of alerts.")
    return {
        "subject": f"{where}{many}{first}"[:200],
        "text": "\n\n".join(lines) + "\n",
        "plant": plant,
        "run": run_id,
        "alerts": [
            {
                "id": one.id,
                "kind": one.kind.value,
                "severity": one.severity.value,
                "valve": one.valve,
                "source": one.source,
                "text": one.text,
                "opened": one.opened.isoformat(),
                "evidence": dict(one.evidence),
            }
            for one in alerts
        ],
    }
