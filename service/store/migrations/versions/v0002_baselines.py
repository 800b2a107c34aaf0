"""Networks, maintenance and notes."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

from stemwatch.service.store.database.columns import CleanText, UtcDateTime

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "networks",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("valve", CleanText(), nullable=False),
        sa.Column("kind", CleanText(), nullable=False),
        sa.Column("network", sa.LargeBinary(), nullable=False),
        sa.Column("created", UtcDateTime(), nullable=False),
        sa.Column("window_start", UtcDateTime(), nullable=True),
        sa.Column("window_end", UtcDateTime(), nullable=True),
        sa.Column("reason", CleanText(), nullable=False),
        sa.Column("active", sa.Boolean(), nullable=False),
        sa.ForeignKeyConstraint(
            ["valve"], ["valves.id"], name="fk_networks_valve_valves", ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("id", name="pk_networks"),
    )
    op.create_index(
        "uq_networks_active",
        "networks",
        ["valve", "kind"],
        unique=True,
        sqlite_where=sa.text("active"),
        postgresql_where=sa.text("active"),
    )
    _remarks("maintenance")
    _remarks("notes")


def downgrade() -> None:
    for table in ("notes", "maintenance", "networks"):
        op.drop_table(table)


def _remarks(table: str) -> None:
    op.create_table(
        table,
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("valve", CleanText(), nullable=False),
        sa.Column("at", UtcDateTime(), nullable=False),
        sa.Column("note", CleanText(), nullable=False),
        sa.Column("who", CleanText(), nullable=False),
        sa.ForeignKeyConstraint(
            ["valve"], ["valves.id"], name=f"fk_{table}_valve_valves", ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("id", name=f"pk_{table}"),
    )
    op.create_index(f"ix_{table}_valve_at", table, ["valve", "at"])
