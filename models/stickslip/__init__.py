"""The stick-slip element of two parameters (S, J), and its fit to a recording."""
