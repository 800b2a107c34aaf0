"""The whole method: from recordings to verdicts."""
