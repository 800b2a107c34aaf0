"""Loops that oscillate together, kept from run to run."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

from stemwatch.service.store.database.columns import CleanJson, UtcDateTime

revision = "0010"
down_revision = "0009"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "oscillations",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("run_id", sa.Integer(), nullable=False),
        sa.Column("follows", sa.Integer(), nullable=True),
        sa.Column("at", UtcDateTime(), nullable=False),
        sa.Column("start", UtcDateTime(), nullable=True),
        sa.Column("duration_s", sa.Double(), nullable=False),
        sa.Column("period_s", sa.Double(), nullable=False),
        sa.Column("regularity", sa.Double(), nullable=False),
        sa.Column("outside", sa.Double(), nullable=False),
        sa.Column("since", UtcDateTime(), nullable=True),
        sa.Column("first_found", UtcDateTime(), nullable=True),
        sa.Column("windows", sa.Integer(), nullable=False),
        sa.Column("members", CleanJson(), nullable=False),
        sa.Column("pictures", CleanJson(), nullable=False),
        sa.ForeignKeyConstraint(
            ["run_id"], ["runs.id"], name="fk_oscillations_run_id_runs", ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("id", name="pk_oscillations"),
    )
    op.create_index("ix_oscillations_at", "oscillations", ["at"])
    op.create_index("ix_oscillations_run", "oscillations", ["run_id"])


def downgrade() -> None:
    op.drop_index("ix_oscillations_run", "oscillations")
    op.drop_index("ix_oscillations_at", "oscillations")
    op.drop_table("oscillations")
