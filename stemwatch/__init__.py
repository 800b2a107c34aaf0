"""Finds sticking control valves in plant-historian data."""
