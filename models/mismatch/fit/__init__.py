"""Hypotheses, what they cost, and how they are fitted: least squares, cross-fitting, intervals."""
