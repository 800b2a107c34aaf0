"""One message of everything that is new, for each notifier, however many valves it is about."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from datetime import datetime
from typing import Any
from urllib.parse import urlencode
from zoneinfo import ZoneInfo

from stemwatch.service.config import Plant
from stemwatch.service.presenter.alert_history import S_since_raised, kind_words, opened_again
from stemwatch.service.presenter.wording import instant, window
from stemwatch.service.store.alerts.alerts import AlertSeverity, StoredAlert
from stemwatch.service.store.store import Store

_ORDER = list(AlertSeverity)
SHOWN = 50
_LONGEST_SUBJECT = 200
_TOLD_OF = ("formerly", "reopened")  # what an alert was before it is told of again


def queue_messages(store: Store, plant: Plant, *, run_id: int | None = None) -> bool:
    """Queue messages about the open alerts that are in no message yet; whether there were any."""
    alerts = store.deliveries.undelivered()
    if not alerts:
        return False
    messages: dict[str, dict[str, Any]] = {}
    for notifier in plant.notifiers.values():
        least = _ORDER.index(AlertSeverity(notifier.least_severity))
        severe_enough = [alert for alert in alerts if _ORDER.index(alert.severity) <= least]
        if severe_enough:
            messages[notifier.name] = message_of(
                severe_enough,
                plant.name,
                run_id,
                address=plant.service.address,
                zone=plant.zone or "UTC",
            )
    numbers = sorted(alert.id for alert in alerts)
    return store.deliveries.put(messages, _key(alerts), numbers)


def _key(alerts: Sequence[StoredAlert]) -> str:
    """The key of the message about ``alerts``; another one where an alert became more urgent or
    came back, which is sent again, and where a number was given out a second time."""
    told = sorted(
        (alert.id, alert.opened.isoformat(), *(len(alert.evidence.get(of, ())) for of in _TOLD_OF))
        for alert in alerts
    )
    digest = hashlib.sha256(repr(told).encode()).hexdigest()
    return f"alerts-{told[0][0]}-{told[-1][0]}-{digest[:12]}"


def message_of(
    alerts: Sequence[StoredAlert],
    plant: str,
    run_id: int | None,
    *,
    address: str = "",
    zone: str = "UTC",
) -> dict[str, Any]:
    """The message about ``alerts``: ``subject``, ``text``, and each alert as JSON.

    ``address`` is where people reach the pages; without it the message holds no links. Times are
    those of ``zone``, which is named.
    """
    plant_prefix = f"{plant}: " if plant else ""
    lines = [_line(alert, address, zone) for alert in alerts[:SHOWN]]
    if len(alerts) > SHOWN:
        lines.append(f"... and {len(alerts) - SHOWN} more, on the page of alerts.")
    if address:
        lines.append(f"Acknowledge, snooze or mark as false: {address.rstrip('/')}/alerts")
    return {
        "subject": _cut(f"{plant_prefix}{_in_short(alerts)}"),
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
                "first_step": alert.first_step,
                "link": _link(alert, address),
                "opened": alert.opened.isoformat(),
                "opened_again": None
                if alert.opened_again is None
                else alert.opened_again.isoformat(),
                "evidence": dict(alert.evidence),
            }
            for alert in alerts
        ],
    }


def _in_short(alerts: Sequence[StoredAlert]) -> str:
    """What a message is about: what one alert says first; of several the valves, in
    their order, and how many are old ones."""
    again = sum(alert.opened_again is not None for alert in alerts)
    if len(alerts) == 1:
        first = alerts[0].text.split(". ")[0].rstrip(".")
        return f"opened again: {first}" if again else first
    about = [alert.valve or alert.source or kind_words(alert.kind.value) for alert in alerts]
    names = ", ".join(dict.fromkeys(about))
    new = len(alerts) - again
    parts = [f"{count} {what}" for count, what in ((new, "new"), (again, "opened again")) if count]
    return f"{' and '.join(parts)} alerts: {names}"


def _line(alert: StoredAlert, address: str, zone: str) -> str:
    """The text of an alert, who acknowledged it, and the link to its page where there is one."""
    start, end = (
        None if moment is None else datetime.fromisoformat(moment)
        for moment in alert.evidence.get("window") or (None, None)
    )
    found = f"Found in the window {window(start, end, ZoneInfo(zone), zone)}." if end else ""
    first = f"First: {alert.first_step}" if alert.first_step else ""
    again = opened_again(alert.evidence, ZoneInfo(zone), zone)
    at_hand = f"Have at hand: {'; '.join(alert.parts)}." if alert.parts else ""
    since = S_since_raised(alert.evidence)
    parts = [alert.text, since, first, alert.then, at_hand, found, again]
    if alert.acknowledged is not None:
        comment = f": {alert.comment}" if alert.comment else ""
        by = alert.acknowledged_by or "somebody"
        when = instant(alert.acknowledged, ZoneInfo(zone))
        parts.append(f"Acknowledged {when} ({zone}) by {by}{comment}.")
    link = _link(alert, address)
    text = "\n".join(part for part in parts if part)
    return f"[{alert.severity.value}] {text}" + (f"\n{link}" if link else "")


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
