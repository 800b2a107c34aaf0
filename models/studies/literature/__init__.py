"""Stiction models of the literature behind one protocol: simulate, fit, compare."""
