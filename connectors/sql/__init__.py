"""SQL historians: any database that SQLAlchemy reaches, with a query template of the user's own.

``SqlArchive`` is the connector, ``SqlAddress`` how it travels. Parameters are bound, never
formatted into the text; the transaction is read only and never committed.
"""

from stemwatch.connectors.sql.connector import SqlAddress, SqlArchive

__all__ = ["SqlAddress", "SqlArchive"]
