"""A recording made ready for the fits: its pace, its clock, the stretch that tells most."""
