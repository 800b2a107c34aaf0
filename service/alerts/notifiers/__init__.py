"""Ways to send a message: mail, webhook, file, and those of other packages.

They are found through the entry point group ``stemwatch.notifiers``; ``notifiers_of`` makes those
of a plant.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib.metadata import entry_points

from stemwatch.connectors.secret import Secret
from stemwatch.service.alerts.notifiers.notifier import Notifier as Notifier
from stemwatch.service.alerts.notifiers.notifier import NotifierKind as NotifierKind
from stemwatch.service.alerts.notifiers.notifier import NotSent as NotSent
from stemwatch.service.config import Plant
from stemwatch.service.config.service_schema import NOTIFIERS, NotifierTable


def notifiers_of(plant: Plant) -> Mapping[str, Notifier]:
    """A notifier for each ``[[notifiers]]`` of the plant file, by name."""
    return {name: _notifier(table, plant) for name, table in plant.notifiers.items()}


def _notifier(table: NotifierTable, plant: Plant) -> Notifier:
    file = "" if table.secret_file is None else str(plant.beside(table.secret_file))
    secret = Secret(variable=table.secret_variable or "", file=file)
    (point,) = entry_points(group=NOTIFIERS, name=table.kind)  # the plant file was checked for it
    kind: NotifierKind = point.load()
    return kind.from_table(table, secret, plant.beside("."))
