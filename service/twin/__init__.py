"""The twin of a loop: its fitted model, run again as it might be."""
