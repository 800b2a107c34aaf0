"""Which connectors are installed: those that the entry point group ``stemwatch.connectors`` names.

The name of an entry point is the ``kind`` that a ``[[sources]]`` table gives; what it names is the
connector's class. Ours are found in the same way as those of other packages.
"""

from __future__ import annotations

from importlib.metadata import EntryPoint, entry_points

from stemwatch.connectors.connector import ConnectorError
from stemwatch.connectors.settings import SourceSettings

GROUP = "stemwatch.connectors"


def installed_connectors() -> dict[str, tuple[EntryPoint, ...]]:
    """The entry points of each installed kind, sorted by kind; more than one where several packages
    claim it.
    """
    by_name: dict[str, dict[str, EntryPoint]] = {}
    for point in entry_points(group=GROUP):
        by_name.setdefault(point.name, {})[point.value] = point
    return {name: tuple(points.values()) for name, points in sorted(by_name.items())}


def settings_of(kind: str) -> type[SourceSettings] | None:
    """The model of ``[[sources]]`` tables of ``kind``; ``None`` where no connector is installed
    for it.

    Raises ``ConnectorError`` where the connector cannot be loaded, has no ``settings``, or where
    several packages claim the kind.
    """
    points = installed_connectors().get(kind, ())
    if not points:
        return None
    if len(points) > 1:
        claims = ", ".join(f"{point.value} of {_package(point)}" for point in points)
        raise ConnectorError(f"several connectors claim the kind {kind!r}: {claims}; remove one")
    (point,) = points
    try:
        connector = point.load()
    except Exception as error:  # another package's code may raise anything
        raise ConnectorError(
            f"the connector for kind {kind!r}, {point.value} of {_package(point)}, cannot be "
            f"loaded ({type(error).__name__}: {error}); install that package again"
        ) from error
    settings = getattr(connector, "settings", None)
    if not (isinstance(settings, type) and issubclass(settings, SourceSettings)):
        raise ConnectorError(
            f"the connector for kind {kind!r}, {point.value} of {_package(point)}, does not say "
            "what its table looks like; expected a class attribute settings, a subclass of "
            "stemwatch.connectors.archive.settings.ArchiveSettings"
        )
    return settings


def _package(point: EntryPoint) -> str:
    """The name of the package that an entry point comes from, for a message."""
    return point.dist.name if point.dist is not None else "an unnamed package"
