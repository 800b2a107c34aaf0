"""Simulated plants of loops that act on each other; where oscillation begins is known."""
