"""Administration of a database: check, prune, back up, restore, copy, and counts for metrics."""
