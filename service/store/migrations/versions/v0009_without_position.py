"""What OP and PV alone say of a valve, beside each screening."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

from stemwatch.service.store.database.columns import CleanJson

revision = "0009"
down_revision = "0008"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("screenings", sa.Column("without_position", CleanJson(), nullable=True))


def downgrade() -> None:
    op.drop_column("screenings", "without_position")
