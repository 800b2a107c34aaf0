"""The database's schema as Alembic migrations, one for each version."""
