"""The alerts of a store that are not closed, for tests."""

from __future__ import annotations

from datetime import UTC, datetime

from stemwatch.service.store.alerts.alerts import StoredAlert
from stemwatch.service.store.store import Store


def open_alerts(store: Store, valve: str | None = None) -> list[StoredAlert]:
    """Open alerts, also acknowledged and snoozed ones, without false alarms; newest first."""
    alerts = store.alerts.in_state("all", datetime.now(UTC), valve=valve)
    return [alert for alert in alerts if alert.closed is None and not alert.false_alarm]
