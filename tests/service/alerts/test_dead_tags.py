"""A tag that is dead while its device answers: one alert for its valve, one for the device where
many are dead, none where the device itself is silent."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from stemwatch.connectors.modbus.sample_batch import SampleBatch
from stemwatch.models.recording import Quality
from stemwatch.service.alerts.silent_sources import BACK, JOINED, watch_sources
from stemwatch.service.config import Plant
from stemwatch.service.store.alerts.alerts import AlertKind, StoredAlert
from stemwatch.service.store.samples.sources import SourceState
from stemwatch.service.store.samples.tables import microseconds
from stemwatch.service.store.store import Store
from tests.service.alerts.conftest import plant_of
from tests.service.open_alerts import open_alerts

NOW = datetime(2026, 3, 2, 12, tzinfo=UTC)
LONG_AGO = NOW - timedelta(days=1)
WHY = "exception 2 (illegal data address)"
VALVES = 12


@pytest.fixture
def plant(tmp_path: Path) -> Plant:
    """Twelve valves of one device, each with OP and MV; told after five minutes."""
    text = "[alerts]\nsilent_after_s = 300\n"
    text += '[[devices]]\nname = "plc"\nhost = "192.0.2.1"\nbyte_order = "ABCD"\n'
    for n in range(VALVES):
        for index, role in enumerate(("OP", "ZT")):
            text += f'[[devices.registers]]\ntag = "V{n}.{role}"\nregister = "holding"\n'
            text += f'address = {4 * n + 2 * index}\ntype = "FLOAT32"\n'
    for n in range(VALVES):
        text += f'[[valves]]\nid = "V{n}"\ndescription = "Feed {n}"\nsource = "plc"\n'
        text += f'[valves.tags.op]\ntag = "V{n}.OP"\n[valves.tags.mv]\ntag = "V{n}.ZT"\n'
    return plant_of(text, tmp_path)


def poll(
    store: Store, plant: Plant, until: datetime, minutes: int, dead: Sequence[str] = ()
) -> None:
    """Samples every ten seconds up to ``until``; those of ``dead`` are bad."""
    tags = [register.tag for register in plant.devices["plc"].registers]
    for step in range(minutes * 6):
        at = until - timedelta(seconds=10 * step)
        quality = [int(Quality.BAD if tag in dead else Quality.GOOD) for tag in tags]
        store.samples.write(
            SampleBatch(
                source="plc",
                tags=tuple(tags),
                at_us=np.full(len(tags), microseconds(at), dtype=np.int64),
                values=np.where(np.array(quality) == 0, 50.0, np.nan),
                quality=np.array(quality, dtype=np.uint8),
                reasons=tuple(WHY if tag in dead else "" for tag in tags),
            )
        )
    good = None if len(dead) == len(tags) else until
    store.sources.note(SourceState(source="plc", kind="modbus", last_good=good))


def look(store: Store, plant: Plant, now: datetime) -> list[StoredAlert]:
    """The open alerts after a look."""
    watch_sources(store, plant, since=LONG_AGO, now=now)
    return open_alerts(store)


def test_a_dead_position_is_an_alert_of_its_valve(either_store: Store, plant: Plant) -> None:
    """It names role, tag, since when and why; it is raised once and closed when it is over."""
    store = either_store
    poll(store, plant, NOW - timedelta(minutes=6), 2)
    assert look(store, plant, NOW - timedelta(minutes=6)) == []
    poll(store, plant, NOW, 5, dead=["V3.ZT"])
    (alert,) = look(store, plant, NOW)
    assert (alert.kind, alert.valve, alert.source) == (AlertKind.NO_DATA, "V3", "plc")
    assert alert.text.startswith(
        f"V3 (Feed 3): no good sample of MV V3.ZT since 2026-03-02 11:54 UTC ({WHY})."
    )
    assert [item.id for item in look(store, plant, NOW)] == [alert.id]
    later = NOW + timedelta(minutes=1)
    poll(store, plant, later, 1)
    assert look(store, plant, later) == []
    assert store.alerts.get(alert.id).closed_why == BACK


def test_a_tag_that_is_bad_for_a_while_only_is_none(either_store: Store, plant: Plant) -> None:
    """Before the limit has passed, and while one good sample lies in it."""
    poll(either_store, plant, NOW - timedelta(minutes=4), 1)
    poll(either_store, plant, NOW, 4, dead=["V3.ZT"])
    assert look(either_store, plant, NOW) == []


def test_a_service_that_has_just_begun_blames_nobody(either_store: Store, plant: Plant) -> None:
    """What was collected before says nothing of now."""
    poll(either_store, plant, NOW, 6, dead=["V3.ZT"])
    assert watch_sources(either_store, plant, since=NOW - timedelta(minutes=1), now=NOW) == []


def test_while_old_samples_come_from_the_spool_nothing_is_known(
    either_store: Store, plant: Plant
) -> None:
    """The device answers now, but what the store has is from a while ago."""
    poll(either_store, plant, NOW - timedelta(minutes=4), 2, dead=["V3.ZT"])
    either_store.sources.note(SourceState(source="plc", kind="modbus", last_good=NOW))
    assert look(either_store, plant, NOW) == []


def test_many_valves_at_once_are_one_alert_of_their_device(
    either_store: Store, plant: Plant
) -> None:
    """A failed card: the alert of a single valve becomes part of the device's alert, and is opened
    again when that valve is the only one left."""
    store = either_store
    poll(store, plant, NOW, 6, dead=["V0.ZT"])
    (first,) = look(store, plant, NOW)
    later = NOW + timedelta(minutes=10)
    poll(store, plant, later, 6, dead=[f"V{n}.ZT" for n in range(6)])
    (several,) = look(store, plant, later)
    assert (several.valve, several.source) == (None, "plc")
    assert "6 valves of plc" in several.text
    assert "V0, V1, V2, V3, V4, V5" in several.text
    assert store.alerts.get(first.id).closed_why == JOINED
    last = later + timedelta(minutes=10)
    poll(store, plant, last, 6, dead=["V0.ZT"])
    (left,) = look(store, plant, last)
    assert left.valve == "V0"
    assert store.alerts.get(several.id).closed is not None


def test_a_device_that_is_silent_speaks_for_its_tags(either_store: Store, plant: Plant) -> None:
    """One alert for the device; that of the valve is part of it."""
    store = either_store
    poll(store, plant, NOW, 6, dead=["V3.ZT"])
    (alert,) = look(store, plant, NOW)
    later = NOW + timedelta(minutes=10)
    everything = [register.tag for register in plant.devices["plc"].registers]
    poll(store, plant, later, 6, dead=everything)
    (device,) = look(store, plant, later)
    assert (device.valve, device.source) == (None, "plc")
    assert "12 valves are not watched" in device.text
    assert store.alerts.get(alert.id).closed_why == JOINED


def test_a_signal_that_stands_still_is_not_dead(either_store: Store, plant: Plant) -> None:
    """Good samples of one value are the screening's to judge."""
    poll(either_store, plant, NOW, 6)
    assert look(either_store, plant, NOW) == []
