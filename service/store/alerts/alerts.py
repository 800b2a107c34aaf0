"""``Alerts``: raised alerts, who acknowledged them, and why they were closed.

A unique index allows one open alert for each cause: raising it again only updates its ``seen``.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from enum import StrEnum
from typing import Any

from sqlalchemy import ColumnElement, and_, func, or_, select
from sqlalchemy.orm import Session

from stemwatch.service.plant_path import WHOLE_PLANT, PartOfPlant
from stemwatch.service.presenter.alert_history import last_opened_again, when_raised
from stemwatch.service.store.alerts.tables import AlertRow
from stemwatch.service.store.database.insert_or_update import upsert
from stemwatch.service.store.database.transactions import Transactions
from stemwatch.service.store.errors import NotThere
from stemwatch.service.store.screenings.part_of_plant import in_part
from stemwatch.service.store.screenings.ranking import read_places
from stemwatch.service.store.screenings.screenings import ensure_valve
from stemwatch.service.store.screenings.tables import ValveRow
from stemwatch.service.store.storable import from_row


class AlertKind(StrEnum):
    """What an alert is about."""

    STICKY = "sticky"  # the verdict became sticky
    FORESEEN = "foreseen"  # S will probably reach the limit of sticky within some weeks
    GROWN = "grown"  # S is significantly larger than in the baseline's window
    BASELINE = "baseline"  # MV no longer follows the baseline network
    MISMATCH = "mismatch"  # an effect beside S and J was named
    SUSPECTED = "suspected"  # sticking suspected from OP and PV alone; only if the plant asks
    NO_DATA = "no_data"  # a source delivers nothing
    COMMON = "common"  # the same finding on many valves at once


class AlertSeverity(StrEnum):
    """How urgent an alert is, the most urgent first."""

    HIGH = "high"
    MEDIUM = "medium"
    LOW = "low"


@dataclass(frozen=True, kw_only=True)
class RaisedAlert:
    """An alert to be raised; alerts with the same ``cause`` are the same alert.

    ``formerly`` are causes under which an alert about the same problem may be open. The oldest of
    these becomes this alert and keeps its acknowledgements; the others are closed as part of it.
    Alerts marked as false alarms are left unchanged. ``again`` are causes under which an alert
    about the same problem may have closed: the last of these that was found in a window after
    ``again_since`` is opened again.
    """

    cause: str
    kind: AlertKind
    severity: AlertSeverity
    text: str
    valve: str | None = None
    source: str | None = None
    run_id: int | None = None
    evidence: Mapping[str, Any] = field(default_factory=dict)
    formerly: tuple[str, ...] = ()
    again: tuple[str, ...] = ()
    again_since: datetime | None = None


@dataclass(frozen=True, kw_only=True)
class StoredAlert:
    """An alert in its present state. Open until ``closed``."""

    id: int
    cause: str
    kind: AlertKind
    severity: AlertSeverity
    text: str
    valve: str | None
    source: str | None
    run_id: int | None
    evidence: Mapping[str, Any]
    opened: datetime
    seen: datetime
    closed: datetime | None
    closed_why: str
    acknowledged: datetime | None
    acknowledged_by: str
    comment: str
    snoozed_until: datetime | None
    snoozed_by: str
    false_alarm: bool
    told: datetime | None

    @property
    def opened_again(self) -> datetime | None:
        """When it was opened again after it had closed, the last time."""
        return last_opened_again(self.evidence)

    @property
    def S(self) -> float | None:
        """S in the window that the text is about, percent of OP span."""
        return self.evidence.get("S")

    @property
    def S_when_raised(self) -> float | None:
        """S in the window for which the alert was raised first, percent of OP span."""
        return when_raised(self.evidence)["S"]

    @property
    def first_step(self) -> str:
        """What to do first; empty for an alert of an earlier version, whose text says it."""
        return str(self.evidence.get("first_step", ""))

    @property
    def then(self) -> str:
        """What to do after the first step; empty where there is no more to say."""
        return str(self.evidence.get("then", ""))

    @property
    def parts(self) -> tuple[str, ...]:
        """What to have at hand for the work; empty where nothing is needed or known."""
        return tuple(self.evidence.get("parts", ()))


def to_do(first_step: str, then: str = "", parts: Sequence[str] = ()) -> dict[str, object]:
    """What to do about an alert and which parts to have at hand, as its evidence keeps it."""
    return {"first_step": first_step, "then": then, "parts": list(parts)}


JOINED = "part of another alert of this valve now, which has the same cause"
MOST_ALERTS = 200  # the largest number that is shown of one state
STATES = ("open", "acknowledged", "snoozed", "closed", "false", "all")


def state_of(alert: StoredAlert, now: datetime) -> str:
    """Which of ``STATES`` an alert is in; "closed" wins over everything else."""
    if alert.closed is not None:
        return "closed"
    if alert.false_alarm:
        return "false"
    if alert.snoozed_until is not None and alert.snoozed_until > now:
        return "snoozed"
    return "open" if alert.acknowledged is None else "acknowledged"


class Alerts:
    """The stored alerts. Methods raise ``StoreError``."""

    def __init__(self, transactions: Transactions) -> None:
        self._transactions = transactions

    def raise_all(self, alerts: Sequence[RaisedAlert]) -> list[int]:
        """Open an alert for each cause without an open one, or open the one again that closed
        lately; return the numbers of those."""
        with self._transactions.writing("raising alerts") as session:
            return [number for alert in alerts if (number := _raise(session, alert)) is not None]

    def clear(self, causes: Sequence[str], reason: str) -> list[StoredAlert]:
        """Close the open alerts with these causes and return them."""
        if not causes:
            return []
        with self._transactions.writing("closing alerts") as session:
            rows = session.scalars(
                select(AlertRow).where(AlertRow.closed.is_(None), AlertRow.cause.in_(causes))
            ).all()
            for row in rows:
                row.closed, row.closed_why = datetime.now(UTC), reason
            return [stored_alert(row) for row in rows]

    def acknowledge(self, alert: int, who: str, comment: str = "") -> StoredAlert:
        """Record who acknowledged the alert. It remains open until its cause is gone."""
        with self._changing(alert) as row:
            row.acknowledged, row.acknowledged_by = datetime.now(UTC), who
            row.comment = comment or row.comment
            return stored_alert(row)

    def snooze(self, alert: int, until: datetime, who: str) -> StoredAlert:
        """Silence the alert until ``until``."""
        with self._changing(alert) as row:
            row.snoozed_until, row.snoozed_by = until, who
            return stored_alert(row)

    def mark_false(self, alert: int, who: str, comment: str = "") -> StoredAlert:
        """Mark the alert as a false alarm. It is no longer listed as open, and not raised again
        until its cause was gone in between."""
        with self._changing(alert) as row:
            row.false_alarm = True
            row.acknowledged = row.acknowledged or datetime.now(UTC)
            row.acknowledged_by, row.comment = who, comment or row.comment
            return stored_alert(row)

    def get(self, alert: int) -> StoredAlert:
        """The alert with this number. Raises ``NotThere``."""
        with self._transactions.reading() as session:
            return stored_alert(_row(session, alert))

    def in_state(
        self,
        state: str,
        now: datetime,
        *,
        valve: str | None = None,
        part: PartOfPlant = WHOLE_PLANT,
    ) -> list[StoredAlert]:
        """The newest ``MOST_ALERTS`` alerts in one of ``STATES``; those not closed in the order of
        the ranking. With ``part`` only those about one of its valves."""
        statement = select(AlertRow).where(*_in_state(state, now))
        if valve is not None:
            statement = statement.where(AlertRow.valve == valve)
        if part:
            of_part = select(ValveRow.id).where(*in_part(part))
            statement = statement.where(AlertRow.valve.in_(of_part))
        newest = statement.order_by(AlertRow.opened.desc(), AlertRow.id.desc()).limit(MOST_ALERTS)
        with self._transactions.reading() as session:
            alerts = [stored_alert(row) for row in session.scalars(newest)]
            return alerts if state in ("closed", "all") else by_place(session, alerts)

    def count_open(self, now: datetime) -> int:
        """How many alerts are in the state "open"."""
        count_query = select(func.count()).select_from(AlertRow).where(*_in_state("open", now))
        with self._transactions.reading() as session:
            return session.scalar(count_query) or 0

    def open_by_valve(self, now: datetime) -> dict[str, int]:
        """How many alerts in the state "open" each valve has; valves without one are left out."""
        statement = select(AlertRow.valve, func.count()).where(
            *_in_state("open", now), AlertRow.valve.is_not(None)
        )
        with self._transactions.reading() as session:
            rows = session.execute(statement.group_by(AlertRow.valve))
            return {valve: count for valve, count in rows if valve is not None}

    def open_causes(self, prefixes: Sequence[str] = ()) -> set[str]:
        """The causes of alerts that are not closed, false alarms included."""
        statement = select(AlertRow.cause).where(AlertRow.closed.is_(None))
        if prefixes:
            begins = [AlertRow.cause.startswith(prefix, autoescape=True) for prefix in prefixes]
            statement = statement.where(or_(*begins))
        with self._transactions.reading() as session:
            return set(session.scalars(statement))

    @contextmanager
    def _changing(self, alert: int) -> Iterator[AlertRow]:
        with self._transactions.writing(f"changing alert {alert}") as session:
            yield _row(session, alert)


def _row(session: Session, alert: int) -> AlertRow:
    row = session.scalar(select(AlertRow).where(AlertRow.id == alert).with_for_update())
    if row is None:
        raise NotThere(f"there is no alert {alert}")
    return row


def _raise(session: Session, alert: RaisedAlert) -> int | None:
    """Open the alert and return its number; ``None`` where an alert about the same problem is open.
    That one is then updated to the present finding."""
    now = datetime.now(UTC)
    if alert.valve is not None:
        ensure_valve(session, alert.valve)
    former = and_(AlertRow.cause.in_(alert.formerly), AlertRow.false_alarm.is_(False))
    open_rows = session.scalars(
        select(AlertRow)
        .where(AlertRow.closed.is_(None), or_(AlertRow.cause == alert.cause, former))
        .order_by(AlertRow.cause != alert.cause, AlertRow.id)
        .with_for_update()
    ).all()
    for other in open_rows[1:]:
        other.closed, other.closed_why = now, JOINED
    if open_rows:
        _say_again(open_rows[0], alert, now)
        return None
    if (closed := _closed_lately(session, alert)) is not None:
        _open_again(closed, alert, now)
        return closed.id
    empty = ("closed_why", "acknowledged_by", "comment", "snoozed_by")
    values = {
        "cause": alert.cause,
        "kind": alert.kind.value,
        "severity": alert.severity.value,
        "text": alert.text,
        "valve": alert.valve,
        "source": alert.source,
        "run_id": alert.run_id,
        "evidence": dict(alert.evidence),
        "opened": now,
        "seen": now,
        "false_alarm": False,
        **dict.fromkeys(empty, ""),
    }
    statement = upsert(
        session,
        AlertRow,
        [values],
        ("cause",),
        update=False,
        condition=AlertRow.closed.is_(None),
        returning=AlertRow.id,
    )
    return session.execute(statement).scalar_one_or_none()


def by_place(session: Session, alerts: Sequence[StoredAlert]) -> list[StoredAlert]:
    """The alerts in the order of their valves in the ranking, after those that are about more than
    one valve; of one valve the most severe first."""
    places = read_places(session) if alerts else {}
    severities = list(AlertSeverity)

    def place(alert: StoredAlert) -> tuple[int, int, int]:
        of_valve = 0 if alert.valve is None else places.get(alert.valve, len(places) + 1)
        return of_valve, severities.index(alert.severity), alert.id

    return sorted(alerts, key=place)


def _say_again(row: AlertRow, alert: RaisedAlert, now: datetime) -> None:
    """Update the open alert ``row`` about the same problem as ``alert``: it tells the numbers of
    the newest window, and another kind only where that is the stronger one. An alert that became
    more urgent is sent to people once more."""
    row.seen = now
    renamed = row.cause != alert.cause
    if renamed or (alert.kind is AlertKind.STICKY and row.kind != alert.kind.value):
        order = list(AlertSeverity)
        if order.index(alert.severity) < order.index(AlertSeverity(row.severity)):
            row.told = None
        _say_now(row, alert, now)
    elif alert.evidence.get("window") is not None:
        last = {"last_window": alert.evidence["window"]}
        if row.kind == alert.kind.value and not row.false_alarm:
            row.text = alert.text
            row.evidence = {**alert.evidence, **_kept(row), **last}
        else:
            row.evidence = {**row.evidence, **last}


def _say_now(row: AlertRow, alert: RaisedAlert, now: datetime) -> None:
    """The row tells what ``alert`` does, and keeps what it told before."""
    kept = _kept(row)
    if row.kind != alert.kind.value or row.cause != alert.cause:
        before = {"kind": row.kind, "text": row.text, "until": now.isoformat()}
        kept["formerly"] = [*kept.get("formerly", ()), before]
    row.cause, row.kind, row.severity = alert.cause, alert.kind.value, alert.severity.value
    row.text, row.run_id = alert.text, alert.run_id
    row.evidence = {**alert.evidence, **kept}


def _kept(row: AlertRow) -> dict[str, Any]:
    """What stays in an alert's evidence when it tells of a newer window: what it was before, and S
    when it was raised."""
    earlier = ("formerly", "reopened")
    kept: dict[str, Any] = {key: row.evidence[key] for key in earlier if key in row.evidence}
    return {**kept, "when_raised": when_raised(row.evidence)}


def _closed_lately(session: Session, alert: RaisedAlert) -> AlertRow | None:
    """The last closed alert of the trouble that ``alert`` tells, where that is the same one; one
    that somebody called false, or that became part of another, is not."""
    if alert.again_since is None:
        return None
    newest = session.scalar(
        select(AlertRow)
        .where(
            AlertRow.closed.is_not(None),
            AlertRow.cause.in_(alert.again),
            AlertRow.closed_why != JOINED,
        )
        .order_by(AlertRow.closed.desc(), AlertRow.id.desc())
        .limit(1)
        .with_for_update()
    )
    if newest is None or newest.false_alarm:
        return None
    _, end = newest.evidence.get("last_window") or newest.evidence.get("window") or (None, None)
    told_last = None if end is None else datetime.fromisoformat(end)
    return newest if told_last is not None and told_last > alert.again_since else None


def _open_again(row: AlertRow, alert: RaisedAlert, now: datetime) -> None:
    """Open a closed alert again: whoever acknowledged it is kept, and people are told once more."""
    assert row.closed is not None
    period = {"closed": row.closed.isoformat(), "why": row.closed_why, "again": now.isoformat()}
    reopened = [*row.evidence.get("reopened", ()), period]
    _say_now(row, alert, now)
    row.evidence = {**row.evidence, "reopened": reopened}
    row.seen, row.closed, row.closed_why, row.told = now, None, "", None


def stored_alert(row: AlertRow) -> StoredAlert:
    """The row as a ``StoredAlert``."""
    return from_row(
        StoredAlert, row, kind=AlertKind(row.kind), severity=AlertSeverity(row.severity)
    )


def _in_state(state: str, now: datetime) -> list[ColumnElement[bool]]:
    if state == "all":
        return []
    if state == "closed":
        return [AlertRow.closed.is_not(None)]
    false_ones = AlertRow.false_alarm.is_(state == "false")
    alive: list[ColumnElement[bool]] = [AlertRow.closed.is_(None), false_ones]
    if state == "false":
        return alive
    if state == "snoozed":
        return [*alive, AlertRow.snoozed_until > now]
    awake = or_(AlertRow.snoozed_until.is_(None), AlertRow.snoozed_until <= now)
    seen = AlertRow.acknowledged
    return [*alive, awake, seen.is_not(None) if state == "acknowledged" else seen.is_(None)]
