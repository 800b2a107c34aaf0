"""Trial of the alerts over months: a simulated plant, one window a day, through the real schedule,
queue, run, store and rules, with a simulated clock.

Alerts are compared with what happened to each valve (``models.studies.simulator.valve_life``). An
alert is right where, on its day or one of the two days before, S of the valve was at least the
limit of watch or a defect was present; any other alert is false.
"""

from __future__ import annotations

import shutil
import threading
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np

from stemwatch.connectors.connector import ConnectorError
from stemwatch.models.history.trend_over_weeks import DAYS_A_MONTH
from stemwatch.models.recording import Floats, Role
from stemwatch.models.studies.simulator.valve_life import HEALTHY, ValveLife, draw_lives
from stemwatch.models.words import counted
from stemwatch.service.config import load_plant
from stemwatch.service.executors import Executor, map_in_order
from stemwatch.service.run.queue_worker import QueueWorker
from stemwatch.service.scheduler.scheduler import Scheduler
from stemwatch.service.store.alerts.alerts import AlertKind, StoredAlert
from stemwatch.service.store.screenings.records import RunState
from stemwatch.service.store.store import Store, open_store
from stemwatch.service.studies.simulated_archive import ROLES, ArchivePlan, Piece, write_parquet

BEGAN = datetime(2020, 1, 6, tzinfo=UTC)  # the simulated clock must not overtake the real one
RECORDED_AT = timedelta(hours=6)
WITHIN = 3  # windows after S crosses the limit, within which an alert is expected
LOOKS_BACK = 2  # windows before the newest that a rule looks at


@dataclass(frozen=True, kw_only=True)
class AlertPlan:
    """What is played: ``valves`` for ``days``, a window of ``window_s`` seconds a day, with or
    without training ``networks``."""

    valves: int = 48
    days: int = 90
    window_s: float = 1800.0
    seed: int = 2041
    networks: bool = False
    workers: int | None = None


@dataclass(frozen=True, kw_only=True)
class PlayedAlert:
    """One alert: the days (from 0) on which it was raised and closed, ``None`` while it is open;
    ``valves`` it speaks of, ``has_cause`` whether one of them had any. An alert without a cause
    that took another name when there was one is right since the day ``renamed``. ``opened_again``
    are the days on which it was opened again after it had closed, ``again_without_cause`` how many
    of these had no cause."""

    cause: str
    kind: AlertKind
    valves: tuple[str, ...]
    raised: int
    has_cause: bool
    text: str
    closed: int | None = None
    renamed: int | None = None
    opened_again: tuple[int, ...] = ()
    again_without_cause: int = 0

    @property
    def right_since(self) -> int | None:
        """The day since which the alert is right; ``None`` where it never was."""
        return self.raised if self.has_cause else self.renamed


@dataclass(frozen=True, kw_only=True)
class Played:
    """What happened to the valves, and every alert in the order in which it was raised."""

    plan: AlertPlan
    lives: tuple[ValveLife, ...]
    alerts: tuple[PlayedAlert, ...] = ()

    @property
    def healthy_months(self) -> float:
        """Valve-months without a cause for an alert."""
        days = sum(not life.has_cause(day) for life in self.lives for day in range(self.plan.days))
        return days / DAYS_A_MONTH

    @property
    def false_alerts(self) -> tuple[PlayedAlert, ...]:
        """The alerts without a cause; one that was opened again without a cause once for that."""
        return tuple(
            alert
            for alert in self.alerts
            for _ in range((not alert.has_cause) + alert.again_without_cause)
        )

    @property
    def opened_again(self) -> int:
        """How many times an alert that had closed was opened again."""
        return sum(len(alert.opened_again) for alert in self.alerts)

    def false_by_kind(self) -> dict[str, int]:
        """How many false alerts there are of each kind."""
        return dict(Counter(alert.kind.value for alert in self.false_alerts))

    def delays(self) -> dict[str, int | None]:
        """For each valve that crosses its limit with ``WITHIN`` windows to come: days from there to
        its first alert with a cause, at least 0; ``None`` where there was none."""
        delay_of_tag: dict[str, int | None] = {}
        for life in self.lives:
            crosses = life.crosses
            if crosses is None or crosses + WITHIN >= self.plan.days:
                continue
            days = [
                alert.right_since
                for alert in self.alerts
                if alert.right_since is not None and self._is_about(alert, life)
            ]
            delay_of_tag[life.tag] = max(min(days) - crosses, 0) if days else None
        return delay_of_tag

    def alerts_per_cause(self) -> float | None:
        """Alerts with a cause over the causes that had any; ``None`` where none had."""
        counts = [sum(self._is_about(alert, life) for alert in self.alerts) for life in self.lives]
        raised = [count for count in counts if count]
        return sum(raised) / len(raised) if raised else None

    def closed_after_repair(self) -> tuple[int, int, int]:
        """Of the alerts about valves that were repaired with ``LOOKS_BACK`` windows to come: how
        many closed by themselves after it, how many there are, and the most days that took."""
        days = [
            None if alert.closed is None else alert.closed - life.repaired
            for life in self.lives
            if life.repaired is not None and life.repaired + LOOKS_BACK < self.plan.days
            for alert in self.alerts
            if self._is_about(alert, life) and alert.raised < life.repaired
        ]
        closed = [day for day in days if day is not None]
        return len(closed), len(days), max(closed, default=0)

    def lines(self) -> list[str]:
        """The counts, a sentence each."""
        months, false = self.healthy_months, len(self.false_alerts)
        kinds = ", ".join(f"{kind} {count}" for kind, count in self.false_by_kind().items())
        rate = 100.0 * false / months if months else 0.0
        sentences = [
            f"{counted(false, 'alert')} without a cause in {months:.1f} healthy valve-months"
            f"{f' ({kinds})' if kinds else ''}: {rate:.1f} in 100"
        ]
        delays = list(self.delays().values())
        known_delays = [days for days in delays if days is not None]
        in_time = sum(days <= WITHIN for days in known_delays)
        if delays:
            delay_text = (
                "never" if not known_delays else f"median {np.median(known_delays):g} days after"
            )
            sentences.append(
                f"{in_time} of {len(delays)} valves that crossed their limit were alerted within "
                f"{WITHIN} windows ({len(delays) - len(known_delays)} not at all; {delay_text})"
            )
        per_cause = self.alerts_per_cause()
        if per_cause is not None:
            again = self.opened_again
            times = {0: "none of them", 1: "one"}.get(again, f"{again}")
            sentences.append(
                f"{per_cause:.2f} alerts for each cause that had any, {times} opened again after "
                "it had closed"
            )
        closed, total, days = self.closed_after_repair()
        if total:
            sentences.append(
                f"{closed} of {total} alerts about repaired valves closed by themselves, after "
                f"{counted(days, 'day')} at most"
            )
        return sentences

    @staticmethod
    def _is_about(alert: PlayedAlert, life: ValveLife) -> bool:
        told = alert.right_since is not None
        return told and life.tag in alert.valves and life.life not in HEALTHY


@dataclass(frozen=True)
class _Recorded:
    """One valve on one day, for a worker."""

    life: ValveLife
    day: int
    window_s: float


def play(
    plan: AlertPlan,
    folder: Path,
    executor: Executor,
    on_progress: Callable[[int], None] = lambda _: None,
) -> Played:
    """Play ``plan`` in ``folder``, where plant file, archive, database and reports come to lie.

    Windows are simulated in ``executor``; runs are the service's own. ``on_progress`` hears how
    many days are over.
    """
    lives = tuple(draw_lives(plan.valves, plan.days, plan.seed))
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "plant.toml").write_text(_plant_toml(plan, lives), encoding="utf-8")
    plant = load_plant(folder / "plant.toml", environment={})
    with open_store(plant.storage) as store:
        store.schedules.take_from_file(plant.schedules)
        (schedule,) = plant.schedules
        store.schedules.note(schedule.name, BEGAN, None)
        scheduler, worker = Scheduler(store, "UTC"), QueueWorker(store, plant)
        record = _AlertHistory(lives)
        for day in range(plan.days):
            _record(plan, lives, day, folder, executor)
            for life in lives:
                if day in life.worked:
                    instant = BEGAN + timedelta(days=day)
                    store.record_maintenance(life.tag, instant, "packing renewed", "trial")
            (number,) = scheduler.look(BEGAN + timedelta(days=day + 1, minutes=5))
            worker.once(threading.Event())
            _must_be_done(store, number, len(lives))
            record.note(store, day)
            shutil.rmtree(folder / "parquet" / f"date={_date(day)}", ignore_errors=True)
            on_progress(day + 1)
    return Played(plan=plan, lives=lives, alerts=tuple(record.alerts.values()))


class TrialFailed(ConnectorError):
    """A day's run did not screen every valve, so that its alerts cannot be counted."""


def _must_be_done(store: Store, number: int, valves: int) -> None:
    run = store.run(number)
    if run.state is not RunState.DONE or run.done != valves or run.set_aside:
        raise TrialFailed(
            f"run {number}: {run.done} of {valves} valves done, {run.set_aside} set aside, state "
            f"{run.state.value} {run.reason}".rstrip()
            + "; every valve of every day must be screened, so nothing is counted"
        )


@dataclass
class _AlertHistory:
    """Which alerts were raised and closed on which day."""

    lives: Sequence[ValveLife]
    alerts: dict[int, PlayedAlert] = field(default_factory=dict)

    def note(self, store: Store, day: int) -> None:
        """Compare what is stored with what was noted before."""
        now = datetime.now(UTC)
        for alert in store.alerts.in_state("all", now):
            played = self.alerts.get(alert.id)
            if played is None:
                self.alerts[alert.id] = played = self._played(alert, day)
            if alert.kind is not played.kind and played.right_since is None:
                now_told = self._played(alert, day)
                renamed = day if now_told.has_cause else None
                self.alerts[alert.id] = played = replace(played, renamed=renamed)
            again = len(alert.evidence.get("reopened", ()))
            if again > len(played.opened_again):
                self.alerts[alert.id] = played = replace(
                    played,
                    closed=None,
                    opened_again=(*played.opened_again, day),
                    again_without_cause=played.again_without_cause
                    + (not self._played(alert, day).has_cause),
                )
            if alert.closed is not None and played.closed is None:
                self.alerts[alert.id] = replace(played, closed=day)

    def _played(self, alert: StoredAlert, day: int) -> PlayedAlert:
        named = alert.evidence.get("valves", ())
        valves = (alert.valve,) if alert.valve else tuple(str(name) for name in named)
        seen = range(max(day - LOOKS_BACK, 0), day + 1)
        foreseen = alert.kind is AlertKind.FORESEEN
        caused = any(
            life.has_cause(when) or (foreseen and life.will_have_cause(when))
            for life in self.lives
            if life.tag in valves
            for when in seen
        )
        return PlayedAlert(
            cause=alert.cause,
            kind=alert.kind,
            valves=valves,
            raised=day,
            has_cause=caused,
            text=alert.text,
        )


def _record(
    plan: AlertPlan, lives: Sequence[ValveLife], day: int, folder: Path, executor: Executor
) -> None:
    """The window of ``day`` of every valve as a file of the archive."""
    jobs = [_Recorded(life, day, plan.window_s) for life in lives]
    columns = map_in_order(executor, _simulated, [(job,) for job in jobs], lambda _: None)
    start = BEGAN + timedelta(days=day) + RECORDED_AT
    archive = ArchivePlan(valves=len(lives), start=start)
    named = [(life.tag, signals) for life, signals in zip(lives, columns, strict=True)]
    write_parquet(Piece(archive, folder, 0, ()), named)


def _simulated(jobs: Sequence[_Recorded]) -> list[dict[Role, Floats]]:
    """OP, MV, PV and SP of each, percent; NaN where the archive marked them bad."""
    from stemwatch.models.studies.simulator import simulate_loop

    recorded = []
    for job in jobs:
        loop = job.life.on(job.day, job.window_s)
        seed = int(np.random.default_rng([job.life.seed, job.day, 3]).integers(2**31))
        signals = simulate_loop(loop, seed).recording.signals
        recorded.append(
            {
                role: np.where(signals[role].usable, signals[role].values, np.nan)
                for role in ROLES
                if role in signals
            }
        )
    return recorded


def _date(day: int) -> str:
    return f"{BEGAN + timedelta(days=day):%Y-%m-%d}"


def _plant_toml(plan: AlertPlan, lives: Sequence[ValveLife]) -> str:
    lines = [
        '[plant]\nname = "Alert trial (simulated)"\nzone = "UTC"\n',
        '[storage]\nurl = "sqlite:///alerts.db"\n',
        f"[service]\nnetworks = {str(plan.networks).lower()}",
        "report_valves = 1\nkeep_reports = 1",
        f"workers = {plan.workers or 2}\n",
        '[[schedules]]\nname = "daily"\ncron = "0 0 * * *"\nwindow_s = 86400.0\n',
        '[[sources]]\nname = "archive"\nkind = "parquet"\npath = "parquet"',
    ]
    for index, life in enumerate(lives):
        lines.append(f'\n[[valves]]\nid = "{life.tag}"\narea = "Area {index % 6 + 1}"')
        lines.append('source = "archive"')
        lines += [
            f'tags.{role.value} = {{ tag = "{life.tag}.{role.value}", unit = "%" }}'
            for role in ROLES
        ]
    return "\n".join(lines) + "\n"
