"""Schedules, the queue of runs, and leases that give a duty to one process at a time."""
