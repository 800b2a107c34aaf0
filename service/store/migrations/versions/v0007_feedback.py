"""What people found when they looked at a valve, beside what had been said of it."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

from stemwatch.service.store.database.columns import CleanJson, CleanText, UtcDateTime

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "feedback",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("valve", CleanText(), nullable=False),
        sa.Column("at", UtcDateTime(), nullable=False),
        sa.Column("judgement", CleanText(), nullable=False),
        sa.Column("found", CleanText(), nullable=False),
        sa.Column("who", CleanText(), nullable=False),
        sa.Column("screened", UtcDateTime(), nullable=False),
        sa.Column("window_start", UtcDateTime(), nullable=True),
        sa.Column("window_end", UtcDateTime(), nullable=True),
        sa.Column("source", CleanText(), nullable=False),
        sa.Column("verdict", CleanText(), nullable=False),
        sa.Column("effects", CleanJson(), nullable=False),
        sa.Column("s_percent", sa.Double(), nullable=True),
        sa.Column("j_percent", sa.Double(), nullable=True),
        sa.Column("software_version", CleanText(), nullable=False),
        sa.ForeignKeyConstraint(
            ["valve"], ["valves.id"], name="fk_feedback_valve_valves", ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("id", name="pk_feedback"),
    )
    op.create_index("ix_feedback_valve_at", "feedback", ["valve", "at"])


def downgrade() -> None:
    op.drop_index("ix_feedback_valve_at", "feedback")
    op.drop_table("feedback")
