"""Alerts after a run, on a real store: raised once, joined where they have one cause."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from stemwatch.connectors.settings import Problem
from stemwatch.models.estimate import Estimate
from stemwatch.models.record_checks.data_quality import DataQuality
from stemwatch.models.recording import Recording, Role, Signal
from stemwatch.models.screening_result import Indicator, Screening
from stemwatch.models.verdict import Verdict
from stemwatch.service.alerts.digest import queue_messages
from stemwatch.service.alerts.evaluate import evaluate
from stemwatch.service.alerts.silent_sources import watch_sources
from stemwatch.service.config import Plant
from stemwatch.service.presenter.advice import advice_for, first_step
from stemwatch.service.store.administration.prune import RetentionDays, prune
from stemwatch.service.store.alerts.alerts import AlertKind, AlertSeverity, RaisedAlert
from stemwatch.service.store.runs.queue import RunToQueue
from stemwatch.service.store.samples.sources import SourceState
from stemwatch.service.store.screenings.records import ValveState
from stemwatch.service.store.store import Store
from tests.service.alerts.conftest import plant_of
from tests.service.open_alerts import open_alerts

START = datetime(2026, 3, 2, tzinfo=UTC)
MISTAKE = Problem(file="plant.toml", line=3, key="id", found="?", expected="a text")
DEVICE = """
[[notifiers]]
name = "all"
kind = "file"
path = "all.jsonl"

[[notifiers]]
name = "night"
kind = "file"
path = "night.jsonl"
least_severity = "high"

[[devices]]
name = "plc"
type = "tcp"
host = "192.0.2.1"
unit_id = 1
byte_order = "ABCD"
"""


@pytest.fixture
def plant(tmp_path: Path) -> Plant:
    """Twelve valves of one device, eight of them in area 100."""
    text = '[plant]\nname = "P"\n' + DEVICE
    for n in range(12):
        text += f'[[devices.registers]]\ntag = "OP{n}"\nregister = "holding"\n'
        text += f'address = {2 * n}\ntype = "FLOAT32"\n'
    for n in range(12):
        area = "100" if n < 8 else f"2{n}"
        text += f'[[valves]]\nid = "V{n}"\narea = "{area}"\nsource = "plc"\n'
        text += f'[valves.tags.op]\ntag = "OP{n}"\nunit = "%"\n'
    return plant_of(text, tmp_path)


def screened(valve: str, hour: int, verdict: Verdict, ratio: float | None) -> Screening:
    op = Signal.good(np.zeros(60), "OP")
    estimate = Estimate(value=2.0, low=1.8, high=2.2, unit="%")
    results = (
        {}
        if ratio is None
        else {"baseline_ratio": Indicator(name="", value=ratio, unit="", meaning="")}
    )
    start = START + timedelta(hours=hour)
    return Screening(
        valve=valve, verdict=verdict, reason="", advice="Check.", shape=None, severity=50.0,
        confidence=0.9, S=estimate, J=Estimate.unknown("few"), residuals={},
        quality=DataQuality(grade="A"), indicators=results,
        recording=Recording(valve=valve, signals={Role.OP: op}, interval_s=1.0, start=start),
    )  # fmt: skip


def run(
    store: Store, plant: Plant, hour: int, sticky: Sequence[str] = (), left: Sequence[str] = ()
) -> list[int]:
    """A run over all valves, with these findings; the numbers of the alerts that it raised."""
    number = store.queue.put(RunToQueue(), software_version="1")
    store.queue.claim("w")
    store.queue.plan(number, plant.valves)
    for valve in plant.valves:
        verdict = Verdict.STICKY if valve in sticky else Verdict.HEALTHY
        store.save(screened(valve, hour, verdict, 9.0 if valve in left else None), number)
        store.queue.mark(number, valve, ValveState.DONE)
    raised = evaluate(store, plant, number)
    assert evaluate(store, plant, number) == []
    return raised


def test_sticky_valves_are_each_an_alert_and_one_message(store: Store, plant: Plant) -> None:
    """Friction is each valve's own, however many stick; the message is one."""
    sticky = [f"V{n}" for n in range(7)]
    assert run(store, plant, 0, sticky) == []
    assert len(run(store, plant, 1, sticky)) == 7
    assert run(store, plant, 2, sticky) == []
    assert queue_messages(store, plant)
    assert not queue_messages(store, plant)
    (message,) = store.deliveries.recent()
    assert message.notifier == "all"  # none is urgent enough for the night
    assert len(message.message["alerts"]) == 7
    assert message.message["subject"] == "P: 7 new alerts: V0, V1, V2, V3, V4, V5, V6"


def test_the_alert_of_a_valve_that_left_the_plant_file_is_closed(
    store: Store, plant: Plant
) -> None:
    """No run would look at it again, and so it would stand for ever. While the file has mistakes
    the valve may be missing for one of them, and its alert stays."""
    for hour in range(2):
        run(store, plant, hour, ["V0", "V1"])
    fewer = replace(plant, valves={name: of for name, of in plant.valves.items() if name != "V0"})
    run(store, replace(fewer, problems=(MISTAKE,)), 2, ["V1"])
    assert {alert.valve for alert in open_alerts(store)} == {"V0", "V1"}
    run(store, fewer, 3, ["V1"])
    assert {alert.valve for alert in open_alerts(store)} == {"V1"}
    (closed,) = store.alerts.in_state("closed", datetime.now(UTC))
    assert (closed.valve, closed.closed_why) == (
        "V0", "the plant file does not name this valve any more",
    )  # fmt: skip


def test_a_message_links_to_the_pages_where_their_address_is_known(
    store: Store, plant: Plant
) -> None:
    """Each alert to its valve, and all of them to the page where they are acknowledged."""
    service = plant.service.model_copy(update={"address": "https://valves.example/unit/"})
    run(store, plant, 0, ["V1"])
    run(store, plant, 1, ["V1"])
    assert queue_messages(store, replace(plant, service=service))
    (message,) = store.deliveries.recent()
    assert "\nhttps://valves.example/unit/valve?id=V1\n" in message.message["text"]
    assert "https://valves.example/unit/alerts" in message.message["text"]
    first = message.message["alerts"][0]["first_step"]
    assert first == first_step("stiction_undershoot")
    assert f"\nFirst: {first}\n" in message.message["text"]
    parts = advice_for("stiction_undershoot").parts
    assert f"\nHave at hand: {'; '.join(parts)}.\n" in message.message["text"]
    assert message.message["alerts"][0]["link"].endswith("/valve?id=V1")


def test_many_that_leave_their_baselines_at_once_are_one_alert(store: Store, plant: Plant) -> None:
    """What an area shares is looked for first; when it is over the alert is closed."""
    area = [f"V{n}" for n in range(8)]
    run(store, plant, 0, left=area)
    run(store, plant, 1, left=area)
    (alert,) = open_alerts(store)
    assert alert.kind is AlertKind.COMMON
    assert "8 valves of area 100" in alert.text
    assert sorted(alert.evidence["valves"]) == area
    for hour in (2, 3, 4):
        run(store, plant, hour)
    assert open_alerts(store) == []


def test_the_alert_of_an_area_ends_with_the_area(store: Store, plant: Plant) -> None:
    """Renamed in the plant file, it would else stay open for ever."""
    area = [f"V{n}" for n in range(8)]
    for hour in (0, 1):
        run(store, plant, hour, left=area)
    valves = {
        name: valve.model_copy(update={"area": "500"}) if valve.area == "100" else valve
        for name, valve in plant.valves.items()
    }
    run(store, replace(plant, valves=valves), 2, left=area)
    (alert,) = open_alerts(store)
    assert "8 valves of area 500" in alert.text


def test_no_message_is_lost_where_a_number_is_given_out_again(store: Store, plant: Plant) -> None:
    """SQLite gives the number of a removed alert to the next; the first message still waits."""
    for valve, hour in (("V1", 0), ("V2", 2)):
        for later in (0, 1):
            run(store, plant, hour + later, [valve])
        (alert,) = open_alerts(store)
        assert (alert.id, alert.valve) == (1, valve)
        assert queue_messages(store, plant)
        store.alerts.clear([alert.cause], "not found any more")
        prune(store, RetentionDays(alerts_days=1), datetime.now(UTC) + timedelta(days=3))
    about = [delivery.message["alerts"][0]["valve"] for delivery in store.deliveries.recent()]
    assert about == ["V2", "V1"]


def test_one_that_leaves_its_baseline_is_its_own_alert(store: Store, plant: Plant) -> None:
    """A single valve is named, and closed after three runs without."""
    for hour in (0, 1):
        run(store, plant, hour, left=["V3"])
    (alert,) = open_alerts(store)
    assert (alert.kind, alert.valve) == (AlertKind.BASELINE, "V3")


@pytest.mark.parametrize(
    ("before", "after", "text"),
    [
        ((4.0, 3.5, 4.5), (0.5, 0.3, 0.7), "It helped"),
        ((0.5, 0.3, 0.7), (4.0, 3.5, 4.5), "It got worse"),
        ((2.0, 1.0, 3.0), (1.5, 0.8, 2.2), "No difference can be told"),
        ((2.0, None, None), (1.5, 0.8, 2.2), "cannot be told in numbers"),
    ],
)
def test_the_run_after_maintenance_says_whether_it_helped(
    store: Store, plant: Plant, before, after, text: str
) -> None:
    """Both intervals are named, once, whatever runs follow; before the next run nothing is said."""

    def look(hour: int, S: tuple) -> None:
        number = store.queue.put(RunToQueue(valves=("V1",)), software_version="1")
        store.queue.claim("w")
        store.queue.plan(number, ["V1"])
        value, low, high = S
        estimate = Estimate(value=value, low=low, high=high, unit="%")
        store.save(replace(screened("V1", hour, Verdict.WATCH, None), S=estimate), number)
        store.queue.mark(number, "V1", ValveState.DONE)
        evaluate(store, plant, number)

    look(0, before)
    store.record_maintenance("V1", START + timedelta(minutes=60.5), "packing renewed", "Ann")
    look(1, after)
    assert store.notes("V1") == [], "the work lies in its window"
    look(2, after)
    look(3, before)
    (note,) = store.notes("V1")
    assert text in note.note
    assert "packing renewed" in note.note
    assert note.who == "stemwatch"


def test_a_silent_device_is_one_alert_for_all_its_valves(store: Store, plant: Plant) -> None:
    """Raised once when nothing good came for a while, closed when samples arrive again."""
    late = START + timedelta(hours=1)

    def say(last_good: datetime, fault: str) -> None:
        state = SourceState(source="plc", kind="modbus", last_good=last_good, fault=fault)
        store.sources.note(state)

    assert watch_sources(store, plant, since=late, now=late + timedelta(minutes=5)) == []
    say(START, "no connection")
    raised = watch_sources(store, plant, since=START, now=late)
    assert watch_sources(store, plant, since=START, now=late) == []
    alert = store.alerts.get(raised[0])
    assert alert.kind is AlertKind.NO_DATA
    assert "12 valves" in alert.text
    assert "no connection" in alert.text
    say(late, "")
    watch_sources(store, plant, since=START, now=late + timedelta(minutes=1))
    assert open_alerts(store) == []


def test_what_has_one_cause_is_one_alert_with_its_evidence(store: Store, plant: Plant) -> None:
    """A valve leaves its baseline and then sticks: the alert says so, and stays the same one. It is
    more urgent now, so it is told once more, to those who hear of urgent ones only, too."""
    for hour in (0, 1):
        run(store, plant, hour, left=["V3"])
    (early,) = open_alerts(store)
    assert early.kind is AlertKind.BASELINE
    assert queue_messages(store, plant)
    store.alerts.acknowledge(early.id, "K. Berg", "on the list")
    numbers: list[int] = []
    for hour in (2, 3, 4):
        numbers += run(store, plant, hour, sticky=["V3"], left=["V3"])
        queue_messages(store, plant)
    (alert,) = store.alerts.in_state("all", START)
    assert (numbers, alert.id, alert.kind) == ([], early.id, AlertKind.STICKY)
    assert (alert.acknowledged_by, alert.comment) == ("K. Berg", "on the list")
    assert [before["kind"] for before in alert.evidence["formerly"]] == ["baseline"]
    assert [finding["kind"] for finding in alert.evidence["findings"]] == ["baseline"]
    told_urgency = [one.message["alerts"][0]["severity"] for one in store.deliveries.recent()]
    assert told_urgency == ["medium", "low"]


def test_a_false_alarm_does_not_become_another_finding(store: Store, plant: Plant) -> None:
    """Somebody said that the valve follows its baseline well; that it sticks is new."""
    for hour in (0, 1):
        run(store, plant, hour, left=["V3"])
    (early,) = open_alerts(store)
    store.alerts.mark_false(early.id, "K. Berg")
    for hour in (2, 3):
        run(store, plant, hour, sticky=["V3"], left=["V3"])
    (alert,) = open_alerts(store)
    assert alert.kind is AlertKind.STICKY
    assert alert.id != early.id
    assert store.alerts.get(early.id).false_alarm


def test_the_evidence_of_an_alert_is_listed(store: Store, plant: Plant) -> None:
    """Found together, they are one alert and one message from the beginning."""
    numbers = []
    for hour in (0, 1, 2):
        numbers += run(store, plant, hour, sticky=["V3"], left=["V3"])
    (alert,) = open_alerts(store)
    assert numbers == [alert.id]
    assert [finding["kind"] for finding in alert.evidence["findings"]] == ["baseline"]
    assert "Also seen: The valve moves differently than when its baseline was set" in alert.text
    assert alert.text.count("V3") == 1


def test_an_alert_of_friction_becomes_that_of_a_sticking_stem(store: Store) -> None:
    """The same alert says that the stem sticks once it does, with what a person did to it; it
    never says less again, and nothing new is opened."""
    stick = RaisedAlert(
        cause="sticky:V1", kind=AlertKind.STICKY, severity=AlertSeverity.HIGH,
        text="V1: the stem sticks", valve="V1", run_id=None, evidence={"S": 2.0},
    )  # fmt: skip
    restick = replace(
        stick, kind=AlertKind.MISMATCH, severity=AlertSeverity.LOW, text="V1: small steps"
    )
    (number,) = store.alerts.raise_all([restick])
    store.alerts.acknowledge(number, "K. Berg", "on the list")
    assert store.alerts.raise_all([stick]) == []
    assert store.alerts.raise_all([restick]) == []
    alert = store.alerts.get(number)
    assert (alert.kind, alert.severity) == (AlertKind.STICKY, AlertSeverity.HIGH)
    assert (alert.text, alert.comment) == ("V1: the stem sticks", "on the list")
