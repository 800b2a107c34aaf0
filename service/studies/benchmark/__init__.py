"""A public set of valve recordings with a sealed truth, and the scoring of anybody's answers."""
