"""Health indicators, each with unit and meaning, and the figures of the valve standards."""
