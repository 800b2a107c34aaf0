"""Why a screening has no verdict, as a word beside the sentence."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

from stemwatch.service.store.database.columns import CleanText

revision = "0013"
down_revision = "0012"
branch_labels = None
depends_on = None

# What older versions told by the sentence alone, where it asks for work at the valve.
SAID = (
    ("there is no valve position in this recording", "no_position"),
    ("the position did not change by one digit", "position_frozen"),
    ("the position reading was frozen for", "position_frozen"),
    ("the position shows nothing but its noise", "position_still"),
    ("repeats OP sample for sample", "position_is_op"),
    ("the position falls when OP rises", "position_reversed"),
    ("the position does not go with OP", "position_unrelated"),
    ("the position moves as fast as OP says", "position_sums_op"),
    ("so OP and position cannot be compared", "position_unit"),
    ("% of the samples are missing or marked bad", "bad_samples"),
    ("so S and J would mean nothing", "friction_does_not_explain"),
)


def upgrade() -> None:
    op.add_column("screenings", sa.Column("no_verdict", CleanText(), nullable=True))
    screenings = sa.table(
        "screenings",
        sa.column("verdict", sa.Text),
        sa.column("reason", sa.Text),
        sa.column("no_verdict", sa.Text),
    )
    told = [(screenings.c.reason.contains(words, autoescape=True), slug) for words, slug in SAID]
    undetermined = screenings.c.verdict == "undetermined"
    op.execute(screenings.update().where(undetermined).values(no_verdict=sa.case(*told)))


def downgrade() -> None:
    op.drop_column("screenings", "no_verdict")
