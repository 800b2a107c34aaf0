"""The store: what every screening found, kept in SQLite or PostgreSQL, migrated by Alembic.

``stemwatch.service.store.store`` has ``open_store`` and ``Store``; this module imports nothing, so
that reading a plant file does not load a database library.
"""
