"""Messages are tried again until they arrive, and arrive once."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
import time_machine

from stemwatch.service.alerts.notifiers import NotSent
from stemwatch.service.alerts.sender import FEWEST_ATTEMPTS, GIVE_UP_AFTER, Sender, wait_after
from stemwatch.service.store.alerts.deliveries import LONGEST_WAIT
from stemwatch.service.store.store import Store, open_store

START = datetime(2026, 3, 2, tzinfo=UTC)


class Mailbox:
    """A receiver that is away for its first ``failures`` messages."""

    def __init__(self, failures: int = 0, error: Exception | None = None) -> None:
        self.keys: list[str] = []
        self._failures = failures
        self._error = error or NotSent("postgresql://u:geheim@h is away")

    def send(self, key: str, message: Mapping[str, Any]) -> None:
        if self._failures:
            self._failures -= 1
            raise self._error
        self.keys.append(key)


@pytest.fixture
def clock() -> Iterator[time_machine.Traveller]:
    """A clock that stands still until it is moved."""
    with time_machine.travel(START, tick=False) as traveller:
        yield traveller


@pytest.fixture
def store(tmp_path: Path, clock) -> Iterator[Store]:
    """A store with a message to each of two notifiers."""
    with open_store(f"sqlite:///{tmp_path / 'store.db'}") as opened:
        opened.deliveries.put({"a": {"subject": "s"}, "b": {"subject": "s"}}, "k1", [])
        yield opened


def test_each_notifier_gets_the_message_once(store: Store) -> None:
    """One that is away does not keep the other's message back, nor repeat it."""
    first, second = Mailbox(), Mailbox(failures=1)
    sender = Sender(store, {"a": first, "b": second})
    assert [sender.send_due(), sender.send_due()] == [1, 0]
    assert (first.keys, second.keys) == (["k1"], [])


def test_the_wait_grows_and_the_message_arrives(store: Store, clock) -> None:
    """After each failure it waits longer; the key stays the same."""
    away = Mailbox(failures=3)
    sender = Sender(store, {"a": Mailbox(), "b": away})
    for minutes in (0, 1, 2, 4):
        clock.shift(timedelta(minutes=minutes))
        sender.send_due()
    assert away.keys == ["k1"]
    assert [delivery.attempts for delivery in store.deliveries.recent()] == [4, 1]


def test_an_error_is_kept_without_secrets(store: Store) -> None:
    """What went wrong can be seen on the page, the password in it cannot."""
    Sender(store, {"a": Mailbox(), "b": Mailbox(failures=1)}).send_due()
    (failed, _) = store.deliveries.recent()
    assert "is away" in failed.error
    assert "geheim" not in failed.error


def test_what_can_never_arrive_is_given_up(store: Store, clock) -> None:
    """A refused address and an unknown notifier at once, anything else after some days and many
    attempts: a clock that leaps does not make one failure the last."""
    never = Mailbox(failures=9, error=NotSent("private", final=True))
    Sender(store, {"b": never}).send_due()
    assert [delivery.given_up for delivery in store.deliveries.recent()] == [True, True]
    store.deliveries.put({"a": {"subject": "s"}}, "k2", [])
    clock.shift(GIVE_UP_AFTER + timedelta(seconds=1))
    away = Sender(store, {"a": Mailbox(failures=FEWEST_ATTEMPTS)})
    for _ in range(FEWEST_ATTEMPTS):
        assert not store.deliveries.recent()[0].given_up
        away.send_due()
        clock.shift(timedelta(hours=1))
    assert store.deliveries.recent()[0].given_up


def test_a_sender_that_died_holds_no_message_for_ever(store: Store, clock) -> None:
    """A message that a dead process had taken is sent by the next one after a while."""
    while store.deliveries.claim():
        pass
    box = Mailbox()
    sender = Sender(store, {"a": box, "b": box})
    assert sender.send_due() == 0
    clock.shift(timedelta(minutes=6))
    assert sender.send_due() == 2


def test_the_wait_is_bounded() -> None:
    """Doubled each time, never longer than an hour."""
    waits = [wait_after(n) for n in range(1, 40)]
    assert waits[:3] == [timedelta(minutes=n) for n in (1, 2, 4)]
    assert waits == sorted(waits)
    assert waits[-1] == LONGEST_WAIT
