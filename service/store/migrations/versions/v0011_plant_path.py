"""The path of a valve by ISA-95, units of schedules, histograms of position; views of version 2
with that path and the state by NAMUR NE 107."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

from stemwatch.service.store.database.columns import CleanJson, CleanText
from stemwatch.service.store.migrations import views_v2

revision = "0011"
down_revision = "0010"
branch_labels = None
depends_on = None

_LEVELS = ("site", "unit", "loop")


def upgrade() -> None:
    for level in _LEVELS:
        op.add_column("valves", sa.Column(level, CleanText(), nullable=False, server_default=""))
    op.add_column("schedules", sa.Column("units", CleanJson(), nullable=False, server_default="[]"))
    op.add_column("screenings", sa.Column("histograms", CleanJson(), nullable=True))
    for statement in views_v2.create(op.get_bind().dialect.name):
        op.execute(statement)


def downgrade() -> None:
    for statement in views_v2.drop():
        op.execute(statement)
    op.drop_column("screenings", "histograms")
    op.drop_column("schedules", "units")
    for level in reversed(_LEVELS):
        op.drop_column("valves", level)
