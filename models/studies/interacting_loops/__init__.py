"""Simulated plants of interacting loops in which the source of each oscillation is known."""
