"""Where simulation and recording differ, for several recordings: search, JSON and page."""
