"""What several windows of one valve say together, over hours or years."""
