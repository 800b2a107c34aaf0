"""The pages that people read, one module for each, with what their forms set off."""
