"""Loops that oscillate together: the groups of a plant, and where each likely begins."""
