"""``Store``: everything that is kept between runs, and the only access to it."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from datetime import UTC, datetime
from functools import partial
from types import MappingProxyType, TracebackType
from typing import Self

from sqlalchemy import Engine
from sqlalchemy.exc import OperationalError
from sqlalchemy.orm import Session

from stemwatch.connectors.secret import masked_command
from stemwatch.models.history.fall_of_stiction import UnexplainedFall
from stemwatch.models.history.trend_over_weeks import TrendOverWeeks
from stemwatch.models.limits import Limits
from stemwatch.models.oscillation_groups.plant_groups import OscillationGroup
from stemwatch.models.screening_result import PreviousFinding, Screening
from stemwatch.models.verdict import Verdict
from stemwatch.service.interruption import interrupts_held
from stemwatch.service.plant_path import PartOfPlant
from stemwatch.service.presenter.evidence_of_weeks import EvidenceOfWeeks, evidence_of_weeks
from stemwatch.service.presenter.work_counts import WorkCounts
from stemwatch.service.store.accounts.api_tokens import ApiTokens
from stemwatch.service.store.accounts.audit import AuditLog
from stemwatch.service.store.accounts.browser_sessions import WebSessions
from stemwatch.service.store.accounts.login_attempts import LoginAttempts
from stemwatch.service.store.accounts.one_time_links import AccessLinks
from stemwatch.service.store.accounts.users import Accounts
from stemwatch.service.store.alerts.alerts import Alerts
from stemwatch.service.store.alerts.deliveries import Deliveries
from stemwatch.service.store.database.engine import (
    error_text,
    existing_engine,
    make_engine,
    store_errors,
)
from stemwatch.service.store.database.transactions import Transactions, database_now
from stemwatch.service.store.database_url import DatabaseUrl
from stemwatch.service.store.errors import StoreError
from stemwatch.service.store.runs.browser_settings import BrowserSettings
from stemwatch.service.store.runs.leases import Leases
from stemwatch.service.store.runs.queue import RunQueue, end_lost
from stemwatch.service.store.runs.schedules import Schedules
from stemwatch.service.store.samples.samples import SampleStore
from stemwatch.service.store.samples.sources import Sources
from stemwatch.service.store.screenings import (
    baselines,
    daily_stiction,
    evidence,
    false_discoveries,
    feedback,
    history,
    oscillations,
    part_of_plant,
    pictures,
    ranking,
    recent,
    restored,
    screenings,
)
from stemwatch.service.store.screenings.earlier_answers import read_earlier_answers
from stemwatch.service.store.screenings.false_discoveries import StandingMark, TestedScreening
from stemwatch.service.store.screenings.feedback import Feedback, Judgement
from stemwatch.service.store.screenings.history import BaselineMark, HistoryPoint
from stemwatch.service.store.screenings.oscillations import KeptOscillation
from stemwatch.service.store.screenings.pictures import AroundWork
from stemwatch.service.store.screenings.previous import read_previous
from stemwatch.service.store.screenings.ranking import (
    LoopWithoutVerdict,
    RankingFilter,
    RankingPage,
)
from stemwatch.service.store.screenings.records import (
    Baseline,
    DescribedValve,
    EarlierAnswer,
    EarlierCurve,
    RecentOfValve,
    Remark,
    RunState,
    SaveFailure,
    SaveReport,
    StoredRun,
    StoredScreening,
    StoredValve,
    TrendPoint,
    UtcWindow,
)
from stemwatch.service.store.screenings.restored import Restored
from stemwatch.service.store.screenings.rows import stored_run
from stemwatch.service.store.screenings.tables import MaintenanceRow, NoteRow, RunRow

NO_COSTS: Mapping[str, float] = MappingProxyType({})
_GIVE_UP_AFTER = 3  # failed saves in a row after which the database counts as unavailable


def open_store(url: str | DatabaseUrl, *, synced: bool = False) -> Store:
    """Open the store at ``url``; its schema is created or upgraded where needed. ``synced``: a
    power cut loses nothing that was committed, in SQLite too, at the cost of waiting for the disk.

    Raises ``StoreError`` (passwords masked) when it cannot be reached or was written by a newer
    version of the program.
    """
    from stemwatch.service.store.migrations.migrate import upgrade

    address = url if isinstance(url, DatabaseUrl) else DatabaseUrl(url)
    engine = make_engine(address, synced=synced)
    try:
        upgrade(engine, address)
    except BaseException:
        engine.dispose()
        raise
    return Store(engine, address)


def open_existing_store(url: str | DatabaseUrl) -> Store:
    """Open an existing store, for commands that only read.

    Raises ``StoreError`` where there is no database or it holds no results of stemwatch, and as
    ``open_store`` does.
    """
    from stemwatch.service.store.migrations.migrate import current_revision

    address = url if isinstance(url, DatabaseUrl) else DatabaseUrl(url)
    engine = existing_engine(address)
    try:
        with store_errors(address, "opening the store"), engine.connect() as connection:
            made_by_us = current_revision(connection) is not None
    finally:
        engine.dispose()
    if not made_by_us:
        raise StoreError(
            f"{address}: this database is empty; expected one that `stemwatch screen` or "
            "`stemwatch serve` has written to. Look for a typing error in its name"
        )
    return open_store(address)


class Store:
    """Access to the database. Each method is one transaction; several threads and processes may
    write at the same time.

    The methods here are about valves, runs and screenings. The running service uses ``alerts``,
    ``browser_settings``, ``deliveries``, ``leases``, ``queue``, ``samples``, ``schedules`` and
    ``sources``; users and sign-in are in ``accounts``, ``access_links``, ``web_sessions``,
    ``api_tokens``, ``attempts`` and ``audit``. Times must have a zone and are
    returned in UTC. Methods raise ``StoreError``.
    """

    def __init__(self, engine: Engine, address: DatabaseUrl) -> None:
        self.address = address
        self.transactions = transactions = Transactions(engine, address)
        self.access_links = AccessLinks(transactions)
        self.accounts = Accounts(transactions)
        self.alerts = Alerts(transactions)
        self.api_tokens = ApiTokens(transactions)
        self.attempts = LoginAttempts(transactions)
        self.audit = AuditLog(transactions)
        self.browser_settings = BrowserSettings(transactions)
        self.deliveries = Deliveries(transactions)
        self.leases = Leases(transactions)
        self.queue = RunQueue(transactions)
        self.samples = SampleStore(transactions)
        self.schedules = Schedules(transactions)
        self.sources = Sources(transactions)
        self.web_sessions = WebSessions(transactions)

    def __repr__(self) -> str:
        return f"Store({str(self.address)!r})"

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close every connection."""
        self.transactions.readers.dispose()

    def begin_run(
        self,
        *,
        command: Sequence[str] = (),
        software_version: str,
        settings_digest: str = "",
        owner: str | None = None,
    ) -> int:
        """Record the start of a run by ``owner`` (a ``process_name``) and return its number.
        Secrets in ``command`` are masked. Runs whose process was killed are ended."""
        with self.transactions.writing("noting the run") as session:
            end_lost(session, database_now(session))
            run = RunRow(
                owner=owner,
                started=datetime.now(UTC),
                finished=None,
                command=masked_command(command),
                software_version=software_version,
                settings_digest=settings_digest,
                counts={},
                state=RunState.RUNNING.value,
            )
            session.add(run)
            session.flush()
            return run.id

    def finish_run(self, run_id: int) -> StoredRun:
        """Record the end of a run and count its screenings by verdict."""
        with self.transactions.writing("noting the run's end") as session:
            run = self._run(session, run_id)
            run.finished, run.state = datetime.now(UTC), RunState.DONE.value
            run.counts = dict(screenings.count_verdicts(session, run_id))
            return stored_run(run)

    def run(self, run_id: int) -> StoredRun:
        """The run with this number."""
        with self.transactions.reading() as session:
            return stored_run(self._run(session, run_id))

    def save(
        self,
        screening: Screening,
        run_id: int,
        baseline_id: int | None = None,
        packed_pictures: bytes = b"",
    ) -> int:
        """Save one screening and return its number; raises where ``save_many``, which runs use,
        reports. A screening of the same valve and window is replaced, by the last writer.
        ``baseline_id`` is the baseline that the screening was compared with."""
        with self.transactions.writing(f"saving {screening.valve}") as session:
            number = screenings.write_screening(session, screening, run_id, baseline_id)
            pictures.write_pictures(session, number, packed_pictures)
            return number

    def save_many(
        self,
        many: Iterable[Screening],
        run_id: int,
        baselines_of: Mapping[str, int] = MappingProxyType({}),
        packed_pictures: Sequence[bytes] = (),
    ) -> SaveReport:
        """Save each screening in a transaction of its own, so that one failure costs only itself.

        ``baselines_of`` gives the number of the baseline that each valve was compared with,
        ``packed_pictures`` what is kept of each screening for pictures, in the same order. After
        three saves in a row without an answer from the database the rest is not tried.
        """
        saved, unanswered = 0, 0
        failures: list[SaveFailure] = []
        kept = iter(packed_pictures)
        for place, screening in enumerate(many):
            packed = next(kept, b"")
            failed = partial(SaveFailure, valve=screening.valve, place=place)
            if unanswered >= _GIVE_UP_AFTER:
                failures.append(failed(reason="not tried: no answer"))
                continue
            try:
                with (
                    interrupts_held(),
                    Session(self.transactions.writers) as session,
                    session.begin(),
                ):
                    number = screenings.write_screening(
                        session, screening, run_id, baselines_of.get(screening.valve)
                    )
                    pictures.write_pictures(session, number, packed)
                saved, unanswered = saved + 1, 0
            except Exception as error:  # an error with one valve must not affect the others
                unanswered = unanswered + 1 if isinstance(error, OperationalError) else 0
                failures.append(failed(reason=error_text(error, self.address)))
        return SaveReport(saved=saved, failures=tuple(failures))

    def save_valves(self, valves: Iterable[DescribedValve]) -> None:
        """Store the valves as the plant file describes them; valves it no longer names are kept."""
        with self.transactions.writing("saving the valves") as session:
            screenings.write_valves(session, valves)

    def valves(self) -> list[StoredValve]:
        """Every valve, by id."""
        with self.transactions.reading() as session:
            return screenings.read_valves(session)

    def screenings(self, valve: str, limit: int = 50) -> list[StoredScreening]:
        """The valve's last screenings, newest first."""
        with self.transactions.reading() as session:
            return screenings.read_last(session, valve, limit)

    def packed_pictures(self, screening: int) -> bytes:
        """What is kept of a screening for its pictures; empty where nothing is."""
        with self.transactions.reading() as session:
            return pictures.read_pictures(session, screening)

    def work_compared(
        self, valves: Collection[str], until_run: int | None = None
    ) -> list[AroundWork]:
        """``around_work`` of each of ``valves`` that has it, as it was known at ``until_run``."""
        with self.transactions.reading() as session:
            return pictures.read_work_compared(session, valves, until_run)

    def around_work(self, valve: str) -> AroundWork | None:
        """The last work on the valve with what is kept of the windows before and after it."""
        with self.transactions.reading() as session:
            return pictures.read_around_work(session, valve)

    def earlier_curves(self, valve: str, limit: int = 3) -> list[EarlierCurve]:
        """The curves from OP to stroke that were found in the valve's last fitted windows, newest
        first."""
        with self.transactions.reading() as session:
            return screenings.read_curves(session, valve, limit)

    def earlier_answers(self, valve: str, run_id: int) -> list[EarlierAnswer]:
        """What OP and PV alone said in the valve's last windows of other runs than ``run_id``, the
        last first; those since its last maintenance that share no samples."""
        with self.transactions.reading() as session:
            return read_earlier_answers(session, valve, run_id)

    def worst_of_run(self, run_id: int, limit: int) -> list[str]:
        """The valves of a run, the one to work on first at the front."""
        with self.transactions.reading() as session:
            return ranking.read_worst(session, run_id, limit)

    def valve(self, valve: str) -> StoredValve | None:
        """The valve with this id, ``None`` where there is none."""
        with self.transactions.reading() as session:
            return screenings.read_valve(session, valve)

    def knows(self, valve: str) -> bool:
        """Whether there is a valve with this id."""
        with self.transactions.reading() as session:
            return screenings.is_known(session, valve)

    def levels(self) -> dict[str, tuple[str, ...]]:
        """The sites, areas and units that valves are in, by name."""
        with self.transactions.reading() as session:
            return part_of_plant.read_levels(session)

    def valves_in(self, part: PartOfPlant) -> list[str]:
        """The valves of a part of the plant, by id."""
        with self.transactions.reading() as session:
            return part_of_plant.read_valves_in(session, part)

    def ranking(
        self,
        ranking_filter: RankingFilter,
        costs: Mapping[str, float] = NO_COSTS,
        groups: Sequence[OscillationGroup] = (),
    ) -> RankingPage:
        """One page of valves, each with its latest screening; ``costs`` is what each costs a month,
        for an order by it, ``groups`` the loops that oscillate together at present."""
        with self.transactions.reading() as session:
            return ranking.read_ranking(session, ranking_filter, costs, groups)

    def without_verdict(self) -> list[LoopWithoutVerdict]:
        """The valves whose latest screening has no verdict, with what OP and PV alone say."""
        with self.transactions.reading() as session:
            return ranking.read_without_verdict(session)

    def made_by_sticking(self, valves: Sequence[str]) -> dict[str, dict[str, TrendPoint]]:
        """The indicators of what the sticking of each of ``valves`` makes of its loop, by its
        latest screening; valves without any are left out."""
        with self.transactions.reading() as session:
            return screenings.read_made_by_sticking(session, valves)

    def work_counts(self, until: datetime) -> WorkCounts:
        """How many valves needed work, by the latest screening that each had at ``until``."""
        with self.transactions.reading() as session:
            return WorkCounts.of_states(ranking.read_work_states(session, until))

    def screenings_of_run(self, run_id: int) -> list[Restored]:
        """Every screening of a run, for reports. Raises ``StoreError`` for an unknown run."""
        with self.transactions.reading("reading a run's screenings") as session:
            self._run(session, run_id)
            return restored.read_of_run(session, run_id)

    def latest_screenings(self) -> list[Restored]:
        """Each valve's latest screening, for reports."""
        with self.transactions.reading("reading the latest screenings") as session:
            return restored.read_latest_of_each(session)

    def recent(self, valves: Sequence[str], depth: int, indicator: str) -> dict[str, RecentOfValve]:
        """For each valve (a few hundred at a time): its last ``depth`` screenings, the values of
        one ``indicator``, S in the baseline's window, and the times of maintenance."""
        with self.transactions.reading() as session:
            return recent.read_recent(session, valves, depth, indicator)

    def trends(self, valves: Sequence[str], limits: Limits) -> dict[str, TrendOverWeeks]:
        """How S of each of ``valves`` changes over weeks, where that is known, and when it will
        reach the limit of sticky."""
        return self.trends_and_falls(valves, limits)[0]

    def trends_and_falls(
        self, valves: Sequence[str], limits: Limits
    ) -> tuple[dict[str, TrendOverWeeks], dict[str, UnexplainedFall]]:
        """``trends``, and for those of ``valves`` whose S fell in the last weeks without recorded
        work, that."""
        with self.transactions.reading() as session:
            return daily_stiction.read_trends(session, valves, limits.sticky_S_percent)

    def evidence(self, valves: Sequence[str]) -> dict[str, EvidenceOfWeeks]:
        """What the windows of the last weeks say together of those of ``valves`` on which one of
        them named an effect beside S and J since the last work."""
        with self.transactions.reading("reading the evidence of weeks") as session:
            windows = evidence.read_evidence(session, valves)
        evidence_of_valve = {
            valve: evidence_of_weeks(windows_of_valve)
            for valve, windows_of_valve in windows.items()
        }
        return {
            valve: evidence_found
            for valve, evidence_found in evidence_of_valve.items()
            if evidence_found is not None
        }

    def tested_of_run(self, run_id: int) -> list[TestedScreening]:
        """The screenings of a run in which an effect beside S and J could have been found."""
        with self.transactions.reading() as session:
            return false_discoveries.read_tested(session, run_id)

    def confirmed_in_run(self, run_id: int) -> set[str]:
        """The valves of a run on which the windows of weeks confirm an effect that stands among all
        of them, once that was marked."""
        with self.transactions.reading() as session:
            return false_discoveries.read_confirmed(session, run_id)

    def note_standing(self, run_id: int, marks: Mapping[int, StandingMark]) -> None:
        """Store, by screening number, what stands after false-discovery control over the run; a
        mark that says nothing removes an earlier one."""
        if marks:
            with self.transactions.writing(f"marking what run {run_id} found") as session:
                false_discoveries.write_marks(session, marks)

    def keep_oscillations(
        self, run_id: int, groups: Sequence[OscillationGroup]
    ) -> list[OscillationGroup]:
        """Keep the groups of loops of a run that oscillate together, instead of those it had; the
        same groups with since when and in how many windows each was found."""
        with self.transactions.writing(f"keeping the oscillations of run {run_id}") as session:
            return oscillations.write_oscillations(session, run_id, groups)

    def oscillations(self, now: datetime) -> list[KeptOscillation]:
        """The oscillations of several loops that were found in the 30 days before the newest
        results, those that stand first, each with what its pictures need."""
        with self.transactions.reading("reading the oscillations of loops") as session:
            return oscillations.read_oscillations(session, now)

    def oscillations_of(self, loop: str, now: datetime) -> list[OscillationGroup]:
        """The groups that oscillate at present of which ``loop`` is a member, without pictures."""
        with self.transactions.reading("reading the oscillations of a loop") as session:
            kept_oscillations = oscillations.read_oscillations(session, now, loop, pictures=False)
        return [oscillation.group for oscillation in kept_oscillations if not oscillation.over]

    def previous_finding(
        self, screening: Screening, now: datetime | None = None
    ) -> PreviousFinding | None:
        """The result of the valve's previous window; see ``previous_findings``."""
        earlier = self.previous_findings(screening, limit=1, now=now)
        return earlier[0] if earlier else None

    def previous_findings(
        self, screening: Screening, *, limit: int, now: datetime | None = None
    ) -> list[PreviousFinding]:
        """The results of the valve's earlier windows, newest first.

        For a screening without dates, "earlier" means saved before ``now``, or, where ``now`` is
        not given, before the screening itself was saved.
        """
        with self.transactions.reading() as session:
            return read_previous(session, screening, limit, now)

    def indicators(self, screening_id: int) -> Mapping[str, TrendPoint]:
        """The indicators of one screening, by name."""
        with self.transactions.reading() as session:
            return history.read_indicators(session, screening_id)

    def s_and_j(self, valve: str, since: datetime | None = None) -> list[HistoryPoint]:
        """S and J of the valve's screenings, oldest first; the newest few thousand of them."""
        with self.transactions.reading() as session:
            return history.read_history(session, valve, since)

    def baseline_marks(self, valve: str) -> list[BaselineMark]:
        """The valve's baselines, present and former, without their networks, oldest first."""
        with self.transactions.reading() as session:
            return history.read_baseline_marks(session, valve)

    def baseline(self, valve: str) -> Baseline | None:
        """The baseline network that the valve is compared with, its window and its reason."""
        with self.transactions.reading() as session:
            return baselines.read_network(session, valve, baselines.BASELINE)

    def set_baseline(
        self, valve: str, network: bytes, *, window: UtcWindow = (None, None), reason: str
    ) -> None:
        """Make ``network`` the valve's baseline; the former one is kept as inactive.

        ``reason`` is shown to people, such as "first healthy window after maintenance".
        """
        with self.transactions.writing(f"setting the baseline of {valve}") as session:
            baselines.write_network(session, valve, baselines.BASELINE, network, window, reason)

    def fitted(self, valve: str) -> Baseline | None:
        """The network that was last fitted to the valve."""
        with self.transactions.reading() as session:
            return baselines.read_network(session, valve, baselines.FITTED)

    def set_fitted(
        self, valve: str, network: bytes, *, window: UtcWindow = (None, None), reason: str
    ) -> None:
        """Store the last fitted network; the one before is deleted."""
        with self.transactions.writing(f"saving the network of {valve}") as session:
            baselines.write_network(session, valve, baselines.FITTED, network, window, reason)

    def record_maintenance(self, valve: str, at: datetime, note: str, who: str = "") -> None:
        """Record work on a valve. Until a baseline with a later window is set, ``baseline`` carries
        this record, since it describes the valve before the work."""
        with self.transactions.writing(f"recording maintenance of {valve}") as session:
            remark = Remark(valve=valve, at=at, note=note, who=who)
            baselines.write_remark(session, MaintenanceRow, remark)

    def maintenance(self, valve: str) -> list[Remark]:
        """Recorded maintenance of the valve, oldest first."""
        with self.transactions.reading() as session:
            return baselines.read_remarks(session, MaintenanceRow, valve)

    def work_without_note(self, valves: Sequence[str], writer: str) -> list[str]:
        """Those of ``valves`` whose last maintenance has no note by ``writer`` yet."""
        with self.transactions.reading() as session:
            return recent.read_work_without_note(session, valves, writer)

    def add_feedback(
        self, screening: int, at: datetime, judgement: Judgement, found: str, who: str = ""
    ) -> str:
        """Keep whether what a screening said was right, and what was found; its valve. Raises
        ``NotThere``."""
        with self.transactions.writing(f"keeping what was found of screening {screening}") as s:
            return feedback.write_feedback(s, screening, at, judgement, found, who)

    def feedback(self, valve: str | None = None, limit: int | None = None) -> list[Feedback]:
        """What people found, of one valve or of all, the newest first."""
        with self.transactions.reading() as session:
            return feedback.read_feedback(session, valve, limit)

    def count_feedback(self) -> Mapping[tuple[Verdict, Judgement], int]:
        """How often each verdict was said to be right or wrong."""
        with self.transactions.reading() as session:
            return feedback.count_feedback(session)

    def add_note(self, valve: str, at: datetime, note: str, who: str = "") -> None:
        """Add a note about a valve."""
        with self.transactions.writing(f"adding a note to {valve}") as session:
            baselines.write_remark(session, NoteRow, Remark(valve=valve, at=at, note=note, who=who))

    def notes(self, valve: str) -> list[Remark]:
        """Notes about the valve, oldest first."""
        with self.transactions.reading() as session:
            return baselines.read_remarks(session, NoteRow, valve)

    def _run(self, session: Session, run_id: int) -> RunRow:
        run = session.get(RunRow, run_id)
        if run is None:
            raise StoreError(f"{self.address}: there is no run {run_id}")
        return run
