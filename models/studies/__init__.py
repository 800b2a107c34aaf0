"""Studies of the method: models of the literature, a simulator, a published study done again.

Nothing that runs in a plant needs them.
"""
