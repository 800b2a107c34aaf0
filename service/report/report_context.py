"""What a report needs beside its screenings: the plant, the run, facts of each valve."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime, tzinfo
from types import MappingProxyType
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

from stemwatch.models.history.trend_over_weeks import TrendOverWeeks
from stemwatch.models.oscillation_groups.plant_groups import OscillationGroup
from stemwatch.models.screening_result import PreviousFinding
from stemwatch.service import __version__
from stemwatch.service.plant_path import PlantPath
from stemwatch.service.presenter.cost_of_sticking import Prices, RankBy
from stemwatch.service.presenter.evidence_of_weeks import EvidenceOfWeeks
from stemwatch.service.report.charts.suspicion_pictures import ShownSuspicion


def software_name() -> str:
    """Name and version of the software that is running."""
    return f"stemwatch {__version__}"


@dataclass(frozen=True, kw_only=True)
class ValveFacts(PlantPath):
    """What is known of a valve: its service, its place in the plant, its criticality.

    ``stroke`` is its full travel with the unit, such as "40 mm"; empty where it is not known.
    ``previous`` is what was said of it before, ``weeks`` how its S changes, ``by_window`` what its
    windows of the last weeks say together of effects beside friction, ``earlier_suspicion`` what
    shows best that it may stick, where its latest window shows little by itself, ``prices`` what a
    deviation of its loop costs.
    """

    description: str = ""
    criticality: str = ""
    stroke: str = ""
    previous: PreviousFinding | None = None
    weeks: TrendOverWeeks | None = None
    by_window: EvidenceOfWeeks | None = None
    earlier_suspicion: ShownSuspicion | None = None
    prices: Prices | None = None


@dataclass(frozen=True, kw_only=True)
class SourceNotRead:
    """A source that gave no screening at all, and why."""

    source: str
    reason: str


_UNKNOWN_VALVE = ValveFacts()


@dataclass(frozen=True, kw_only=True)
class ReportContext:
    """The run and the plant. ``zone`` is the IANA name in which times are shown.

    ``valves`` is keyed by ``Screening.valve``. A report of a part of a run has in ``p_elsewhere``
    the ``Mismatch.p_value`` of every other valve that was tested (``None`` where nothing was
    named), so that what stands is decided over the whole run. ``work_files`` are the names of the
    files for maintenance that lie beside the report, with what each is. ``groups`` are the loops of
    the whole run that oscillate together. ``rank_by`` is the order of the valves: worst first, or
    what costs most first and the others after it.

    Raises ``ValueError`` on a naive ``started`` or a zone that the time zone database does not
    have.
    """

    started: datetime
    title: str = "Control valve stiction"
    plant: str = ""
    zone: str = "UTC"
    software: str = field(default_factory=software_name)
    command: str = ""
    settings_digest: str = ""
    valves: Mapping[str, ValveFacts] = field(default_factory=dict)
    sources_not_read: tuple[SourceNotRead, ...] = ()
    outside_window: str = ""  # how many recordings were left out for the window, one sentence
    p_elsewhere: tuple[float | None, ...] = ()
    work_files: Mapping[str, str] = field(default_factory=dict)
    groups: tuple[OscillationGroup, ...] = ()
    currency: str = ""
    rank_by: RankBy = RankBy.VERDICT

    def __post_init__(self) -> None:
        if self.started.tzinfo is None:
            raise ValueError(f"started must be timezone aware, received {self.started}")
        try:
            ZoneInfo(self.zone)
        except (ZoneInfoNotFoundError, ValueError) as error:
            raise ValueError(
                f"zone {self.zone!r} is not in the time zone database; "
                "expected an IANA name such as 'UTC' or 'Europe/Berlin'"
            ) from error
        object.__setattr__(self, "valves", MappingProxyType(dict(self.valves)))
        object.__setattr__(self, "work_files", MappingProxyType(dict(self.work_files)))

    @property
    def tz(self) -> tzinfo:
        """The zone in which times are shown."""
        return ZoneInfo(self.zone)

    def facts(self, valve: str) -> ValveFacts:
        """The facts of ``valve``; empty ones where the plant gave none."""
        return self.valves.get(valve, _UNKNOWN_VALVE)
