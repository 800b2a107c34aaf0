"""Statistics and algebra that know nothing of valves."""
