"""The schema in steps, each from one version of the database to the next, as Alembic runs them."""
