"""What is said of a valve: one decision and one set of words for every output."""
