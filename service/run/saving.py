"""Saving each result as it arrives: screening, network and baseline of its valve."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime

from stemwatch.models.screening_result import PreviousFinding, Screening
from stemwatch.models.verdict import Verdict
from stemwatch.service.presenter.work_decision import decide
from stemwatch.service.run.spill import ResultSpill
from stemwatch.service.run.task import StoredBaseline, Task
from stemwatch.service.store.errors import StoreError
from stemwatch.service.store.screenings.records import Baseline, EarlierAnswer, EarlierCurve
from stemwatch.service.store.store import Store

WITH_VERDICT = (Verdict.HEALTHY, Verdict.WATCH, Verdict.STICKY)
FIRST_WINDOW, FIRST_HEALTHY = "first window with a fit", "first healthy window"


def with_stored_context(
    tasks: Sequence[Task], store: Store, queued_run: int | None = None
) -> list[Task]:
    """Each task with its valve's baseline network, where the store has one, and with the curves
    from OP to stroke of its last windows, unless the plant file gives one.

    The tasks of a ``queued_run`` of the service also get what OP and PV alone said in the windows
    of earlier runs. What a user screens by hand is judged by what is screened together, so that the
    same files give the same report again.
    """
    answers: dict[str, tuple[EarlierAnswer, ...]] = {}
    curves: dict[str, tuple[EarlierCurve, ...]] = {}
    baselines: dict[str, StoredBaseline | None] = {}
    for task in tasks:
        valve = task.tags.valve
        if valve not in baselines:
            baseline = store.baseline(valve)
            baselines[valve] = (
                None
                if baseline is None
                else StoredBaseline(
                    network=baseline.network,
                    note=baseline.note,
                    window=baseline.window,
                    worked_at=None if baseline.maintenance is None else baseline.maintenance.at,
                    id=baseline.id,
                )
            )
        if valve not in curves:
            curve_is_given = task.given_curve is not None
            curves[valve] = () if curve_is_given else tuple(store.earlier_curves(valve))
        if valve not in answers and queued_run is not None:
            answers[valve] = tuple(store.earlier_answers(valve, queued_run))
    return [
        replace(
            task,
            baseline=baselines[task.tags.valve],
            earlier_curves=curves[task.tags.valve],
            earlier_answers=answers.get(task.tags.valve, ()),
        )
        for task in tasks
    ]


@dataclass(frozen=True, kw_only=True)
class PlacedScreening:
    """A screening and its place among the tasks; ``given_up`` says why it could not be done.

    ``packed_pictures`` are kept in the store with it.
    """

    task_index: int
    screening: Screening
    given_up: str = ""
    packed_pictures: bytes = b""


class Saving:
    """Saves the results of ``tasks``, in whatever order they arrive.

    Each screening is saved at once. A valve's networks and its trend depend on the order of its
    windows, so those of a later window wait for the earlier ones; ``on_valve_done`` is called when
    all windows of a valve are saved, with the reason if one was given up. ``previous`` is each
    valve's result before its last window. Failures to save are collected in ``not_saved``; with
    ``must_save`` an unavailable database is raised instead.

    Without ``must_save`` sources that could not be read wait for the first that could: a mistyped
    option or file must not become the latest that is known of a valve.
    """

    def __init__(
        self,
        store: Store,
        number: int,
        started: datetime,
        tasks: Sequence[Task],
        *,
        new_baseline: bool = False,
        must_save: bool = False,
        on_valve_done: Callable[[str, str], None] = lambda *_: None,
    ) -> None:
        self._store, self._number, self._started = store, number, started
        self._new_baseline, self._must_save = new_baseline, must_save
        self._on_valve_done = on_valve_done
        self._compared = {
            task.tags.valve: task.baseline.id
            for task in tasks
            if task.baseline is not None and task.baseline.id is not None
        }
        self._to_come: dict[str, list[int]] = defaultdict(list)
        for index, task in enumerate(tasks):
            self._to_come[task.tags.valve].append(index)
        self._waiting: set[int] = set()  # saved, but an earlier window has not arrived yet
        self._unsaved: set[int] = set()
        self._given_up: dict[str, str] = {}
        self.previous: dict[str, PreviousFinding | None] = {}
        self._not_read: list[PlacedScreening] | None = None if must_save else []
        self.not_saved: list[tuple[str, str]] = []

    def take(self, arrived: Sequence[PlacedScreening], spill: ResultSpill) -> None:
        """Save screenings, which ``spill`` also holds, and the networks that are now due."""
        if self._not_read is not None:
            arrived = [*self._not_read, *arrived]
            if not any(result.screening.was_read for result in arrived):
                self._not_read = [*arrived]
                return
            self._not_read = None
        for result in arrived:
            if self._to_come[result.screening.valve][0] == result.task_index:
                self._note_previous(result.screening)
            if result.given_up:
                self._given_up[result.screening.valve] = result.given_up
        self._save(arrived)
        for result in arrived:
            self._waiting.add(result.task_index)
            self._save_due_networks(result.screening.valve, spill, result)

    def skip(self, task_index: int, valve: str, spill: ResultSpill) -> None:
        """A task whose result is left out: later windows of its valve need not wait for it."""
        self._to_come[valve].remove(task_index)
        self._save_due_networks(valve, spill)

    def _save(self, arrived: Sequence[PlacedScreening]) -> None:
        screenings = [result.screening for result in arrived]
        pictures = [result.packed_pictures for result in arrived]
        report = self._store.save_many(screenings, self._number, self._compared, pictures)
        reasons = {failure.place: failure.reason for failure in report.failures}
        for place, result in enumerate(arrived):
            reason = reasons.get(place, "")
            if reason and self._must_save:
                self._store.run(self._number)  # raises while the database is not available
                saved = self._store.save_many(
                    [result.screening], self._number, self._compared, [result.packed_pictures]
                )
                reason = "".join(failure.reason for failure in saved.failures)
            if reason:
                self._unsaved.add(result.task_index)
                self._left_out(result.screening.valve, f"not saved: {reason}")

    def _save_due_networks(
        self, valve: str, spill: ResultSpill, newest: PlacedScreening | None = None
    ) -> None:
        """Save the valve's networks in the order of its windows, up to the first that has not
        arrived. ``newest`` is not read from ``spill``."""
        to_come = self._to_come[valve]
        while to_come and to_come[0] in self._waiting:
            first = to_come.pop(0)
            self._waiting.remove(first)
            if newest is not None and first == newest.task_index:
                screening = newest.screening
            else:
                screening = spill.at_place(first)
                self._note_previous(screening)
            if first not in self._unsaved:
                self._keep_network(screening)
        if not to_come:
            self._on_valve_done(valve, self._given_up.get(valve, ""))

    def _note_previous(self, screening: Screening) -> None:
        self.previous[screening.valve] = self._store.previous_finding(screening, self._started)

    def _keep_network(self, screening: Screening) -> None:
        try:
            keep_network(screening, self._store, new_baseline=self._new_baseline)
        except StoreError as error:
            if self._must_save:
                raise
            self._left_out(screening.valve, str(error))

    def _left_out(self, valve: str, reason: str) -> None:
        self.not_saved.append((valve, reason))
        self._given_up[valve] = reason


def keep_network(screening: Screening, store: Store, *, new_baseline: bool = False) -> None:
    """Store a valve's fitted network, and make it the baseline where one is due.

    A valve's first window with a network is its first baseline, also where windows of one run are
    over in another order; a healthy window replaces a baseline that was not healthy, and the first
    window after maintenance or the user's request replaces any. Repeating the call changes
    nothing.
    """
    if screening.network is None or screening.verdict not in WITH_VERDICT:
        return
    blob = screening.network.to_bytes()
    kept_because = f"fitted to a window that was {_state(screening).value}"
    store.set_fitted(screening.valve, blob, window=screening.window, reason=kept_because)
    reason = _due(screening, store, new_baseline)
    if reason:
        store.set_baseline(screening.valve, blob, window=screening.window, reason=reason)


def _due(screening: Screening, store: Store, new_baseline: bool) -> str:
    """Why this window becomes the valve's baseline; empty where it does not."""
    state = _state(screening)
    if new_baseline:
        return f"window chosen by the user ({state})"
    baseline = store.baseline(screening.valve)
    if baseline is None:
        return f"{FIRST_WINDOW} ({state})"
    if baseline.maintenance is not None and _after(screening, baseline.maintenance.at):
        return f"first window after maintenance ({state})"
    if state is Verdict.HEALTHY and f"({Verdict.HEALTHY})" not in baseline.reason:
        return f"{FIRST_HEALTHY} ({state})"
    kind, _, found_then = baseline.reason.partition(" (")
    sounder = state is Verdict.HEALTHY or found_then != f"{Verdict.HEALTHY})"
    if kind in (FIRST_WINDOW, FIRST_HEALTHY) and sounder and _before(screening, baseline, store):
        return f"{kind} ({state})"
    return ""


def _before(screening: Screening, baseline: Baseline, store: Store) -> bool:
    """Whether the window is earlier than the baseline's, with no maintenance between them."""
    start, first = screening.window[0], baseline.window[0]
    if start is None or first is None or start >= first:
        return False
    return not any(start <= work.at <= first for work in store.maintenance(screening.valve))


def _state(screening: Screening) -> Verdict:
    """The verdict on the valve as a whole, which its pages show too."""
    return decide(screening, stands=None).verdict


def _after(screening: Screening, instant: datetime) -> bool:
    start, _ = screening.window
    return start is not None and start >= instant
