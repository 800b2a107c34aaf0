"""From time texts to instants: their format, day and month, and zone."""
