"""``RunQueue``: runs that wait, go on or are over, and who works on each.

A run is a row from the moment it is due. Whoever works on it says so every few seconds; a run
whose worker has fallen silent is taken over by the next one, which does what was left.
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
from stemwatch.service.store.screenings.records import RunState, StoredRun, ValveState
from stemwatch.service.store.screenings.rows import stored_run
from stemwatch.service.store.screenings.screenings import count_verdicts, ensure_valve
from stemwatch.service.store.screenings.tables import RunRow

EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
SILENT_AFTER = timedelta(seconds=30)
LOST_AFTER = timedelta(days=1)
_GOING = (RunState.WAITING.value, RunState.RUNNING.value)
_IN_ONE_STATEMENT = 500


@dataclass(frozen=True, kw_only=True)
class RunToQueue:
    """A run to be queued. ``valves`` empty: what its schedule says, or all.

    ``window`` start and stop, either open; ``schedule`` and ``due`` ``None`` where a person asked.
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

    def put(self, wanted: RunToQueue, *, software_version: str) -> int | None:
        """Queue a run; its number, or ``None`` where this schedule's instant is queued already.

        A schedule whose run before still waits or goes on does not run twice at a time: the new
        instant is noted as skipped, so that every instant is accounted for.
        """
        with self._transactions.writing("queueing a run") as session:
            going = _going(session, wanted.schedule)
            now = database_now(session)
            values: dict[str, object] = {
                "started": now,
                "finished": None if going is None else now,
                "command": "",
                "software_version": software_version,
                "settings_digest": "",
                "counts": {},
                "state": (RunState.WAITING if going is None else RunState.SKIPPED).value,
                "schedule": wanted.schedule,
                "due": wanted.due,
                "not_before": wanted.not_before,
                "window_start": wanted.window[0],
                "window_stop": wanted.window[1],
                "asked": list(wanted.valves) or None,
                "who": wanted.who,
                "reason": wanted.reason
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
        """The next run to work on, now ``owner``'s, or ``None``.

        First one whose worker has fallen silent or is known to have ended, then the oldest that
        may begin. Two processes never get the same one.
        """
        with self._transactions.writing("taking a run from the queue") as session:
            now = database_now(session)
            end_lost(session, now)
            silent = and_(
                RunRow.state == RunState.RUNNING.value,
                RunRow.heartbeat.is_not(None),
                or_(RunRow.heartbeat < now - silent_after, RunRow.owner.in_(_ended(session))),
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
        """Say that ``owner`` still works on the run; ``None`` where it is no longer its own."""
        with self._transactions.writing("a run's sign of life") as session:
            row = session.scalar(select(RunRow).where(RunRow.id == run_id).with_for_update())
            if row is None or row.owner != owner or row.state != RunState.RUNNING.value:
                return None
            row.heartbeat = database_now(session)
            return stored_run(row)

    def leave(self, run_id: int, owner: str) -> None:
        """Let a run lie for the next process, which need not wait for ``owner`` to fall silent."""
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
        """Note which valves the run has to do, once; those that are left, in order."""
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
            left = select(RunValveRow.valve).where(
                RunValveRow.run_id == run_id, RunValveRow.state == ValveState.PENDING.value
            )
            return list(session.scalars(left.order_by(RunValveRow.valve)))

    def mark(self, run_id: int, valve: str, state: ValveState, reason: str = "") -> None:
        """What became of one valve. A second time it changes nothing."""
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
        """The run of this number, ``None`` where there is none."""
        with self._transactions.reading() as session:
            row = session.get(RunRow, run_id)
            return None if row is None else stored_run(row)

    def finish(
        self, run_id: int, state: RunState, *, reason: str = "", report: str | None = None
    ) -> StoredRun:
        """Note that a run is over, how, and how many screenings had each verdict."""
        with self._transactions.writing("noting the run's end") as session:
            row = session.get_one(RunRow, run_id)
            row.state, row.finished = state.value, datetime.now(UTC)
            row.reason = reason or row.reason
            row.report = report or row.report
            row.counts = dict(count_verdicts(session, run_id))
            return stored_run(row)

    def ask_to_cancel(self, run_id: int, who: str) -> bool:
        """Ask that a run ends early; whether it was there to be cancelled. One that still waits is
        over at once, one that goes on when its worker hears of it."""
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
        """Runs that wait or go on, oldest first."""
        with self._transactions.reading() as session:
            rows = select(RunRow).where(RunRow.state.in_(_GOING)).order_by(RunRow.id)
            return [stored_run(row) for row in session.scalars(rows)]


def end_lost(session: Session, now: datetime) -> None:
    """End runs of the command line whose process was killed before it could say so.

    They give no sign of life. Of a process of another machine nobody knows whether it goes on;
    after a day it counts as lost, and should it end after all, it says so itself.
    """
    alone = (RunRow.state == RunState.RUNNING.value, RunRow.heartbeat.is_(None))
    old = RunRow.started < now - LOST_AFTER
    for row in session.scalars(
        select(RunRow).where(*alone, or_(old, RunRow.owner.in_(_ended(session))))
    ):
        row.state, row.finished = RunState.FAILED.value, now
        row.reason = "its process ended before the run was over; what it had saved is kept"
        row.counts = dict(count_verdicts(session, row.id))


def _ended(session: Session) -> list[str]:
    """Processes that have a run and are known to have ended."""
    running = select(RunRow.owner).where(RunRow.state == RunState.RUNNING.value).distinct()
    return [owner for owner in session.scalars(running) if owner and has_ended(owner)]


def mark(session: Session, run_id: int, valve: str, state: ValveState, reason: str) -> None:
    """What became of one valve, inside a session; the run's counts follow."""
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
