"""``Actions``: what a signed-in user can change. Each action writes a few rows to the store and
never waits for a run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from datetime import datetime

from stemwatch.service import __version__
from stemwatch.service.store.errors import NotThere
from stemwatch.service.store.runs.queue import RunToQueue
from stemwatch.service.store.runs.schedule import ScreeningSchedule
from stemwatch.service.store.screenings.feedback import Judgement
from stemwatch.service.store.screenings.records import no_time_of_a_plant, not_done_yet
from stemwatch.service.store.store import Store

LARGEST_NUMBER = 2**31 - 1  # of a row, in PostgreSQL


def number_in(text: str) -> int:
    """The number of a row in a part of an address; 0 where there can be none."""
    number = int(text) if text.isascii() and text.isdigit() and len(text) < 12 else 0
    return number if number <= LARGEST_NUMBER else 0


class Refused(Exception):
    """What was asked cannot be done now. The text says why and what to do; the page shows it."""


class Missing(Refused):
    """What was asked for is not there: an alert, a run, a valve."""


class Actions:
    """Handles alerts, stores notes and feedback, queues and cancels runs. Raises ``Refused`` and
    ``StoreError``.

    ``who`` is the signature of the user. ``wake`` makes the queue worker check the queue at once.
    """

    def __init__(self, store: Store, wake: Callable[[], None] = lambda: None) -> None:
        self.store = store
        self._wake = wake

    def run_now(self, valves: Sequence[str], who: str) -> int | None:
        """Queue a run over ``valves``, or over all where there are none; its number."""
        known_valves = {valve.id for valve in self.store.valves()} if valves else set()
        if unknown := [valve for valve in valves if valve not in known_valves]:
            raise Missing(f"there is no valve {unknown[0]}")
        number = self.store.queue.put(
            RunToQueue(valves=tuple(valves), who=who), software_version=__version__
        )
        self._wake()
        return number

    def cancel(self, run: int, who: str) -> None:
        """Request that a run ends early; its results so far are kept."""
        if run > LARGEST_NUMBER or not self.store.queue.ask_to_cancel(run, who):
            raise Refused(f"run {run} does not wait or go on any more; there is nothing to cancel")

    def acknowledge(self, alert: int, who: str, comment: str) -> None:
        """Acknowledge an alert. It stays open until its cause is gone."""
        self._alert(alert)
        self.store.alerts.acknowledge(alert, who, comment)

    def acknowledge_all(self, alerts: Sequence[int], who: str, comment: str) -> None:
        """Acknowledge several alerts; none of them where one does not exist."""
        for alert in alerts:
            self._alert(alert)
        for alert in alerts:
            self.store.alerts.acknowledge(alert, who, comment)

    def snooze_all(self, alerts: Sequence[int], until: datetime, who: str) -> None:
        """Snooze several alerts; none of them where one does not exist."""
        _need_time(until)
        for alert in alerts:
            self._alert(alert)
        for alert in alerts:
            self.store.alerts.snooze(alert, until, who)

    def false_alarms(self, alerts: Sequence[int], who: str, comment: str) -> None:
        """Mark several alerts as false alarms; none of them where one does not exist."""
        for alert in alerts:
            self._alert(alert)
        for alert in alerts:
            self.store.alerts.mark_false(alert, who, comment)

    def snooze(self, alert: int, until: datetime, who: str) -> None:
        """Snooze an alert until ``until``."""
        _need_time(until)
        self._alert(alert)
        self.store.alerts.snooze(alert, until, who)

    def false_alarm(self, alert: int, who: str, comment: str) -> None:
        """Mark an alert as a false alarm."""
        self._alert(alert)
        self.store.alerts.mark_false(alert, who, comment)

    def note(self, valve: str, at: datetime, text: str, who: str) -> None:
        """Store a note about a valve."""
        _need_time(at)
        self.store.add_note(valve, at, text, who)

    def maintenance(self, valve: str, at: datetime, text: str, who: str, now: datetime) -> None:
        """Record work on a valve, which was done before ``now``."""
        _need_time(at)
        if reason := not_done_yet(at, now):
            raise Refused(reason)
        self.store.record_maintenance(valve, at, text, who)

    def feedback(self, screening: int, at: datetime, judgement: str, found: str, who: str) -> str:
        """Store feedback on a screening: whether it was right and what was found. Returns its
        valve."""
        if judgement not in list(Judgement):
            words = ", ".join(Judgement)
            raise Refused(f"one of {words} is expected, received {judgement!r}")
        if not 0 < screening <= LARGEST_NUMBER:
            raise Missing(f"there is no screening {screening}")
        _need_time(at)
        try:
            return self.store.add_feedback(screening, at, Judgement(judgement), found, who)
        except NotThere:
            raise Missing(f"there is no screening {screening}") from None

    def baseline(self, valve: str, reason: str, who: str) -> None:
        """Make the network fitted last the valve's baseline."""
        fitted = self.store.fitted(valve)
        if fitted is None:
            raise Refused(
                f"{valve} has no fitted network yet; the first run with a verdict fits one"
            )
        reason_text = f"chosen by {who or 'a reader'}" + (f": {reason}" if reason else "")
        self.store.set_baseline(valve, fitted.network, window=fitted.window, reason=reason_text)

    def set_schedule(self, schedule: ScreeningSchedule, who: str, now: datetime) -> None:
        """Make or change a schedule; those of the plant file are changed there."""
        if not self.store.schedules.set(schedule):
            raise Refused(
                f"the schedule {schedule.name} stands in the plant file, which is its source: "
                "change it there, or choose another name"
            )
        self.store.browser_settings.note_schedule(schedule.name, who, now)

    def remove_schedule(self, name: str) -> None:
        """Remove a schedule that was made on the pages."""
        if not self.store.schedules.remove(name):
            raise Missing(f"there is no schedule {name} that was made on the pages")
        self.store.browser_settings.forget_schedule(name)

    def _alert(self, number: int) -> None:
        if number > LARGEST_NUMBER:
            raise Missing(f"there is no alert {number}")
        try:
            self.store.alerts.get(number)
        except NotThere:
            raise Missing(f"there is no alert {number}") from None


def _need_time(at: datetime) -> None:
    """Raise ``Refused`` for a time that no page could show."""
    if reason := no_time_of_a_plant(at):
        raise Refused(reason)
