"""One message of everything that is new, for each notifier, however many valves it is about."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any
from urllib.parse import urlencode

from stemwatch.service.config import Plant
from stemwatch.service.store.alerts.alerts import AlertSeverity, StoredAlert
from stemwatch.service.store.store import Store

_ORDER = list(AlertSeverity)
SHOWN = 50
_LONGEST_SUBJECT = 200


def queue_messages(store: Store, plant: Plant, *, run_id: int | None = None) -> bool:
    """Queue messages about the open alerts that are in no message yet; whether there were any."""
    alerts = sorted(store.deliveries.untold(), key=lambda alert: _ORDER.index(alert.severity))
    if not alerts:
        return False
    messages: dict[str, dict[str, Any]] = {}
    for notifier in plant.notifiers.values():
        least = _ORDER.index(AlertSeverity(notifier.least_severity))
        severe_enough = [alert for alert in alerts if _ORDER.index(alert.severity) <= least]
        if severe_enough:
            messages[notifier.name] = message_of(
                severe_enough, plant.name, run_id, plant.service.address
            )
    numbers = sorted(alert.id for alert in alerts)
    key = f"alerts-{numbers[0]}-{numbers[-1]}-{len(numbers)}"
    # An alert that became more urgent is sent again, in another message.
    if again := sum(len(alert.evidence.get("formerly", ())) for alert in alerts):
        key += f"-{again}"
    return store.deliveries.put(messages, key, numbers)


def message_of(
    alerts: Sequence[StoredAlert], plant: str, run_id: int | None, address: str = ""
) -> dict[str, Any]:
    """The message about ``alerts``: ``subject``, ``text``, and each alert as JSON.

    ``address`` is where people reach the pages; without it the message holds no links.
    """
    plant_prefix = f"{plant}: " if plant else ""
    first = alerts[0].text.split(". ")[0]
    count_text = f"{len(alerts)} new alerts, the first: " if len(alerts) > 1 else ""
    lines = [_line(alert, address) for alert in alerts[:SHOWN]]
    if len(alerts) > SHOWN:
        lines.append(f"... and {len(alerts) - SHOWN} more, on the page of alerts.")
    if address:
        lines.append(f"Acknowledge, snooze or mark as false: {address.rstrip('/')}/alerts")
    return {
        "subject": _cut(f"{plant_prefix}{count_text}{first}"),
        "text": "\n\n".join(lines) + "\n",
        "plant": plant,
        "run": run_id,
        "alerts": [
            {
                "id": alert.id,
                "kind": alert.kind.value,
                "severity": alert.severity.value,
                "valve": alert.valve,
                "source": alert.source,
                "text": alert.text,
                "link": _link(alert, address),
                "opened": alert.opened.isoformat(),
                "evidence": dict(alert.evidence),
            }
            for alert in alerts
        ],
    }


def _line(alert: StoredAlert, address: str) -> str:
    """The text of an alert, with the link to its page where there is one."""
    link = _link(alert, address)
    return f"[{alert.severity.value}] {alert.text}" + (f"\n{link}" if link else "")


def _link(alert: StoredAlert, address: str) -> str:
    """The page of the alert's valve; empty without an address or without a valve."""
    if not address or not alert.valve:
        return ""
    return f"{address.rstrip('/')}/valve?{urlencode({'id': alert.valve})}"


def _cut(subject: str) -> str:
    """At most ``_LONGEST_SUBJECT`` letters, cut between words."""
    if len(subject) <= _LONGEST_SUBJECT:
        return subject
    head, _, _ = subject[:_LONGEST_SUBJECT].rpartition(" ")
    return f"{head or subject[: _LONGEST_SUBJECT - 2]} \N{HORIZONTAL ELLIPSIS}"
