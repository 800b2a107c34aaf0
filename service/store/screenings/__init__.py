"""Results: valves, runs, what each screening found, and the networks valves are compared with."""
