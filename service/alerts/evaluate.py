"""After a run: the rules are applied to each of its valves, and findings with a common cause joined
into one alert."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from zoneinfo import ZoneInfo

from stemwatch.models.history.evidence_over_windows import FRICTION_GONE
from stemwatch.service.alerts.after_maintenance import WRITER, note_fall, note_result_of_work
from stemwatch.service.alerts.one_per_cause import faded, one_per_cause, with_earlier_cause
from stemwatch.service.alerts.rules import RATIO, ValveRecord, apply_rules
from stemwatch.service.alerts.when_over import WINDOWS_BACK
from stemwatch.service.config import Plant
from stemwatch.service.presenter.evidence_of_weeks import EvidenceOfWeeks
from stemwatch.service.presenter.unexplained_fall import UnexplainedFall
from stemwatch.service.store.alerts.alerts import (
    JOINED,
    AlertKind,
    AlertSeverity,
    RaisedAlert,
    to_do,
)
from stemwatch.service.store.screenings.records import StoredValve
from stemwatch.service.store.store import Store

AT_ONCE = 250  # valves of one round of queries; times the depth, what one statement may name

_NAMED = 12  # valves of a common alert that are listed
_AT_ONCE = 500  # causes closed by one statement
CLEARED = "not found in the last runs any more"


def over_weeks(
    store: Store, run_id: int, valves: Sequence[str]
) -> dict[str, tuple[EvidenceOfWeeks, bool]]:
    """What the windows of weeks say together of those of ``valves`` on which an effect is followed,
    and whether what is confirmed stands among all valves of the run, as was marked when the run
    ended. Raises ``StoreError``."""
    confirmed = store.confirmed_in_run(run_id)
    evidence = store.evidence(valves)
    return {valve: (of_valve, valve in confirmed) for valve, of_valve in evidence.items()}


def gathered(
    store: Store,
    plant: Plant,
    valves: Sequence[str],
    by_window: Mapping[str, tuple[EvidenceOfWeeks, bool]] = MappingProxyType({}),
) -> Iterator[ValveRecord]:
    """What is known of each of ``valves``, in their order; ``by_window`` is that of ``over_weeks``.
    Raises ``StoreError``."""
    zone = ZoneInfo(plant.zone or "UTC")
    depth = max(max(plant.alerts.of_runs, plant.alerts.clear_after_runs) * 3, WINDOWS_BACK)
    for first in range(0, len(valves), AT_ONCE):
        part = valves[first : first + AT_ONCE]
        histories = store.recent(part, depth, RATIO)
        weeks, falls = store.trends_and_falls(part, plant.limits)
        for valve in part:
            recent = histories[valve]
            of_weeks, stands = by_window.get(valve, (None, False))
            yield ValveRecord(
                valve=_facts(plant, valve),
                screenings=recent.screenings,
                at_baseline=recent.at_baseline,
                ratios=recent.indicator,
                ratio_limit=plant.limits.baseline_ratio_watch,
                worked_at=recent.worked_at,
                by_window=of_weeks,
                stands=stands,
                weeks=weeks.get(valve),
                fall=_repair_seen(falls.get(valve), plant),
                sticky_limit=plant.limits.sticky_S_percent,
                zone=zone,
            )


def _repair_seen(fall: UnexplainedFall | None, plant: Plant) -> UnexplainedFall | None:
    """A fall that looks like a repair that nobody recorded: of a valve that was on watch at least,
    to half its S or less."""
    if fall is None or fall.before < plant.limits.watch_S_percent:
        return None
    return fall if fall.after <= FRICTION_GONE * fall.before else None


def awaiting_aftermath(store: Store, valves: Sequence[str]) -> list[str]:
    """Those of ``valves`` whose last maintenance no note compares with what followed yet."""
    waiting: list[str] = []
    for first in range(0, len(valves), AT_ONCE):
        waiting += store.work_without_note(valves[first : first + AT_ONCE], WRITER)
    return waiting


def _facts(plant: Plant, valve: str) -> StoredValve:
    entry = plant.valves.get(valve)
    if entry is None:
        return StoredValve(id=valve)
    return StoredValve.of(entry)


@dataclass(frozen=True)
class _Group:
    """Valves that may fail together: of one area, unit or source."""

    kind: AlertKind
    what: str  # "area", "unit" or "source"
    name: str

    @property
    def cause(self) -> str:
        return f"{AlertKind.COMMON.value}:{self.kind.value}:{self.what}:{self.name}"


def evaluate(store: Store, plant: Plant, run_id: int) -> list[int]:
    """Raise and close alerts by what ``run_id`` found; the numbers of the new ones.

    It uses stored results only, so that repeating it changes nothing. Valves are read some hundreds
    at a time. Raises ``StoreError``.
    """
    valves_done = store.queue.valves_done(run_id)
    open_before = store.alerts.open_causes()
    raised: list[RaisedAlert] = []
    ended: dict[str, str] = {}
    joined_now: list[str] = []
    for seen in gathered(store, plant, valves_done, over_weeks(store, run_id, valves_done)):
        raised_now, closed = apply_rules(seen, plant.alerts)
        of_valve, merged_causes = one_per_cause(
            raised_now, open_before - set(closed), faded(seen, plant.alerts)
        )
        raised += [with_earlier_cause(seen, alert) for alert in of_valve]
        renamed = {former for alert in of_valve for former in alert.formerly}
        joined_now += [cause for cause in merged_causes if cause in open_before - renamed]
        why = CLEARED if seen.fall is None else f"{CLEARED}: {seen.fall.sentence}"
        ended |= {cause: why for cause in closed if cause in open_before}
        if seen.fall is not None:
            note_fall(store, seen.valve.id, seen.fall)
    for valve in awaiting_aftermath(store, valves_done):
        note_result_of_work(store, valve, ZoneInfo(plant.zone or "UTC"))
    groups = _groups(raised, plant)
    common = [_common(group, alerts, run_id) for group, alerts in groups.items()]
    causes_now = {alert.cause for alert in common}
    causes_before = {
        cause for cause in open_before if cause.startswith(AlertKind.COMMON.value + ":")
    }
    common_ended = _ended_causes(causes_before - causes_now, set(valves_done), plant)
    ended |= dict.fromkeys(sorted(common_ended), CLEARED)
    in_common = {alert.cause for group in groups.values() for alert in group}
    joined_now += [
        cause for alert in raised if alert.cause in in_common for cause in alert.formerly
    ]
    for why in dict.fromkeys(ended.values()):
        over = [cause for cause, reason in ended.items() if reason == why]
        for first in range(0, len(over), _AT_ONCE):
            store.alerts.clear(over[first : first + _AT_ONCE], why)
    for first in range(0, len(joined_now), _AT_ONCE):
        store.alerts.clear(joined_now[first : first + _AT_ONCE], JOINED)
    # An alert that is now part of a common cause is reported once, by the common alert.
    new = [alert for alert in raised if alert.cause not in in_common]
    return store.alerts.raise_all([*common, *new])


def _groups(raised: Iterable[RaisedAlert], plant: Plant) -> dict[_Group, list[RaisedAlert]]:
    """The groups of which so many valves have the same finding that it has one cause."""
    sizes: dict[tuple[str, str], int] = defaultdict(int)
    for valve in plant.valves.values():
        for group_key in _places(plant, valve.id):
            sizes[group_key] += 1
    groups: dict[_Group, list[RaisedAlert]] = defaultdict(list)
    for alert in raised:
        for group_kind, name in _places(plant, alert.valve or ""):
            groups[_Group(alert.kind, group_kind, name)].append(alert)
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


def _largest_first(groups: dict[_Group, list[RaisedAlert]]) -> dict[_Group, list[RaisedAlert]]:
    """Each valve in one group only: an area and a source often hold the same valves."""
    used_causes: set[str] = set()
    chosen: dict[_Group, list[RaisedAlert]] = {}
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


def _common(group: _Group, alerts: Sequence[RaisedAlert], run_id: int) -> RaisedAlert:
    names = [alert.valve or "" for alert in alerts]
    name_list = ", ".join(names[:_NAMED])
    and_more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
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
            f"({name_list}{and_more})."
        ),
        run_id=run_id,
        evidence={
            "valves": names,
            "kind": group.kind.value,
            **to_do("Look for what they share: air supply, signal, archive."),
        },
    )


def _ended_causes(causes: set[str], seen: set[str], plant: Plant) -> set[str]:
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
