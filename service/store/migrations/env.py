"""What Alembic runs: on the store's own connection, or from its command line on
``STEMWATCH_STORAGE_URL``."""

from __future__ import annotations

import os

from alembic import context
from sqlalchemy import Connection

from stemwatch.service.store.all_tables import metadata
from stemwatch.service.store.database.engine import for_writing, make_engine
from stemwatch.service.store.database_url import DatabaseUrl
from stemwatch.service.store.migrations.migrate import is_compared


def run(connection: Connection) -> None:
    """Run the migrations that were asked for."""
    context.configure(
        connection=connection,
        target_metadata=metadata,
        compare_type=True,
        include_object=is_compared,
    )
    with context.begin_transaction():
        context.run_migrations()


def run_from_command_line() -> None:
    """For ``alembic revision``, ``alembic check`` and the like."""
    url = os.environ.get("STEMWATCH_STORAGE_URL")
    if not url:
        raise SystemExit("set STEMWATCH_STORAGE_URL to the database that alembic shall work on")
    with for_writing(make_engine(DatabaseUrl(url))).begin() as connection:
        run(connection)


opened = context.config.attributes.get("connection")
if opened is None:
    run_from_command_line()
else:
    run(opened)
