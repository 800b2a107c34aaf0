"""One recording against every stiction model: a table and a page."""
