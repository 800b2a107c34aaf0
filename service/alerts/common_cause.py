"""Findings of several valves with a common cause: one alert for an area, a unit or a source."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from stemwatch.models.words import listed
from stemwatch.service.config import Plant
from stemwatch.service.store.alerts.alerts import AlertKind, AlertSeverity, RaisedAlert, to_do

COMMON = f"{AlertKind.COMMON.value}:"  # the causes of such alerts begin so
_NAMED = 12  # valves of a common alert that are listed


@dataclass(frozen=True)
class CommonCause:
    """A finding that valves of one area, unit or source share."""

    kind: AlertKind
    what: str  # "area", "unit" or "source"
    name: str

    @property
    def cause(self) -> str:
        """What makes two of its alerts the same."""
        return f"{COMMON}{self.kind.value}:{self.what}:{self.name}"


def common_causes(
    raised: Iterable[RaisedAlert], plant: Plant
) -> dict[CommonCause, list[RaisedAlert]]:
    """The causes that so many valves of a group share that it has one, with their alerts."""
    sizes: dict[tuple[str, str], int] = defaultdict(int)
    for valve in plant.valves.values():
        for group_key in _places(plant, valve.id):
            sizes[group_key] += 1
    groups: dict[CommonCause, list[RaisedAlert]] = defaultdict(list)
    for alert in raised:
        for group_kind, name in _places(plant, alert.valve or ""):
            groups[CommonCause(alert.kind, group_kind, name)].append(alert)
    rules = plant.alerts
    large = {
        group: alerts_of_group
        for group, alerts_of_group in groups.items()
        if len(alerts_of_group) >= rules.common_valves
        and len(alerts_of_group) >= rules.common_share * sizes[group.what, group.name]
        # Friction is individual to a valve. Many valves that name the same effect, or leave their
        # baselines together, point to what they share: air supply, signal, archive.
        and group.kind in (AlertKind.BASELINE, AlertKind.MISMATCH)
    }
    return _largest_first(large)


def _largest_first(
    groups: dict[CommonCause, list[RaisedAlert]],
) -> dict[CommonCause, list[RaisedAlert]]:
    """Each valve in one group only: an area and a source often hold the same valves."""
    used_causes: set[str] = set()
    chosen: dict[CommonCause, list[RaisedAlert]] = {}
    for group, alerts_of_group in sorted(
        groups.items(), key=lambda group: (-len(group[1]), group[0].cause)
    ):
        remaining = [alert for alert in alerts_of_group if alert.cause not in used_causes]
        if len(remaining) * 2 > len(alerts_of_group):
            chosen[group] = remaining
            used_causes.update(alert.cause for alert in remaining)
    return chosen


def _places(plant: Plant, valve: str) -> list[tuple[str, str]]:
    entry = plant.valves.get(valve)
    if entry is None:
        return []
    places = [("area", entry.area), ("unit", entry.unit), ("source", entry.source)]
    return [(what, name) for what, name in places if name]


def alert_of(group: CommonCause, alerts: Sequence[RaisedAlert], run_id: int) -> RaisedAlert:
    """The one alert instead of ``alerts``, as urgent as the worst of them."""
    names = [alert.valve or "" for alert in alerts]
    words = {
        AlertKind.BASELINE: "move differently from their baselines",
        AlertKind.MISMATCH: "show something beside stiction",
    }
    worst = min((alert.severity for alert in alerts), key=list(AlertSeverity).index)
    return RaisedAlert(
        cause=group.cause,
        kind=AlertKind.COMMON,
        severity=worst,
        text=(
            f"{len(names)} valves of {group.what} {group.name} {words[group.kind]} at once "
            f"({listed(names, _NAMED)})."
        ),
        run_id=run_id,
        evidence={
            "valves": names,
            "kind": group.kind.value,
            **to_do("Look for what they share: air supply, signal, archive."),
        },
    )


def causes_over(causes: set[str], seen: set[str], plant: Plant) -> set[str]:
    """Common causes that a run saw enough valves of to say that they are over, and those of areas,
    units and sources that the plant does not have any more."""
    ended: set[str] = set()
    for cause_over in causes:
        *_, group_kind, name = cause_over.split(":", 3)
        members = {
            v.id for v in plant.valves.values() if (group_kind, name) in _places(plant, v.id)
        }
        if not members or len(members & seen) * 2 > len(members):
            ended.add(cause_over)
    return ended
