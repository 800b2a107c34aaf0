"""Results as stored: valves, runs, screenings, indicators, baseline networks, maintenance."""
