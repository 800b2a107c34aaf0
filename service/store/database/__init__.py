"""What all parts of the store share: engines for SQLite and PostgreSQL, transactions, columns."""
