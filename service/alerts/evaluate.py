"""After a run: the rules are applied to each of its valves, and findings with a common cause joined
into one alert."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from zoneinfo import ZoneInfo

from stemwatch.models.history.evidence_over_windows import FRICTION_GONE
from stemwatch.models.history.fall_of_stiction import UnexplainedFall
from stemwatch.service.alerts.after_maintenance import WRITER, note_fall, note_result_of_work
from stemwatch.service.alerts.common_cause import COMMON, alert_of, causes_over, common_causes
from stemwatch.service.alerts.one_per_cause import faded, one_per_cause, with_earlier_cause
from stemwatch.service.alerts.rules import RATIO, ValveRecord, apply_rules, cause
from stemwatch.service.alerts.when_over import WINDOWS_BACK
from stemwatch.service.config import Plant
from stemwatch.service.presenter.evidence_of_weeks import EvidenceOfWeeks
from stemwatch.service.store.alerts.alerts import JOINED, AlertKind, RaisedAlert
from stemwatch.service.store.screenings.records import StoredValve
from stemwatch.service.store.store import Store

VALVES_AT_ONCE = 250  # of one round of queries; times the depth, what one statement may name
CAUSES_AT_ONCE = 500  # closed by one statement
_ABOUT_A_VALVE = tuple(
    cause(kind, "") for kind in AlertKind if kind not in (AlertKind.NO_DATA, AlertKind.COMMON)
)
GONE = "the plant file does not name this valve any more"
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
    for first in range(0, len(valves), VALVES_AT_ONCE):
        part = valves[first : first + VALVES_AT_ONCE]
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
    for first in range(0, len(valves), VALVES_AT_ONCE):
        waiting += store.work_without_note(valves[first : first + VALVES_AT_ONCE], WRITER)
    return waiting


def _facts(plant: Plant, valve: str) -> StoredValve:
    entry = plant.valves.get(valve)
    if entry is None:
        return StoredValve(id=valve)
    return StoredValve.of(entry)


@dataclass(kw_only=True)
class _AlertChanges:
    """What the rules say of the valves of a run: alerts to raise, which open causes are over and
    why, and those that another alert speaks for now."""

    raised: list[RaisedAlert] = field(default_factory=list)
    ended: dict[str, str] = field(default_factory=dict)
    joined: list[str] = field(default_factory=list)


def evaluate(store: Store, plant: Plant, run_id: int) -> list[int]:
    """Raise and close alerts by what ``run_id`` found; the numbers of the new ones.

    It uses stored results only, so that repeating it changes nothing. Valves are read some hundreds
    at a time. Raises ``StoreError``.
    """
    valves_done = store.queue.valves_done(run_id)
    open_before = store.alerts.open_causes()
    found = _by_rules(store, plant, run_id, valves_done, open_before)
    for valve in awaiting_aftermath(store, valves_done):
        note_result_of_work(store, valve, ZoneInfo(plant.zone or "UTC"))
    groups = common_causes(found.raised, plant)
    common = [alert_of(group, alerts, run_id) for group, alerts in groups.items()]
    common_before = {cause for cause in open_before if cause.startswith(COMMON)}
    not_again = common_before - {alert.cause for alert in common}
    common_over = causes_over(not_again, set(valves_done), plant)
    gone = _of_valves_gone(open_before, plant)
    _clear(
        store,
        found.ended | dict.fromkeys(sorted(common_over), CLEARED) | dict.fromkeys(gone, GONE),
    )
    # An alert that is now part of a common cause is reported once, by the common alert.
    in_common = {alert.cause for group in groups.values() for alert in group}
    joined = [
        cause for alert in found.raised if alert.cause in in_common for cause in alert.formerly
    ]
    _clear(store, dict.fromkeys([*found.joined, *joined], JOINED))
    new = [alert for alert in found.raised if alert.cause not in in_common]
    return store.alerts.raise_all([*common, *new])


def _of_valves_gone(open_before: Collection[str], plant: Plant) -> list[str]:
    """The open causes about valves that the plant file does not name any more: no run would ever
    close them."""
    valve_of = {
        about: about.partition(":")[2] for about in open_before if about.startswith(_ABOUT_A_VALVE)
    }
    gone = plant.not_named(valve_of.values())
    return sorted(about for about, valve in valve_of.items() if valve in gone)


def _by_rules(
    store: Store, plant: Plant, run_id: int, valves: Sequence[str], open_before: set[str]
) -> _AlertChanges:
    """Apply the rules to each of ``valves``; a fall of S without recorded work gets a note."""
    found = _AlertChanges()
    for seen in gathered(store, plant, valves, over_weeks(store, run_id, valves)):
        raised_now, closed = apply_rules(seen, plant.alerts)
        of_valve, merged_causes = one_per_cause(
            raised_now, open_before - set(closed), faded(seen, plant.alerts)
        )
        found.raised += [with_earlier_cause(seen, alert) for alert in of_valve]
        renamed = {former for alert in of_valve for former in alert.formerly}
        found.joined += [cause for cause in merged_causes if cause in open_before - renamed]
        why = CLEARED if seen.fall is None else f"{CLEARED}: {seen.fall.sentence}"
        found.ended |= {cause: why for cause in closed if cause in open_before}
        if seen.fall is not None:
            note_fall(store, seen.valve.id, seen.fall)
    return found


def _clear(store: Store, over: Mapping[str, str]) -> None:
    """Close the alerts of these causes, each with the reason beside it."""
    for why in dict.fromkeys(over.values()):
        causes = [cause for cause, reason in over.items() if reason == why]
        for first in range(0, len(causes), CAUSES_AT_ONCE):
            store.alerts.clear(causes[first : first + CAUSES_AT_ONCE], why)
