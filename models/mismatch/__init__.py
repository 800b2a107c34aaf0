"""What the stiction model leaves out: locate the mismatch, name the physics, model it, show it."""
