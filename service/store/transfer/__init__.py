"""A whole database elsewhere: into a file, out of a file, into another database.

``shape`` says which tables there are, ``stream`` reads their rows as Arrow batches with a digest
that is the same on SQLite and PostgreSQL, ``archive`` keeps them in one file, ``load`` brings them
into an empty database at the schema they come from, and from there to the newest.
"""
