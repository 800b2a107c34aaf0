"""The test that would tell: which moves of OP, within limits, tell rival models apart."""
