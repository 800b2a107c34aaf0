"""``/api/v1``: the facts of the pages as JSON, and how this API describes itself."""
