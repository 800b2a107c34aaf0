"""What the numbers of one signal, or of two, tell: movement, noise, steps, holes, swing."""
