"""The search for effects that S and J leave out: which term, by which test."""
