"""What each window says of every effect, so that many windows can be weighed together."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

from stemwatch.service.store.database.columns import CleanJson

revision = "0006"
down_revision = "0005"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("screenings", sa.Column("evidence", CleanJson(), nullable=True))


def downgrade() -> None:
    op.drop_column("screenings", "evidence")
