"""The twin of a loop: its fitted model, simulated with changes."""
