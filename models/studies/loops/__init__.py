"""Simulated control loops without a valve position: OP, PV and SP alone."""
