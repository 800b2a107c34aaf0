"""Studies of the method: models of the literature, simulators, a published study reproduced.

Nothing that runs in a plant needs them.
"""
