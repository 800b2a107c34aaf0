"""Which of the effects that were found stand, and whether anything is left unexplained."""
