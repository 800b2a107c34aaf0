"""``Sender``: hands queued messages to their notifiers, repeatedly until they arrive."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from datetime import UTC, datetime, timedelta

from stemwatch.connectors.secret import masked
from stemwatch.service.alerts.notifiers.notifier import Notifier, NotSent
from stemwatch.service.store.alerts.deliveries import LONGEST_WAIT, StoredDelivery
from stemwatch.service.store.store import Store

log = logging.getLogger(__name__)

FIRST_WAIT = timedelta(minutes=1)
GIVE_UP_AFTER = timedelta(days=3)
# More than one attempt, since the clock may have jumped or the service been off for a week.
FEWEST_ATTEMPTS = 24


class Sender:
    """Sends what waits in ``store`` through ``notifiers`` by their names."""

    def __init__(self, store: Store, notifiers: Mapping[str, Notifier]) -> None:
        self._store, self._notifiers = store, notifiers

    def send_due(self) -> int:
        """Send what is due; returns how many messages arrived. After a failure the other messages
        of that notifier wait for the next time: a receiver that hangs would delay those of all
        others."""
        arrived = 0
        failed: set[str] = set()
        while (delivery := self._store.deliveries.claim(except_notifiers=failed)) is not None:
            if self._send(delivery):
                arrived += 1
            else:
                failed.add(delivery.notifier)
        return arrived

    def _send(self, delivery: StoredDelivery) -> bool:
        notifier = self._notifiers.get(delivery.notifier)
        if notifier is None:
            error = "the plant file does not name this notifier (any more)"
            self._store.deliveries.failed(delivery.id, error, None)
            return False
        try:
            notifier.send(delivery.key, delivery.message)
        except Exception as error:  # whatever a notifier raises, the message did not arrive
            self._failed(delivery, error)
            return False
        self._store.deliveries.sent(delivery.id)
        log_fields = {"notifier": delivery.notifier}
        log.info("message %s was taken by %s", delivery.key, delivery.notifier, extra=log_fields)
        return True

    def _failed(self, delivery: StoredDelivery, error: Exception) -> None:
        words = str(error) if isinstance(error, NotSent) else f"{type(error).__name__}: {error}"
        words = masked(" ".join(words.split()))[:500]
        now, log_fields = datetime.now(UTC), {"notifier": delivery.notifier}
        final = isinstance(error, NotSent) and error.final
        tried_enough = delivery.attempts >= FEWEST_ATTEMPTS
        if final or (tried_enough and now - delivery.created > GIVE_UP_AFTER):
            text = "message %s for %s is given up: %s"
            log.error(text, delivery.key, delivery.notifier, words, extra=log_fields)
            self._store.deliveries.failed(delivery.id, words, None)
            return
        log.warning(
            "message %s for %s: %s", delivery.key, delivery.notifier, words, extra=log_fields
        )
        self._store.deliveries.failed(delivery.id, words, now + wait_after(delivery.attempts))


def wait_after(attempts: int) -> timedelta:
    """How long until the next attempt after so many: doubled each time, up to an hour."""
    return min(FIRST_WAIT * (1 << min(max(attempts - 1, 0), 12)), LONGEST_WAIT)
