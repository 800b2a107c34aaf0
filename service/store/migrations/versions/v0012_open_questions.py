"""What a test needs of a recording without a verdict, which tag may be its position, and how many
samples of a file are too old to stay."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

from stemwatch.service.store.database.columns import CleanJson, CleanText

revision = "0012"
down_revision = "0011"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("screenings", sa.Column("open_question", CleanJson(), nullable=True))
    op.add_column(
        "screenings",
        sa.Column("position_question", CleanText(), nullable=False, server_default=""),
    )
    op.add_column(
        "taken_files", sa.Column("too_old", sa.BigInteger(), nullable=False, server_default="0")
    )
    # Before, the note alone said it. How many is not needed of them: such a file may come again.
    op.execute(
        "UPDATE taken_files SET too_old = 1 WHERE accepted AND "
        "note LIKE '%are older than keep_samples_days =%'"
    )


def downgrade() -> None:
    op.drop_column("taken_files", "too_old")
    op.drop_column("screenings", "position_question")
    op.drop_column("screenings", "open_question")
