"""From time texts to instants: their format, day and month, zone, and the clock of the source."""
