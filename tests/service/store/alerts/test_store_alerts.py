"""Alerts and messages: one open alert for each cause, each in one message."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from datetime import UTC, datetime, timedelta

import pytest

from stemwatch.service.alerts.digest import message_of
from stemwatch.service.store.administration.figures import figures_of
from stemwatch.service.store.alerts.alerts import AlertKind, AlertSeverity, RaisedAlert, state_of
from stemwatch.service.store.errors import StoreError
from stemwatch.service.store.store import Store, open_store

SOON = timedelta(hours=1)


def found(cause: str = "sticky:FIC-1", **changes) -> RaisedAlert:
    fields = {
        "cause": cause,
        "kind": AlertKind.STICKY,
        "severity": AlertSeverity.MEDIUM,
        "text": "FIC-1: It sticks.",
        "valve": "FIC-1",
    }
    return RaisedAlert(**fields | changes)


def test_a_cause_has_one_open_alert(store: Store, store_url: str) -> None:
    """However many processes find it at the same time, people see it once."""
    with closing(open_store(store_url)) as other, ThreadPoolExecutor(6) as pool:
        opened = list(pool.map(lambda item: item.alerts.raise_all([found()]), [store, other] * 6))
    assert sorted(map(len, opened)) == [0] * 11 + [1]
    (alert,) = store.alerts.in_state("open", datetime.now(UTC))
    assert (alert.cause, alert.valve, alert.closed) == ("sticky:FIC-1", "FIC-1", None)


def test_a_cause_that_comes_back_is_a_new_alert(store: Store) -> None:
    """Closed means over: what is found later is raised again, and both stay on record."""
    (first,) = store.alerts.raise_all([found()])
    (closed,) = store.alerts.clear(["sticky:FIC-1", "unknown"], "repaired")
    assert (closed.id, closed.closed_why) == (first, "repaired")
    (second,) = store.alerts.raise_all([found()])
    assert [
        alert.id for alert in store.alerts.in_state("all", datetime.now(UTC), valve="FIC-1")
    ] == [second, first]


def of_size(S: float, day: int) -> RaisedAlert:
    """As found in the window of a day."""
    window = [f"2026-03-{day:02d}T00:00:00+00:00", f"2026-03-{day:02d}T06:00:00+00:00"]
    evidence = {"S": S, "S_low": S - 0.2, "S_high": S + 0.2, "window": window}
    return found(text=f"FIC-1: S is {S} %.", evidence=evidence)


def test_an_open_alert_tells_todays_numbers_and_those_it_was_raised_with(store: Store) -> None:
    """Its text is that of the newest window, as on the valve's page; it stays one alert, and who
    acknowledged it stays."""
    (number,) = store.alerts.raise_all([of_size(2.1, 1)])
    store.alerts.acknowledge(number, "Ina", "in May")
    for day, S in ((2, 2.8), (3, 3.4)):
        assert store.alerts.raise_all([of_size(S, day)]) == []
    alert = store.alerts.get(number)
    assert (alert.text, alert.S, alert.S_when_raised) == ("FIC-1: S is 3.4 %.", 3.4, 2.1)
    assert (alert.acknowledged_by, alert.comment) == ("Ina", "in May")
    mail = message_of([alert], "plant", None)["text"]
    assert "S 2.10 % (1.90 to 2.30) when raised, 3.40 % (3.20 to 3.60) when last found." in mail


def test_an_alert_that_was_called_false_stays_as_it_was(store: Store) -> None:
    """What somebody called false is what it said then."""
    (number,) = store.alerts.raise_all([of_size(2.1, 1)])
    store.alerts.mark_false(number, "Ina")
    store.alerts.raise_all([of_size(3.4, 2)])
    assert store.alerts.get(number).text == "FIC-1: S is 2.1 %."


def test_acknowledging_and_snoozing_keep_the_person(store: Store) -> None:
    """Both name the person; a snoozed alert bothers nobody until its end."""
    (number,) = store.alerts.raise_all([found()])
    store.alerts.acknowledge(number, "Ann", "packing ordered")
    until = datetime.now(UTC) + SOON
    alert = store.alerts.snooze(number, until, "Ben")
    assert (alert.acknowledged_by, alert.comment) == ("Ann", "packing ordered")
    assert (alert.snoozed_by, alert.snoozed_until) == ("Ben", until)
    assert state_of(alert, datetime.now(UTC)) == "snoozed"
    assert state_of(alert, until) == "acknowledged"
    assert store.deliveries.undelivered() == []


def test_a_false_alarm_is_not_raised_again_until_its_cause_was_gone(store: Store) -> None:
    """It leaves the list and stays on record; only after its cause was gone is it news again."""
    (number,) = store.alerts.raise_all([found()])
    store.alerts.mark_false(number, "Ann", "a test stroke")
    assert store.alerts.in_state("open", datetime.now(UTC)) == []
    assert store.alerts.raise_all([found()]) == []
    store.alerts.clear(["sticky:FIC-1"], "gone")
    assert len(store.alerts.raise_all([found()])) == 1
    assert store.alerts.get(number).false_alarm


def test_the_most_urgent_come_first(store: Store) -> None:
    """Open alerts are sorted and counted by urgency, and filtered by valve and area."""
    store.save_valves([_valve("A", "100"), _valve("B", "200")])
    for valve, severity in (("A", "low"), ("B", "high")):
        kind = AlertSeverity(severity)
        store.alerts.raise_all([found(f"sticky:{valve}", valve=valve, severity=kind)])
    now = datetime.now(UTC)
    assert [alert.valve for alert in store.alerts.in_state("open", now)] == ["B", "A"]
    assert [alert.valve for alert in store.alerts.in_state("open", now, valve="A")] == ["A"]
    assert figures_of(store).alerts == {("sticky", "high"): 1, ("sticky", "low"): 1}
    assert store.alerts.open_causes(("sticky:A",)) == {"sticky:A"}


def test_an_unknown_alert_is_said(store: Store) -> None:
    """A number that does not exist changes nothing."""
    with pytest.raises(StoreError, match="there is no alert 7"):
        store.alerts.acknowledge(7, "Ann")


def test_an_alert_is_told_of_once(store: Store, store_url: str) -> None:
    """Two services that tell of the same alerts at the same time make one set of messages."""
    numbers = store.alerts.raise_all([found(), found("sticky:B", valve="B")])
    messages = {"mail": {"subject": "s"}, "hook": {"subject": "s"}}
    with closing(open_store(store_url)) as other, ThreadPoolExecutor(4) as pool:
        did = list(
            pool.map(
                lambda item: item.deliveries.put(messages, "k", numbers),
                [store, other, store, other],
            )
        )
    assert sorted(did) == [False, False, False, True]
    assert len(store.deliveries.recent()) == 2
    assert store.deliveries.undelivered() == []


def test_a_message_is_one_processs_until_it_is_sent(store: Store) -> None:
    """A claimed message is nobody else's; a failed one comes again later; a sent one never."""
    numbers = store.alerts.raise_all([found()])
    store.deliveries.put({"mail": {"subject": "s"}}, "k", numbers)
    first = store.deliveries.claim()
    assert (first.key, first.attempts) == ("k", 1)
    assert store.deliveries.claim() is None
    store.deliveries.failed(first.id, "refused", datetime.now(UTC) - SOON)
    repeated = store.deliveries.claim()
    assert (repeated.id, repeated.attempts, repeated.error) == (first.id, 2, "refused")
    store.deliveries.sent(repeated.id)
    assert store.deliveries.claim() is None
    assert store.deliveries.recent()[0].sent is not None


def _valve(name: str, area: str):
    from stemwatch.service.store.screenings.records import StoredValve

    return StoredValve(id=name, area=area)
