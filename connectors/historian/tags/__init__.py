"""Which valve and which signal a tag stands for."""
