"""Samples from devices and watched folders, and the state of these sources."""
