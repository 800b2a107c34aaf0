"""Where an effect shows, in cells of the residual, in one quantity against another, in words."""
