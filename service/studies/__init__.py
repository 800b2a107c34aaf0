"""Studies of the method: blind trials, drift, simulated exports and archives.

Nothing that runs in a plant needs them.
"""
