"""``RunQueue``: runs that wait, are being worked on or are over.

A run is a row from the moment it is due. The process that works on it updates its heartbeat every
few seconds; a run whose heartbeat is too old is taken over by another process, which continues it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import NamedTuple

from sqlalchemy import ColumnElement, and_, or_, select, update
from sqlalchemy.orm import Session

from stemwatch.service.process_lifecycle import has_ended
from stemwatch.service.store.database.insert_or_update import upsert
from stemwatch.service.store.database.transactions import Transactions, database_now
from stemwatch.service.store.runs.tables import RunValveRow
from stemwatch.service.store.samples.tables import EPOCH
from stemwatch.service.store.screenings.records import RunState, StoredRun, ValveState
from stemwatch.service.store.screenings.rows import stored_run
from stemwatch.service.store.screenings.screenings import count_verdicts, ensure_valve
from stemwatch.service.store.screenings.tables import RunRow

SILENT_AFTER = timedelta(seconds=30)
LOST_AFTER = timedelta(days=1)
_GOING = (RunState.WAITING.value, RunState.RUNNING.value)
_IN_ONE_STATEMENT = 500


@dataclass(frozen=True, kw_only=True)
class RunToQueue:
    """A run to be queued. Without ``valves`` it screens those of its schedule, else all.

    ``window`` is start and stop, ``None`` where open; ``schedule`` and ``due`` are ``None`` for a
    run that a person requested.
    """

    valves: Sequence[str] = ()
    schedule: str | None = None
    due: datetime | None = None
    not_before: datetime | None = None
    window: tuple[datetime | None, datetime | None] = (None, None)
    who: str = ""
    reason: str = ""


class SetAside(NamedTuple):
    """A valve that a run could not screen, and why."""

    valve: str
    reason: str


class RunQueue:
    """The queue of runs. Methods raise ``StoreError``."""

    def __init__(self, transactions: Transactions) -> None:
        self._transactions = transactions

    def put(self, run: RunToQueue, *, software_version: str) -> int | None:
        """Queue a run and return its number; ``None`` where this instant of the schedule is queued
        already.

        Where the schedule's previous run is not over, the new one is stored as skipped.
        """
        with self._transactions.writing("queueing a run") as session:
            going = _going(session, run.schedule)
            now = database_now(session)
            values: dict[str, object] = {
                "started": now,
                "finished": None if going is None else now,
                "command": "",
                "software_version": software_version,
                "settings_digest": "",
                "counts": {},
                "state": (RunState.WAITING if going is None else RunState.SKIPPED).value,
                "schedule": run.schedule,
                "due": run.due,
                "not_before": run.not_before,
                "window_start": run.window[0],
                "window_stop": run.window[1],
                "asked": list(run.valves) or None,
                "who": run.who,
                "reason": run.reason
                if going is None
                else f"run {going} of this schedule was not over yet",
            }
            statement = upsert(
                session,
                RunRow,
                [values],
                ("schedule", "due"),
                update=False,
                returning=RunRow.id,
            )
            return session.execute(statement).scalar_one_or_none()

    def claim(self, owner: str, *, silent_after: timedelta = SILENT_AFTER) -> StoredRun | None:
        """Assign the next run to ``owner``; ``None`` where there is none.

        Runs whose heartbeat is older than ``silent_after`` or whose worker is known to have ended
        come first, then the oldest that may start. Two processes never get the same run.
        """
        with self._transactions.writing("taking a run from the queue") as session:
            now = database_now(session)
            end_lost(session, now)
            silent = and_(
                RunRow.state == RunState.RUNNING.value,
                RunRow.heartbeat.is_not(None),
                or_(
                    RunRow.heartbeat < now - silent_after,
                    RunRow.heartbeat > now + silent_after,  # the clock was set back since
                    RunRow.owner.in_(_ended(session)),
                ),
            )
            ready = and_(
                RunRow.state == RunState.WAITING.value,
                or_(RunRow.not_before.is_(None), RunRow.not_before <= now),
            )
            row = session.scalar(
                select(RunRow)
                .where(or_(silent, ready))
                .order_by(RunRow.state, RunRow.id)  # "running" comes before "waiting"
                .limit(1)
                .with_for_update(skip_locked=True)
            )
            if row is None:
                return None
            if row.state == RunState.WAITING.value:
                row.started = now
            row.state, row.owner, row.heartbeat = RunState.RUNNING.value, owner, now
            return stored_run(row)

    def beat(self, run_id: int, owner: str) -> StoredRun | None:
        """Update the heartbeat of a run; ``None`` where ``owner`` no longer has it."""
        with self._transactions.writing("updating a run's heartbeat") as session:
            row = session.scalar(select(RunRow).where(RunRow.id == run_id).with_for_update())
            if row is None or row.owner != owner or row.state != RunState.RUNNING.value:
                return None
            row.heartbeat = database_now(session)
            return stored_run(row)

    def forget_instants_after(self, schedule: str, now: datetime) -> None:
        """Allow future instants of a schedule to be queued again, although a clock that ran ahead
        has queued runs for them already. Those of these runs that have not begun are skipped."""
        early = (RunRow.schedule == schedule, RunRow.due > now)
        with self._transactions.writing(f"planning the schedule {schedule} anew") as session:
            waiting = update(RunRow).where(*early, RunRow.state == RunState.WAITING.value)
            session.execute(
                waiting.values(
                    state=RunState.SKIPPED.value,
                    finished=database_now(session),
                    reason="the clock ran ahead when it was queued",
                )
            )
            session.execute(update(RunRow).where(*early).values(due=None, not_before=None))

    def leave(self, run_id: int, owner: str) -> None:
        """Release a run, so that the next process can take it at once."""
        with self._transactions.writing("leaving a run for later") as session:
            session.execute(
                update(RunRow)
                .where(
                    RunRow.id == run_id,
                    RunRow.owner == owner,
                    RunRow.state == RunState.RUNNING.value,
                )
                .values(heartbeat=EPOCH)
            )

    def plan(self, run_id: int, valves: Iterable[str], settings_digest: str = "") -> list[str]:
        """Store the valves of the run, unless done already; return the pending ones, sorted."""
        with self._transactions.writing(f"planning run {run_id}") as session:
            names = list(dict.fromkeys(valves))
            rows = [_pending(run_id, valve) for valve in names]
            session.execute(
                update(RunRow)
                .where(RunRow.id == run_id)
                .values(total=len(rows), settings_digest=settings_digest)
            )
            for valve in names:
                ensure_valve(session, valve)
            for first in range(0, len(rows), _IN_ONE_STATEMENT):
                part = rows[first : first + _IN_ONE_STATEMENT]
                session.execute(
                    upsert(session, RunValveRow, part, ("run_id", "valve"), update=False)
                )
            valves_left = select(RunValveRow.valve).where(
                RunValveRow.run_id == run_id, RunValveRow.state == ValveState.PENDING.value
            )
            return list(session.scalars(valves_left.order_by(RunValveRow.valve)))

    def mark(self, run_id: int, valve: str, state: ValveState, reason: str = "") -> None:
        """Record the state of one valve; has no effect once it is no longer pending."""
        with self._transactions.writing(f"noting {valve} of run {run_id}") as session:
            mark(session, run_id, valve, state, reason)

    def valves_done(self, run_id: int) -> list[str]:
        """The valves of a run that have a result."""
        with self._transactions.reading() as session:
            rows = select(RunValveRow.valve).where(
                RunValveRow.run_id == run_id, RunValveRow.state == ValveState.DONE.value
            )
            return list(session.scalars(rows.order_by(RunValveRow.valve)))

    def set_aside(self, run_id: int, limit: int | None = None) -> list[SetAside]:
        """The valves of a run that were set aside, by id; at most ``limit``."""
        with self._transactions.reading() as session:
            rows = select(RunValveRow.valve, RunValveRow.reason).where(
                RunValveRow.run_id == run_id, RunValveRow.state == ValveState.SET_ASIDE.value
            )
            refused = session.execute(rows.order_by(RunValveRow.valve).limit(limit))
            return [SetAside(valve=valve, reason=reason) for valve, reason in refused]

    def find(self, run_id: int) -> StoredRun | None:
        """The run with this number, ``None`` where there is none."""
        with self._transactions.reading() as session:
            row = session.get(RunRow, run_id)
            return None if row is None else stored_run(row)

    def finish(
        self, run_id: int, state: RunState, *, reason: str = "", report: str | None = None
    ) -> StoredRun:
        """Record that a run is over, in which state, and count its screenings by verdict."""
        with self._transactions.writing("noting the run's end") as session:
            row = session.get_one(RunRow, run_id)
            row.state, row.finished = state.value, datetime.now(UTC)
            row.reason = reason or row.reason
            row.report = report or row.report
            row.counts = dict(count_verdicts(session, run_id))
            return stored_run(row)

    def ask_to_cancel(self, run_id: int, who: str) -> bool:
        """Ask for a run to be cancelled; false where it is unknown or over. A waiting run ends at
        once, a running one with the next heartbeat of its worker."""
        with self._transactions.writing(f"cancelling run {run_id}") as session:
            row = session.scalar(select(RunRow).where(RunRow.id == run_id).with_for_update())
            if row is None or row.state not in _GOING:
                return False
            row.cancel_asked_by = who or "somebody"
            if row.state == RunState.WAITING.value:
                row.state, row.finished = RunState.CANCELLED.value, datetime.now(UTC)
                row.reason = f"cancelled by {row.cancel_asked_by} before it began"
            return True

    def recent(self, limit: int = 100, *, schedule: str | None = None) -> list[StoredRun]:
        """The newest runs, newest first."""
        with self._transactions.reading() as session:
            statement = select(RunRow).order_by(RunRow.id.desc()).limit(limit)
            if schedule is not None:
                statement = statement.where(RunRow.schedule == schedule)
            return [stored_run(row) for row in session.scalars(statement)]

    def going(self) -> list[StoredRun]:
        """Waiting and running runs, oldest first."""
        with self._transactions.reading() as session:
            rows = select(RunRow).where(RunRow.state.in_(_GOING)).order_by(RunRow.id)
            return [stored_run(row) for row in session.scalars(rows)]


def end_lost(session: Session, now: datetime) -> None:
    """End runs of the command line whose process was killed before it could record the end.

    Such runs have no heartbeat. Whether a process on another machine still runs is unknown; after
    a day its run counts as lost, and if it finishes after all, it records that itself.
    """
    without_heartbeat = (RunRow.state == RunState.RUNNING.value, RunRow.heartbeat.is_(None))
    old = RunRow.started < now - LOST_AFTER
    for row in session.scalars(
        select(RunRow).where(*without_heartbeat, or_(old, RunRow.owner.in_(_ended(session))))
    ):
        row.state, row.finished = RunState.FAILED.value, now
        row.reason = "its process ended before the run was over; what it had saved is kept"
        row.counts = dict(count_verdicts(session, row.id))


def _ended(session: Session) -> list[str]:
    """Processes that have a run and are known to have ended."""
    running = select(RunRow.owner).where(RunRow.state == RunState.RUNNING.value).distinct()
    return [owner for owner in session.scalars(running) if owner and has_ended(owner)]


def mark(session: Session, run_id: int, valve: str, state: ValveState, reason: str) -> None:
    """Record the state of one valve within a session and update the run's counts."""
    key = (RunValveRow.run_id == run_id, RunValveRow.valve == valve)
    changed = session.execute(
        update(RunValveRow)
        .where(*key, RunValveRow.state == ValveState.PENDING.value)
        .values(state=state.value, reason=reason, finished=datetime.now(UTC))
        .returning(RunValveRow.valve)
    ).all()
    if not changed:
        return
    aside: ColumnElement[int] | int = int(state is ValveState.SET_ASIDE)
    session.execute(
        update(RunRow)
        .where(RunRow.id == run_id)
        .values(done=RunRow.done + 1, set_aside=RunRow.set_aside + aside)
    )


def _pending(run_id: int, valve: str) -> dict[str, object]:
    return {
        "run_id": run_id,
        "valve": valve,
        "state": ValveState.PENDING.value,
        "reason": "",
        "finished": None,
    }


def _going(session: Session, schedule: str | None) -> int | None:
    if schedule is None:
        return None
    return session.scalar(
        select(RunRow.id)
        .where(RunRow.schedule == schedule, RunRow.state.in_(_GOING))
        .order_by(RunRow.id.desc())
        .limit(1)
    )
