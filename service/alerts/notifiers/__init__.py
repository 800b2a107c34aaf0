"""The ways a message takes: mail, webhook, file. ``notifiers_of`` makes those of a plant."""

from __future__ import annotations

from collections.abc import Mapping

from stemwatch.service.alerts.notifiers.file import FileNotifier
from stemwatch.service.alerts.notifiers.mail import MailNotifier
from stemwatch.service.alerts.notifiers.notifier import Notifier as Notifier
from stemwatch.service.alerts.notifiers.notifier import NotSent as NotSent
from stemwatch.service.alerts.notifiers.secret import NotifierSecret
from stemwatch.service.alerts.notifiers.webhook import WebhookNotifier
from stemwatch.service.config import Plant
from stemwatch.service.config.service_schema import NotifierTable


def notifiers_of(plant: Plant) -> Mapping[str, Notifier]:
    """A notifier for each ``[[notifiers]]`` of the plant file, by name."""
    return {name: _notifier(table, plant) for name, table in plant.notifiers.items()}


def _notifier(table: NotifierTable, plant: Plant) -> Notifier:
    file = None if table.secret_file is None else plant.beside(table.secret_file)
    secret = NotifierSecret(variable=table.secret_variable, file=file)
    if table.kind == "mail":
        return MailNotifier(
            host=table.host or "",
            port=table.port,
            security=table.security,
            user=table.user,
            secret=secret,
            sender=table.sender or "",
            to=tuple(table.to),
        )
    if table.kind == "webhook":
        return WebhookNotifier(
            url=table.url or "", secret=secret, allow_private=table.allow_private
        )
    return FileNotifier(plant.beside(table.path or ""))
