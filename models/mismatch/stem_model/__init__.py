"""The stem of a hypothesis: its equations, and the kernels that follow it over a recording."""
