"""The pages, one module for each, with the actions of their forms."""
