"""Tables of results: valves, runs, screenings, indicators, networks, maintenance and notes.

Times are UTC; names of numbers end in their unit. A change needs a migration.
"""

from __future__ import annotations

from datetime import datetime
from typing import Any

from sqlalchemy import ForeignKey, Index, UniqueConstraint, text
from sqlalchemy.orm import Mapped, mapped_column

from stemwatch.service.store.database.columns import TableBase, of_valve


class ValveRow(TableBase):
    """A valve as the plant file describes it."""

    __tablename__ = "valves"

    id: Mapped[str] = mapped_column(primary_key=True)
    description: Mapped[str] = mapped_column(default="")
    area: Mapped[str] = mapped_column(default="")
    criticality: Mapped[int] = mapped_column(default=2)
    # The other levels of its path by ISA-95.
    site: Mapped[str] = mapped_column(default="", server_default="")
    unit: Mapped[str] = mapped_column(default="", server_default="")
    loop: Mapped[str] = mapped_column(default="", server_default="")


class RunRow(TableBase):
    """One run over many valves: waiting, running or over.

    A run of the command line has no schedule and no rows in ``run_valves``. A schedule has one run
    for each ``due``, also where several services share the database.
    """

    __tablename__ = "runs"
    __table_args__ = (
        Index("ix_runs_state", "state", "not_before"),
        Index("uq_runs_schedule_due", "schedule", "due", unique=True),
    )

    id: Mapped[int] = mapped_column(primary_key=True)
    started: Mapped[datetime]
    finished: Mapped[datetime | None]
    command: Mapped[str]  # without secrets
    software_version: Mapped[str]
    settings_digest: Mapped[str]
    counts: Mapped[dict[str, Any]]  # screenings per verdict, known when the run has finished
    state: Mapped[str] = mapped_column(server_default="done")  # a ``RunState``
    schedule: Mapped[str | None]  # its name, or ``None`` for a run that a person requested
    due: Mapped[datetime | None]  # the instant of the schedule
    not_before: Mapped[datetime | None]  # ``due`` plus the schedule's jitter
    window_start: Mapped[datetime | None]
    window_stop: Mapped[datetime | None]
    asked: Mapped[list[str] | None]  # the requested valves; ``None``: those of the schedule
    who: Mapped[str] = mapped_column(server_default="")  # who requested it
    total: Mapped[int] = mapped_column(server_default="0")
    done: Mapped[int] = mapped_column(server_default="0")
    set_aside: Mapped[int] = mapped_column(server_default="0")
    owner: Mapped[str | None]  # the process that works on it
    heartbeat: Mapped[datetime | None]  # when that process last confirmed that it works on it
    cancel_asked_by: Mapped[str | None]
    reason: Mapped[str] = mapped_column(server_default="")  # why it was skipped, failed, cancelled
    report: Mapped[str | None]  # the folder of its report


class ScreeningRow(TableBase):
    """One screening of one valve and window. The same window screened again replaces its row.

    ``at`` is the end of the window, or the time of saving where the source has no dates. S and J
    are in percent of OP span.
    """

    __tablename__ = "screenings"
    __table_args__ = (
        UniqueConstraint("valve", "window_key"),
        Index("ix_screenings_valve_at", "valve", "at", "id"),
        Index("ix_screenings_run", "run_id"),
    )

    id: Mapped[int] = mapped_column(primary_key=True)
    valve: Mapped[str] = of_valve()
    run_id: Mapped[int] = mapped_column(ForeignKey("runs.id"))
    window_key: Mapped[str]
    window_start: Mapped[datetime | None]
    window_end: Mapped[datetime | None]
    at: Mapped[datetime]
    verdict: Mapped[str]
    no_verdict: Mapped[str | None]  # why it is undetermined: ``models.verdict.NoVerdict``
    reason: Mapped[str]
    advice: Mapped[str]
    shape: Mapped[str | None]
    severity: Mapped[float]
    confidence: Mapped[float | None]
    grade: Mapped[str]
    grade_reasons: Mapped[list[str]]
    s_percent: Mapped[float | None]
    s_low_percent: Mapped[float | None]
    s_high_percent: Mapped[float | None]
    s_reason: Mapped[str | None]
    j_percent: Mapped[float | None]
    j_low_percent: Mapped[float | None]
    j_high_percent: Mapped[float | None]
    j_reason: Mapped[str | None]
    residuals: Mapped[dict[str, Any]]
    still_seen: Mapped[list[str]]
    baseline_note: Mapped[str]
    source: Mapped[str]
    source_digest: Mapped[str]
    layout: Mapped[str]
    decisions: Mapped[list[str]]
    position_question: Mapped[str] = mapped_column(default="", server_default="")
    software_version: Mapped[str]
    settings_digest: Mapped[str]
    seconds: Mapped[float]
    baseline_id: Mapped[int | None]  # networks.id of the baseline that indicators refer to
    mismatch_finding: Mapped[str | None]  # ``None`` where nothing was fitted
    mismatch_slugs: Mapped[list[str] | None]  # of the effects that were named, in order of work
    mismatch: Mapped[dict[str, Any] | None]  # without samples
    open_question: Mapped[dict[str, Any] | None]  # for a test, where there is no ``mismatch``
    without_position: Mapped[dict[str, Any] | None]  # what OP and PV alone say
    histograms: Mapped[dict[str, Any] | None]  # where the stem stood, travelled and turned round
    # What it adds to the evidence of many windows; short, since weeks of it are read at once.
    evidence: Mapped[dict[str, Any] | None] = mapped_column(deferred=True)


class IndicatorRow(TableBase):
    """One indicator of one screening; valve and ``at`` are repeated here for the index by time."""

    __tablename__ = "indicators"
    __table_args__ = (Index("ix_indicators_trend", "valve", "name", "at"),)

    screening_id: Mapped[int] = mapped_column(
        ForeignKey("screenings.id", ondelete="CASCADE"), primary_key=True
    )
    name: Mapped[str] = mapped_column(primary_key=True)
    valve: Mapped[str] = of_valve()
    at: Mapped[datetime]
    value: Mapped[float | None]
    low: Mapped[float | None]
    high: Mapped[float | None]
    unit: Mapped[str]


class PictureRow(TableBase):
    """What is kept of a window for pictures that are drawn when its samples are gone, some KB."""

    __tablename__ = "pictures"

    screening_id: Mapped[int] = mapped_column(
        ForeignKey("screenings.id", ondelete="CASCADE"), primary_key=True
    )
    packed: Mapped[bytes]


class OscillationRow(TableBase):
    """Loops that oscillated together in the windows of one run, the likeliest source first.

    ``at`` is the end of their common record, or the time of saving where the source has no dates;
    ``follows`` the row of the same oscillation in the window before, where that is still kept.
    """

    __tablename__ = "oscillations"
    __table_args__ = (Index("ix_oscillations_at", "at"), Index("ix_oscillations_run", "run_id"))

    id: Mapped[int] = mapped_column(primary_key=True)
    run_id: Mapped[int] = mapped_column(ForeignKey("runs.id", ondelete="CASCADE"))
    follows: Mapped[int | None]
    at: Mapped[datetime]
    start: Mapped[datetime | None]
    duration_s: Mapped[float]
    period_s: Mapped[float]
    regularity: Mapped[float]
    outside: Mapped[float]
    since: Mapped[datetime | None]
    first_found: Mapped[datetime | None]
    windows: Mapped[int]
    members: Mapped[dict[str, Any]]
    pictures: Mapped[dict[str, Any]] = mapped_column(deferred=True)


class NetworkRow(TableBase):
    """A valve's NARX network. At most one of each kind is active; older baselines are kept."""

    __tablename__ = "networks"
    __table_args__ = (
        Index(
            "uq_networks_active",
            "valve",
            "kind",
            unique=True,
            sqlite_where=text("active"),
            postgresql_where=text("active"),
        ),
    )

    id: Mapped[int] = mapped_column(primary_key=True)
    valve: Mapped[str] = of_valve()
    kind: Mapped[str]  # "baseline" or "fitted"
    network: Mapped[bytes]
    created: Mapped[datetime]
    window_start: Mapped[datetime | None]
    window_end: Mapped[datetime | None]
    reason: Mapped[str]
    active: Mapped[bool]


class RemarkRow(TableBase):
    """The columns that maintenance and notes share."""

    __abstract__ = True

    id: Mapped[int] = mapped_column(primary_key=True)
    valve: Mapped[str] = mapped_column(ForeignKey("valves.id", ondelete="CASCADE"))
    at: Mapped[datetime]
    note: Mapped[str]
    who: Mapped[str]


class MaintenanceRow(RemarkRow):
    """Maintenance of a valve, after which its old baseline no longer describes it."""

    __tablename__ = "maintenance"
    __table_args__ = (Index("ix_maintenance_valve_at", "valve", "at"),)


class NoteRow(RemarkRow):
    """A note about a valve; it has no effect on verdicts or baselines."""

    __tablename__ = "notes"
    __table_args__ = (Index("ix_notes_valve_at", "valve", "at"),)


class FeedbackRow(TableBase):
    """Feedback on a finding, with the finding itself, so that the label stays valid when the
    screening is pruned or replaced."""

    __tablename__ = "feedback"
    __table_args__ = (Index("ix_feedback_valve_at", "valve", "at"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    valve: Mapped[str] = of_valve()
    at: Mapped[datetime]
    judgement: Mapped[str]  # a ``Judgement``
    found: Mapped[str]
    who: Mapped[str]
    screened: Mapped[datetime]  # what the screening stands for: the end of its window
    window_start: Mapped[datetime | None]
    window_end: Mapped[datetime | None]
    source: Mapped[str]
    verdict: Mapped[str]
    effects: Mapped[list[str]]
    s_percent: Mapped[float | None]
    j_percent: Mapped[float | None]
    software_version: Mapped[str]
