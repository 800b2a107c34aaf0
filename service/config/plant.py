"""``Plant``: the contents of a plant file, as the rest of the service uses them."""

from __future__ import annotations

import glob
import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stemwatch.connectors.archive.settings import ArchiveSettings
from stemwatch.connectors.connector import ArchiveAddress, TagMapping, ValveTags
from stemwatch.connectors.historian.connector import TextExportSettings
from stemwatch.connectors.settings import Problem
from stemwatch.models.limits import Limits
from stemwatch.service.config.schema import Tag, Valve
from stemwatch.service.config.service_schema import AlertRules, NotifierTable, ServiceSection
from stemwatch.service.store.database_url import DatabaseUrl
from stemwatch.service.store.runs.schedule import ScreeningSchedule

if TYPE_CHECKING:
    from stemwatch.connectors.modbus.device import Device


@dataclass(frozen=True, kw_only=True)
class Plant:
    """The plant as its file describes it.

    ``sources`` and ``valves`` hold the correct entries; a wrong one is left out and described in
    ``problems``. ``zone`` is the time zone of reports, and of every source that does not name its
    own. A valve's source is one of ``sources``, ``archives`` or ``devices``.
    """

    file: Path
    name: str
    zone: str | None
    sources: Mapping[str, TextExportSettings]
    valves: Mapping[str, Valve]
    limits: Limits
    storage: DatabaseUrl
    problems: tuple[Problem, ...] = ()
    devices: Mapping[str, Device] = field(default_factory=dict)
    archives: Mapping[str, ArchiveSettings] = field(default_factory=dict)
    schedules: tuple[ScreeningSchedule, ...] = ()
    notifiers: Mapping[str, NotifierTable] = field(default_factory=dict)
    alerts: AlertRules = field(default_factory=AlertRules)
    named_limits: frozenset[str] = frozenset()  # named in the file, whatever their value
    service: ServiceSection = field(default_factory=ServiceSection)
    currency: str = ""

    def is_live(self, valve: str | Valve) -> bool:
        """Whether a valve's samples are collected in the store, rather than read from files."""
        source = self._valve(valve).source
        if source in self.archives:
            return False
        return source in self.devices or self.sources[source].folder is not None

    def archive_of(self, valve: str | Valve) -> ArchiveAddress | None:
        """The address of the archive of a valve; ``None`` for files and live sources."""
        archive = self.archives.get(self._valve(valve).source)
        return None if archive is None else archive.address(self.file.parent, self.zone)

    def beside(self, name: str) -> Path:
        """The path ``name``, relative to the folder of the plant file."""
        return self.file.parent / name

    def not_named(self, valves: Iterable[str]) -> set[str]:
        """Those of ``valves`` that the file does not name (any more): removed, or renamed. None
        where the file has mistakes, since a valve may be missing for one of them."""
        return set() if self.problems else set(valves) - self.valves.keys()

    def valve_tags(self, valve: str | Valve) -> ValveTags:
        """The valve's tags as a connector needs them. Raises ``KeyError`` for an unknown valve."""
        entry = self._valve(valve)
        tags = {role: _mapping(tag) for role, tag in entry.tags.by_role().items()}
        return ValveTags(valve=entry.id, tags=tags)

    def source_of(self, valve: str | Valve) -> TextExportSettings:
        """The source of text exports of a valve. Raises ``KeyError`` where it has another kind."""
        return self.sources[self._valve(valve).source]

    def source_files(self, source: str | TextExportSettings) -> tuple[Path, ...]:
        """The files that a source's path or pattern matches now, sorted by name; none for a watched
        folder, whose files go into the store."""
        path = self._source(source).path
        if path is None:
            return ()
        if self.beside(path).is_file():  # a bracket in a name would be a pattern
            return (self.beside(path),)
        pattern = Path(glob.escape(str(self.file.parent))) / path
        paths = (Path(name) for name in glob.glob(str(pattern), recursive=True))
        return tuple(sorted(path for path in paths if path.is_file()))

    def read_options(self, source: str | TextExportSettings) -> dict[str, Any]:
        """The reading options of a source by name; the plant's zone where it names none."""
        options = self._source(source).read_options()
        return options if self.zone is None else {"zone": self.zone} | options

    @property
    def settings_digest(self) -> str:
        """SHA-256 of all settings that can change a verdict: limits, sources, tags; without the
        store's address, descriptions and criticalities."""
        settings = {
            "zone": self.zone,
            "limits": asdict(self.limits),
            "sources": [
                source.model_dump(exclude={"kind"}) for _, source in sorted(self.sources.items())
            ],
            "valves": {valve.id: verdict_settings(valve) for valve in self.valves.values()},
            **self._archive_settings(),
            **(
                {"devices": {name: repr(device) for name, device in sorted(self.devices.items())}}
                if self.devices
                else {}
            ),
        }
        text = json.dumps(settings, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()

    def _archive_settings(self) -> dict[str, Any]:
        """The settings of archives that can change a verdict; no key without archives, so that
        digests of such plants are those of earlier versions."""
        dumps = [
            archive.model_dump(exclude={"url", "user", "secret_variable", "secret_file"})
            for _, archive in sorted(self.archives.items())
        ]
        return {"archives": dumps} if dumps else {}

    def _valve(self, valve: str | Valve) -> Valve:
        return self.valves[valve] if isinstance(valve, str) else valve

    def _source(self, source: str | TextExportSettings) -> TextExportSettings:
        return self.sources[source] if isinstance(source, str) else source


def _mapping(tag: Tag) -> TagMapping:
    return TagMapping(
        tag=tag.tag, unit=tag.unit, low=tag.low, high=tag.high, deviation=tag.deviation
    )


def verdict_settings(valve: Valve) -> dict[str, Any]:
    """What of a valve's settings can change its verdict."""
    later = {"stroke_curve", "target_band"}  # left out where not given: keeps earlier digests
    settings = valve.model_dump(include={"source", "tags"})
    for tag in filter(None, settings["tags"].values()):
        if tag["deviation"] is None:  # a later key as well
            del tag["deviation"]
    return {
        **settings,
        **valve.model_dump(include=later, exclude_none=True),
    }
