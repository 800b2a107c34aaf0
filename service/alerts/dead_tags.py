"""Tags without a good sample although their device answers: a broken transmitter, card or register.

One alert for each valve names its tags; one alert for the device stands for all where so many of
its valves are concerned that they share a cause. A device that is silent as a whole is reported by
``silent_sources``; a good signal that does not move is judged by the screening.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta

from stemwatch.models.words import listed
from stemwatch.service.config import Plant
from stemwatch.service.store.alerts.alerts import AlertKind, AlertSeverity, RaisedAlert, to_do
from stemwatch.service.store.storable import clean_text
from stemwatch.service.store.store import Store

VALVE, MANY = f"{AlertKind.NO_DATA.value}:valve:", f"{AlertKind.NO_DATA.value}:many:"
_LOOK_BACK = timedelta(days=1)  # how far the last good sample is looked for
_NAMED = 12  # valves of one alert that are listed


@dataclass(frozen=True, kw_only=True)
class DeadTag:
    """A tag of a valve without a good sample: which role it has, and its number in the store."""

    valve: str
    role: str
    tag: str
    number: int


def dead_tags(
    store: Store, plant: Plant, devices: Sequence[str], limit: timedelta, now: datetime
) -> dict[str, list[DeadTag]]:
    """The dead tags of each valve on ``devices``, which answer.

    A tag is dead where all its samples of the last ``limit`` are bad and one of them is recent:
    while old samples still arrive from the spool, nothing is known of the present. Raises
    ``StoreError``.
    """
    by_source: dict[str, list[DeadTag]] = defaultdict(list)
    for device in devices:
        dead = store.samples.dead_tags(device, limit, now)
        for valve in plant.valves.values() if dead else ():
            if valve.source != device:
                continue
            for role, tag in valve.tags.by_role().items():
                number = dead.get(clean_text(tag.tag))
                if number is not None:
                    dead_tag = DeadTag(valve=valve.id, role=role.value, tag=tag.tag, number=number)
                    by_source[valve.id].append(dead_tag)
    return dict(by_source)


def raised_of(
    store: Store,
    plant: Plant,
    dead: Mapping[str, Sequence[DeadTag]],
    already_open: set[str],
    now: datetime,
) -> list[RaisedAlert]:
    """An alert for each valve, or for its device where many valves share a cause. Reason and start
    are looked up for new alerts only."""
    by_device: dict[str, list[str]] = defaultdict(list)
    for valve in dead:
        by_device[plant.valves[valve].source].append(valve)
    raised: list[RaisedAlert] = []
    for device, valves in by_device.items():
        on_it = sum(valve.source == device for valve in plant.valves.values())
        rules = plant.alerts
        if len(valves) >= rules.common_valves and len(valves) >= rules.common_share * on_it:
            raised.append(_alert_of_device(plant, device, valves))
            continue
        for valve in valves:
            is_open = VALVE + valve in already_open
            reasons = {} if is_open else _reasons_of_tags(store, dead[valve], now)
            raised.append(_alert_of_valve(plant, valve, dead[valve], reasons))
    return raised


def _reasons_of_tags(store: Store, tags: Sequence[DeadTag], now: datetime) -> dict[str, str]:
    """For each tag since when it is dead, and what its newest sample says."""
    last_good = store.samples.last_good([tag.number for tag in tags], now - _LOOK_BACK)
    reason_of_tag: dict[str, str] = {}
    for tag in tags:
        good = last_good[tag.number]
        when = "for more than a day" if good.at is None else f"since {good.at:%Y-%m-%d %H:%M} UTC"
        reason_of_tag[tag.tag] = f"{when} ({good.reason})" if good.reason else when
    return reason_of_tag


def _alert_of_valve(
    plant: Plant, valve: str, tags: Sequence[DeadTag], reasons: Mapping[str, str]
) -> RaisedAlert:
    entry = plant.valves[valve]
    name = f"{valve} ({entry.description})" if entry.description else valve
    tag_list = "; ".join(
        f"{tag.role.upper()} {tag.tag} {reasons.get(tag.tag, '')}".strip() for tag in tags
    )
    return RaisedAlert(
        cause=VALVE + valve,
        kind=AlertKind.NO_DATA,
        severity=severity_without_data(entry.criticality),
        text=(
            f"{name}: no good sample of {tag_list}. {entry.source} answers, so it is the signal."
        ),
        valve=valve,
        source=entry.source,
        evidence={
            "tags": [tag.tag for tag in tags],
            **to_do("Look at the signal: its transmitter, its card, its register."),
        },
    )


def _alert_of_device(plant: Plant, device: str, valves: Sequence[str]) -> RaisedAlert:
    return RaisedAlert(
        cause=MANY + device,
        kind=AlertKind.NO_DATA,
        severity=severity_without_data(max(plant.valves[valve].criticality for valve in valves)),
        text=(
            f"{len(valves)} valves of {device} have signals without a good sample, while it "
            f"answers ({listed(valves, _NAMED)})."
        ),
        source=device,
        evidence={
            "valves": list(valves),
            **to_do("Look for what they share: a card, a gateway behind it, a range of registers."),
        },
    )


def severity_without_data(criticality: int) -> AlertSeverity:
    """How urgent it is that of a valve of this criticality nothing is known."""
    return AlertSeverity.HIGH if criticality == 3 else AlertSeverity.MEDIUM
