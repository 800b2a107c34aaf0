"""What the running service needs: samples, the queue of runs, schedules, alerts."""

from __future__ import annotations

from typing import Any

import sqlalchemy as sa
from alembic import op

from stemwatch.service.store.database.columns import CleanJson, CleanText, UtcDateTime

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None

_RUNS = [
    *("state", "schedule", "due", "not_before", "window_start", "window_stop", "asked", "who"),
    *("total", "done", "set_aside", "owner", "heartbeat", "cancel_asked_by", "reason", "report"),
]
_SCREENINGS = ("baseline_id", "mismatch_finding", "mismatch_slugs", "mismatch")
_TABLES = [
    *("deliveries", "alerts", "settings", "leases", "schedules", "run_valves", "taken_files"),
    *("source_states", "samples", "sample_reasons", "tags"),
]


def upgrade() -> None:
    _columns_of_runs()
    _columns_of_screenings()
    _samples()
    _sources()
    _run_valves()
    _schedules()
    _alerts()
    _deliveries()


def downgrade() -> None:
    for table in _TABLES:
        op.drop_table(table)
    op.drop_index("ix_runs_state", "runs")
    op.drop_index("uq_runs_schedule_due", "runs")
    for name in _RUNS:
        op.drop_column("runs", name)
    for name in _SCREENINGS:
        op.drop_column("screenings", name)


def _text(name: str, **how: Any) -> sa.Column[Any]:
    return sa.Column(name, CleanText(), nullable=False, **how)


def _text_or_null(name: str) -> sa.Column[Any]:
    return sa.Column(name, CleanText(), nullable=True)


def _whole(name: str, **how: Any) -> sa.Column[Any]:
    return sa.Column(name, sa.Integer(), nullable=False, **how)


def _time(name: str) -> sa.Column[Any]:
    return sa.Column(name, UtcDateTime(), nullable=False)


def _time_or_null(name: str) -> sa.Column[Any]:
    return sa.Column(name, UtcDateTime(), nullable=True)


def _json(name: str) -> sa.Column[Any]:
    return sa.Column(name, CleanJson(), nullable=False)


def _yes_or_no(name: str) -> sa.Column[Any]:
    return sa.Column(name, sa.Boolean(), nullable=False)


def _columns_of_runs() -> None:
    # The runs that are here already are over: whoever wrote them knew no other state.
    columns = [
        _text("state", server_default="done"),
        _text_or_null("schedule"),
        *(_time_or_null(name) for name in ("due", "not_before", "window_start", "window_stop")),
        sa.Column("asked", CleanJson(), nullable=True),
        _text("who", server_default=""),
        *(_whole(name, server_default="0") for name in ("total", "done", "set_aside")),
        _text_or_null("owner"),
        _time_or_null("heartbeat"),
        _text_or_null("cancel_asked_by"),
        _text("reason", server_default=""),
        _text_or_null("report"),
    ]
    for column in columns:
        op.add_column("runs", column)
    op.create_index("ix_runs_state", "runs", ["state", "not_before"])
    op.create_index("uq_runs_schedule_due", "runs", ["schedule", "due"], unique=True)


def _columns_of_screenings() -> None:
    op.add_column("screenings", sa.Column("baseline_id", sa.Integer(), nullable=True))
    op.add_column("screenings", _text_or_null("mismatch_finding"))
    op.add_column("screenings", sa.Column("mismatch_slugs", CleanJson(), nullable=True))
    op.add_column("screenings", sa.Column("mismatch", CleanJson(), nullable=True))


def _samples() -> None:
    op.create_table(
        "tags",
        _whole("id"),
        _text("source"),
        _text("name"),
        _text("unit"),
        sa.PrimaryKeyConstraint("id", name="pk_tags"),
        sa.UniqueConstraint("source", "name", name="uq_tags_source_name"),
    )
    op.create_table(
        "sample_reasons",
        _whole("id"),
        _text("words"),
        sa.PrimaryKeyConstraint("id", name="pk_sample_reasons"),
        sa.UniqueConstraint("words", name="uq_sample_reasons_words"),
    )
    op.create_table(
        "samples",
        _whole("tag_id", autoincrement=False),
        sa.Column("at_us", sa.BigInteger(), nullable=False, autoincrement=False),
        sa.Column("value", sa.Double(), nullable=True),
        sa.Column("quality", sa.SmallInteger(), nullable=False),
        sa.Column("reason_id", sa.Integer(), nullable=True),
        sa.ForeignKeyConstraint(
            ["tag_id"], ["tags.id"], name="fk_samples_tag_id_tags", ondelete="CASCADE"
        ),
        sa.ForeignKeyConstraint(
            ["reason_id"], ["sample_reasons.id"], name="fk_samples_reason_id_sample_reasons"
        ),
        sa.PrimaryKeyConstraint("tag_id", "at_us", name="pk_samples"),
        sqlite_with_rowid=False,
    )


def _sources() -> None:
    op.create_table(
        "source_states",
        _text("source"),
        _text("kind"),
        _text("address"),
        _time("updated"),
        _time_or_null("last_good"),
        _yes_or_no("connected"),
        _text("fault"),
        _json("figures"),
        sa.PrimaryKeyConstraint("source", name="pk_source_states"),
    )
    op.create_table(
        "taken_files",
        _text("digest"),
        _text("name"),
        _text("source"),
        _time("taken"),
        _yes_or_no("accepted"),
        sa.Column("samples", sa.BigInteger(), nullable=False),
        _text("note"),
        sa.PrimaryKeyConstraint("digest", name="pk_taken_files"),
    )


def _run_valves() -> None:
    op.create_table(
        "run_valves",
        _whole("run_id", autoincrement=False),
        _text("valve"),
        _text("state"),
        _text("reason"),
        _time_or_null("finished"),
        sa.ForeignKeyConstraint(
            ["run_id"], ["runs.id"], name="fk_run_valves_run_id_runs", ondelete="CASCADE"
        ),
        sa.ForeignKeyConstraint(
            ["valve"], ["valves.id"], name="fk_run_valves_valve_valves", ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("run_id", "valve", name="pk_run_valves"),
    )
    op.create_index("ix_run_valves_state", "run_valves", ["run_id", "state"])
    op.create_index("ix_run_valves_valve", "run_valves", ["valve"])


def _schedules() -> None:
    op.create_table(
        "schedules",
        _text("name"),
        _text("origin"),
        _text_or_null("cron"),
        sa.Column("every_s", sa.Double(), nullable=True),
        sa.Column("jitter_s", sa.Double(), nullable=False),
        sa.Column("window_s", sa.Double(), nullable=True),
        _json("areas"),
        _json("valves"),
        _yes_or_no("enabled"),
        _time("created"),
        _time_or_null("last_due"),
        _time_or_null("next_due"),
        sa.PrimaryKeyConstraint("name", name="pk_schedules"),
    )
    op.create_table(
        "leases",
        _text("name"),
        _text("owner"),
        _time("until"),
        sa.PrimaryKeyConstraint("name", name="pk_leases"),
    )
    op.create_table(
        "settings",
        _text("name"),
        _json("value"),
        _time("changed"),
        _text("who"),
        sa.PrimaryKeyConstraint("name", name="pk_settings"),
    )


def _alerts() -> None:
    op.create_table(
        "alerts",
        _whole("id"),
        _text("cause"),
        _text("kind"),
        _text_or_null("valve"),
        _text_or_null("source"),
        _text("severity"),
        _text("text"),
        _json("evidence"),
        sa.Column("run_id", sa.Integer(), nullable=True),
        _time("opened"),
        _time("seen"),
        _time_or_null("closed"),
        _text("closed_why"),
        _time_or_null("acknowledged"),
        _text("acknowledged_by"),
        _text("comment"),
        _time_or_null("snoozed_until"),
        _text("snoozed_by"),
        _yes_or_no("false_alarm"),
        _time_or_null("told"),
        sa.ForeignKeyConstraint(
            ["valve"], ["valves.id"], name="fk_alerts_valve_valves", ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("id", name="pk_alerts"),
    )
    open_ones = sa.text("closed IS NULL")
    op.create_index(
        "uq_alerts_open",
        "alerts",
        ["cause"],
        unique=True,
        sqlite_where=open_ones,
        postgresql_where=open_ones,
    )
    op.create_index("ix_alerts_closed_opened", "alerts", ["closed", "opened"])
    op.create_index("ix_alerts_valve", "alerts", ["valve", "opened"])


def _deliveries() -> None:
    op.create_table(
        "deliveries",
        _whole("id"),
        _text("notifier"),
        _text("key"),
        _json("message"),
        _time("created"),
        _whole("attempts"),
        _time("next_try"),
        _time_or_null("claimed_until"),
        _time_or_null("sent"),
        _yes_or_no("given_up"),
        _text("error"),
        sa.PrimaryKeyConstraint("id", name="pk_deliveries"),
        sa.UniqueConstraint("notifier", "key", name="uq_deliveries_notifier_key"),
    )
    op.create_index("ix_deliveries_due", "deliveries", ["sent", "next_try"])
