"""Simulated control loops as plants have them without a valve position: OP, PV and SP alone."""
