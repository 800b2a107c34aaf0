"""Field tests that discriminate between rival models: which moves of OP, within limits, to make."""
