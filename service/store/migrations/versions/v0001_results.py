"""Valves, runs, screenings and their indicators."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

from stemwatch.service.store.database.columns import CleanJson, CleanText, UtcDateTime

revision = "0001"
down_revision = None
branch_labels = None
depends_on = None


def upgrade() -> None:
    _valves()
    _runs()
    _screenings()
    _indicators()


def downgrade() -> None:
    for table in ("indicators", "screenings", "runs", "valves"):
        op.drop_table(table)


def _valves() -> None:
    op.create_table(
        "valves",
        sa.Column("id", CleanText(), nullable=False),
        sa.Column("description", CleanText(), nullable=False),
        sa.Column("area", CleanText(), nullable=False),
        sa.Column("criticality", sa.Integer(), nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_valves"),
    )


def _runs() -> None:
    op.create_table(
        "runs",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("started", UtcDateTime(), nullable=False),
        sa.Column("finished", UtcDateTime(), nullable=True),
        sa.Column("command", CleanText(), nullable=False),
        sa.Column("software_version", CleanText(), nullable=False),
        sa.Column("settings_digest", CleanText(), nullable=False),
        sa.Column("counts", CleanJson(), nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_runs"),
    )


def _screenings() -> None:
    op.create_table(
        "screenings",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("valve", CleanText(), nullable=False),
        sa.Column("run_id", sa.Integer(), nullable=False),
        sa.Column("window_key", CleanText(), nullable=False),
        sa.Column("window_start", UtcDateTime(), nullable=True),
        sa.Column("window_end", UtcDateTime(), nullable=True),
        sa.Column("at", UtcDateTime(), nullable=False),
        sa.Column("verdict", CleanText(), nullable=False),
        sa.Column("reason", CleanText(), nullable=False),
        sa.Column("advice", CleanText(), nullable=False),
        sa.Column("shape", CleanText(), nullable=True),
        sa.Column("severity", sa.Double(), nullable=False),
        sa.Column("confidence", sa.Double(), nullable=True),
        sa.Column("grade", CleanText(), nullable=False),
        sa.Column("grade_reasons", CleanJson(), nullable=False),
        *_estimate("s"),
        *_estimate("j"),
        sa.Column("residuals", CleanJson(), nullable=False),
        sa.Column("still_seen", CleanJson(), nullable=False),
        sa.Column("baseline_note", CleanText(), nullable=False),
        sa.Column("source", CleanText(), nullable=False),
        sa.Column("source_digest", CleanText(), nullable=False),
        sa.Column("layout", CleanText(), nullable=False),
        sa.Column("decisions", CleanJson(), nullable=False),
        sa.Column("software_version", CleanText(), nullable=False),
        sa.Column("settings_digest", CleanText(), nullable=False),
        sa.Column("seconds", sa.Double(), nullable=False),
        sa.ForeignKeyConstraint(
            ["valve"], ["valves.id"], name="fk_screenings_valve_valves", ondelete="CASCADE"
        ),
        sa.ForeignKeyConstraint(["run_id"], ["runs.id"], name="fk_screenings_run_id_runs"),
        sa.PrimaryKeyConstraint("id", name="pk_screenings"),
        sa.UniqueConstraint("valve", "window_key", name="uq_screenings_valve_window_key"),
    )
    op.create_index("ix_screenings_valve_at", "screenings", ["valve", "at", "id"])
    op.create_index("ix_screenings_run", "screenings", ["run_id"])


def _estimate(name: str) -> list[sa.Column[float] | sa.Column[str]]:
    return [
        sa.Column(f"{name}_percent", sa.Double(), nullable=True),
        sa.Column(f"{name}_low_percent", sa.Double(), nullable=True),
        sa.Column(f"{name}_high_percent", sa.Double(), nullable=True),
        sa.Column(f"{name}_reason", CleanText(), nullable=True),
    ]


def _indicators() -> None:
    op.create_table(
        "indicators",
        sa.Column("screening_id", sa.Integer(), nullable=False),
        sa.Column("name", CleanText(), nullable=False),
        sa.Column("valve", CleanText(), nullable=False),
        sa.Column("at", UtcDateTime(), nullable=False),
        sa.Column("value", sa.Double(), nullable=True),
        sa.Column("low", sa.Double(), nullable=True),
        sa.Column("high", sa.Double(), nullable=True),
        sa.Column("unit", CleanText(), nullable=False),
        sa.ForeignKeyConstraint(
            ["screening_id"],
            ["screenings.id"],
            name="fk_indicators_screening_id_screenings",
            ondelete="CASCADE",
        ),
        sa.ForeignKeyConstraint(
            ["valve"], ["valves.id"], name="fk_indicators_valve_valves", ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("screening_id", "name", name="pk_indicators"),
    )
    op.create_index("ix_indicators_trend", "indicators", ["valve", "name", "at"])
