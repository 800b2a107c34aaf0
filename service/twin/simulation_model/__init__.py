"""The fitted valve written for other simulators."""
