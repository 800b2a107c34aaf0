"""From the evidence of one window to the verdict on the valve."""
