"""How the store speaks to SQLite and PostgreSQL: engines, transactions, column types."""
