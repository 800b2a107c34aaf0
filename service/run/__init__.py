"""One engine for every run."""
