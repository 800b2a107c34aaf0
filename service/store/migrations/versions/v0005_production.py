"""Views for other programs; on PostgreSQL samples in partitions by day, or in a hypertable.

On PostgreSQL the samples lose their two foreign keys: checking them costs as much as storing, and
no tag or reason is ever deleted while it is used. ``stemwatch db check`` looks for orphans.
"""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import sqlalchemy as sa
from alembic import op

from stemwatch.service.store.migrations import views_v1

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None

_DAY_US = 86_400_000_000
_DAYS = 400  # so many of the last days become partitions of their own
_COLUMNS = "tag_id, at_us, value, quality, reason_id"
_TABLE = (
    "CREATE TABLE samples (tag_id integer NOT NULL, at_us bigint NOT NULL, "
    "value double precision, quality smallint NOT NULL, reason_id integer, "
    "CONSTRAINT pk_samples PRIMARY KEY (tag_id, at_us))"
)
_FOREIGN_KEYS = (
    "ADD CONSTRAINT fk_samples_tag_id_tags FOREIGN KEY (tag_id) REFERENCES tags ON DELETE CASCADE",
    "ADD CONSTRAINT fk_samples_reason_id_sample_reasons FOREIGN KEY (reason_id) "
    "REFERENCES sample_reasons",
)
HYPERTABLE = (
    f"SELECT create_hypertable('samples', 'at_us', chunk_time_interval => BIGINT '{_DAY_US}', "
    "create_default_indexes => false)",
    "CREATE FUNCTION stemwatch_now_us() RETURNS bigint LANGUAGE sql STABLE AS "
    "$$ SELECT (extract(epoch FROM now()) * 1000000)::bigint $$",
    "SELECT set_integer_now_func('samples', 'stemwatch_now_us')",
)
# Not in TimescaleDB's Apache edition, which the hypertable does not need.
COMPRESSION = (
    "ALTER TABLE samples SET (timescaledb.compress, "
    "timescaledb.compress_segmentby = 'tag_id', timescaledb.compress_orderby = 'at_us')",
    f"SELECT add_compression_policy('samples', BIGINT '{7 * _DAY_US}')",
)


def upgrade() -> None:
    if op.get_bind().dialect.name == "postgresql":
        _set_aside()
        if _has_timescale():
            _hypertable()
        else:
            _partitions()
        _bring_back()
    for statement in views_v1.create(op.get_bind().dialect.name):
        op.execute(statement)


def downgrade() -> None:
    for statement in views_v1.drop():
        op.execute(statement)
    if op.get_bind().dialect.name == "postgresql":
        _set_aside()
        op.execute(_TABLE)
        _bring_back("WHERE tag_id IN (SELECT id FROM tags)")
        op.execute("DROP FUNCTION IF EXISTS stemwatch_now_us()")
        for key in _FOREIGN_KEYS:
            op.execute(f"ALTER TABLE samples {key}")


def _set_aside() -> None:
    op.execute("ALTER TABLE samples RENAME TO samples_before")
    op.execute("ALTER INDEX pk_samples RENAME TO pk_samples_before")


def _bring_back(which: str = "") -> None:
    op.execute(f"INSERT INTO samples ({_COLUMNS}) SELECT {_COLUMNS} FROM samples_before {which}")
    op.execute("DROP TABLE samples_before")


def _has_timescale() -> bool:
    extension = op.get_bind().execute(
        sa.text("SELECT count(*) FROM pg_extension WHERE extname = 'timescaledb'")
    )
    return bool(extension.scalar())


def _partitions() -> None:
    op.execute(f"{_TABLE} PARTITION BY RANGE (at_us)")
    op.execute("CREATE TABLE samples_default PARTITION OF samples DEFAULT")
    for day in _days():
        name = f"samples_{datetime(1970, 1, 1, tzinfo=UTC) + timedelta(days=day):%Y%m%d}"
        op.execute(
            f"CREATE TABLE {name} PARTITION OF samples "
            f"FOR VALUES FROM ({day * _DAY_US}) TO ({(day + 1) * _DAY_US})"
        )


def _days() -> list[int]:
    """The days of the samples that are there, as far as they are not too many."""
    today = int(datetime.now(UTC).timestamp()) // 86_400
    rows = op.get_bind().execute(
        sa.text(
            f"SELECT DISTINCT at_us / {_DAY_US} FROM samples_before "
            "WHERE at_us >= :first AND at_us < :stop ORDER BY 1"
        ),
        {"first": (today - _DAYS) * _DAY_US, "stop": (today + 8) * _DAY_US},
    )
    return [int(day) for day in rows.scalars()]


def _hypertable() -> None:
    op.execute(_TABLE)
    for statement in HYPERTABLE:
        op.execute(statement)
    bind = op.get_bind()
    try:
        with bind.begin_nested():
            for statement in COMPRESSION:
                bind.execute(sa.text(statement))
    except sa.exc.DBAPIError:
        return
